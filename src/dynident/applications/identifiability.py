"""Exact identifiability: which parameters move the torque, from the geometry of the joints alone, no states sampled.

The torque is zero at every motion exactly where the mass matrix M(q) and the gravity torque g(q) are zero at every
posture. With the composite inertia I_j of all that joint j carries, M_jk = s_j' I_j X_jk s_k, g_j = s_j' I_j X_j a_0:
linear functions of I_j, one for each way in which the joints before j can make its link move. Moving a joint changes a
composite inertia as 1, cos q, sin q, cos 2q, sin 2q (a slide: 1, q, q^2), which are independent functions, so each of
their coefficients must vanish on its own. Passing these conditions from the base to the tips leaves a few rows of
constants per link, and their rank is the number of base parameters. The idea of propagating what a joint can see is
that of Wensing, Niemeyer and Slotine 2024 (parameter nullspaces by recursion); here it is written for the conditions
(the row space) in place of the null space, so that gravity, trees, rotors and offsets need no cases of their own.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from dynident.arrays import Array
from dynident.errors import BadOption, SolverFailed
from dynident.model.chain import PRISMATIC, Chain
from dynident.model.dynamic_model import DynamicModel
from dynident.model.inertia import skew

#: Directions below this share are no information but rounding of a description, such as an angle of 1.5708.
TOLERANCE = 1e-5

_UPPER = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))


@dataclass(frozen=True)
class Structure:
    """What the geometry says about the standard parameters of a model.

    Attributes:
        rows: Orthonormal basis of the combinations that move the torque, in scaled parameters, shape (b, p).
        scale: Size of each parameter by which rows are scaled, shape (p,).
    """

    rows: Array
    scale: Array

    @property
    def count(self) -> int:
        """Number of base parameters, b."""
        return len(self.rows)

    @cached_property
    def null_space(self) -> Array:
        """Changes of the standard parameters that no motion shows, one a column, shape (p, p - b)."""
        _, _, directions = np.linalg.svd(self.rows, full_matrices=True)
        return directions[self.count :].T * self.scale[:, None]

    @cached_property
    def alone(self) -> tuple[bool, ...]:
        """Whether each standard parameter is identifiable by itself."""
        share = np.linalg.norm(self.rows, axis=0)
        return tuple(bool(s > 1 - TOLERANCE) for s in share)

    @cached_property
    def hidden(self) -> tuple[bool, ...]:
        """Whether each standard parameter never moves the torque."""
        share = np.linalg.norm(self.rows, axis=0)
        return tuple(bool(s < TOLERANCE) for s in share)


def structure(model: DynamicModel) -> Structure:
    """Return which combinations of a model's standard parameters move the torque, exactly.

    Friction other than rotor inertia and offset is taken as a function of its own on every joint.

    Raises:
        BadOption: A joint follows another one: their positions are not independent.
        SolverFailed: The geometry leaves the rank open: axes nearly, but not exactly, parallel or intersecting.
    """
    chain = model.robot.chain
    if chain.has_mimic:
        step = "the exact count needs joints that move on their own; the numeric one holds"
        raise BadOption("robot", f"{model.robot.name} with a joint that follows another", step)
    length = _length(chain)
    tables = _Tables(model, length)
    found = _conditions(chain, length, tables)
    size, scale = model.inertial_count, _scale(model, length)
    scale[tables.positions] = tables.size
    rows = np.zeros((len(found), len(model.parameters)))
    rows[:, :size] = found[:, :size]
    rows[:, tables.positions] = found[:, size:]
    own = [k for k in range(size, len(model.parameters)) if k not in set(tables.positions)]
    rows = np.vstack([rows, np.eye(len(model.parameters))[own]])
    return Structure(_row_space(rows), scale)


class _Tables:
    """Which drive coefficients may hide behind inertias or gravity, and what they add to M and g.

    The other friction columns are functions of their own.

    Attributes:
        positions: Their positions in theta, e of them.
        inertia: What they add to the mass matrix, lengths in units of ``length``, shape (n, n, e).
        constant: What they add to a constant torque, per unit of gravity where there is some, shape (n, e).
        size: In what units they count, so that none is larger than 1, shape (e,).
    """

    def __init__(self, model: DynamicModel, length: float) -> None:
        inertias = [own for part in model.friction for own in part.is_inertia]
        constants = [own for part in model.friction for own in part.is_constant]
        drive, column = model.terms
        coupling = np.asarray(model.robot.coupling)
        chosen = [k for k, c in enumerate(column) if inertias[c] or constants[c]]
        self.positions = [model.inertial_count + k for k in chosen]
        n = model.robot.dof
        self.inertia, self.constant = np.zeros((n, n, len(chosen))), np.zeros((n, len(chosen)))
        for place, k in enumerate(chosen):
            motor = coupling[drive[k]]
            if inertias[column[k]]:
                self.inertia[:, :, place] = np.outer(motor, motor)
            else:
                self.constant[:, place] = motor
        arm = np.array([length if joint.kind == "revolute" else 1.0 for joint in model.robot.active])
        self.inertia /= np.multiply.outer(arm, arm)[:, :, None]
        self.constant /= arm[:, None] * (float(np.linalg.norm(model.robot.gravity)) or 1.0)
        largest = np.maximum(np.abs(self.inertia).max(axis=(0, 1)), np.abs(self.constant).max(axis=0))
        self.size = 1.0 / np.where(largest > 0, largest, 1.0)
        self.inertia, self.constant = self.inertia * self.size, self.constant * self.size


def _length(chain: Chain) -> float:
    """Return a length by which moments are compared: the typical distance between joints."""
    distances = np.linalg.norm(chain.translation, axis=1)
    return float(distances[distances > 0].mean()) if np.any(distances > 0) else 1.0


def _scale(model: DynamicModel, length: float) -> Array:
    """Return how much of each parameter makes the torque of a unit mass: inertias by length^2, moments by length."""
    ten = np.array([length**2] * 6 + [length] * 3 + [1.0])
    drives = np.ones(len(model.parameters) - model.inertial_count)
    return np.concatenate([np.tile(ten, model.inertial_count // 10), drives])


def _conditions(chain: Chain, length: float, tables: _Tables) -> Array:
    """Return rows (c, 10 l + e) whose products with the scaled parameters must vanish for zero torque."""
    motions = [_motion_waves(chain, i, length) for i in range(chain.links)]
    inertias = [_inertia_waves(waves) for waves in motions]
    constant = _constant_parts(chain, [waves[0] for waves in inertias])
    extras = tables.constant.shape[1]
    everything: list[Array] = [np.zeros((0, 10))] * chain.links  # conditions on all coefficients
    varying: list[Array] = [np.zeros((0, 10))] * chain.links  # conditions on all but the constant one
    seen: list[tuple[Mapping[int, Array], Array]] = []
    rows = [_pure_rows(chain, tables)]
    for i in range(chain.links):
        above = int(chain.parent[i])
        seen.append(_seen(chain, motions[i], i, seen[above] if above >= 0 else None))
        own = _own_conditions(chain, i, seen[i], tables)
        handed = np.zeros((0, 10))
        if above >= 0:
            first, *others = inertias[i]
            before = np.vstack([everything[above], varying[above]])
            handed = np.vstack([before @ wave for wave in others])
            varying[i] = _span(before @ first)
        augmented = _span(np.vstack([own, np.hstack([handed, np.zeros((len(handed), extras))])]))
        everything[i] = augmented[:, :10]
        rows.append(np.hstack([augmented[:, :10] @ constant[i].T, augmented[:, 10:]]))
    return np.vstack(rows)


def _motion_waves(chain: Chain, i: int, length: float) -> Sequence[Array]:
    """Return the coefficients of the motion transform into link i, (6, 6) each: constant first, then cos, sin; or q."""
    turn, shift = np.asarray(chain.rotation[i]).T, skew(np.asarray(chain.translation[i]) / length)
    fixed = np.block([[turn, np.zeros((3, 3))], [-turn @ shift, turn]])
    axis = np.asarray(chain.axis[i])
    if chain.kind[i] == PRISMATIC:
        slide = np.zeros((6, 6))
        slide[3:, :3] = -skew(axis)
        return [fixed, slide @ fixed]
    along = np.outer(axis, axis)
    return [np.kron(np.eye(2), part) @ fixed for part in (along, np.eye(3) - along, -skew(axis))]


def _inertia_waves(waves: Sequence[Array]) -> list[Array]:
    """Return the coefficients of X' I X as maps of the ten parameters, (10, 10) each: constant first."""
    found = []
    for columns in zip(*(_waves_of(_matrix(unit), waves) for unit in np.eye(10)), strict=True):
        found.append(np.stack([_ten(column) for column in columns], axis=1))
    return found


def _waves_of(inertia: Array, waves: Sequence[Array]) -> list[Array]:
    def product(a: Array, b: Array) -> Array:
        return a.T @ inertia @ b

    if len(waves) == 2:
        constant, linear = waves
        mixed = product(constant, linear)
        return [product(constant, constant), mixed + mixed.T, product(linear, linear)]
    constant, cosine, sine = waves
    of_cos, of_sin, both = product(constant, cosine), product(constant, sine), product(cosine, sine)
    squares = product(cosine, cosine), product(sine, sine)
    return [
        product(constant, constant) + 0.5 * (squares[0] + squares[1]),
        of_cos + of_cos.T,
        of_sin + of_sin.T,
        0.5 * (squares[0] - squares[1]),
        0.5 * (both + both.T),
    ]


def _matrix(ten: Array) -> Array:
    """Return the spatial inertia (6, 6) of ten parameters about the frame's origin, rotation first."""
    found = np.zeros((6, 6))
    for value, (row, column) in zip(ten[:6], _UPPER, strict=True):
        found[row, column] = found[column, row] = value
    found[:3, 3:], found[3:, :3] = skew(ten[6:9]), -skew(ten[6:9])
    found[3:, 3:] = ten[9] * np.eye(3)
    return found


def _ten(inertia: Array) -> Array:
    first = (inertia[2, 4], inertia[0, 5], inertia[1, 3])
    return np.array([*(inertia[k] for k in _UPPER), *first, inertia[3, 3]])


def _constant_parts(chain: Chain, first: Sequence[Array]) -> Sequence[Array]:
    """Return per link the map of a function of its composite inertia to its constant part, shape (10 l, 10)."""
    found = [np.zeros((10 * chain.links, 10)) for _ in range(chain.links)]
    for i in reversed(range(chain.links)):
        found[i][10 * i : 10 * i + 10] += np.eye(10)
        if chain.parent[i] >= 0:
            found[chain.parent[i]] += found[i] @ first[i].T
    return found


def _seen(
    chain: Chain, waves: Sequence[Array], i: int, above: tuple[Mapping[int, Array], Array] | None
) -> tuple[Mapping[int, Array], Array]:
    """Return how link i can move in its own frame: the constant part by joint (gravity is -1), and all that varies."""
    if above is None:
        rise = np.concatenate([np.zeros(3), -np.asarray(chain.gravity)])
        size = float(np.linalg.norm(rise))
        above = ({-1: rise / size} if size > 0 else {}), np.zeros((0, 6))
    steady, moving = above
    constant, *others = waves
    parts = [moving @ wave.T for wave in waves] + [np.atleast_2d(wave @ v) for v in steady.values() for wave in others]
    kept = {**{k: constant @ v for k, v in steady.items()}, int(chain.joint[i]): _axis(chain, i)}
    return kept, _span(np.vstack([np.zeros((0, 6)), *parts]))


def _axis(chain: Chain, i: int) -> Array:
    """Return the motion of joint i in its own frame, shape (6,)."""
    turns = chain.kind[i] != PRISMATIC
    return np.concatenate([chain.axis[i], np.zeros(3)] if turns else [np.zeros(3), chain.axis[i]])


def _own_conditions(chain: Chain, i: int, seen: tuple[Mapping[int, Array], Array], tables: _Tables) -> Array:
    """Return the entries of M and g in the row of joint i, as functions (c, 10 + e) of its composite inertia."""
    axis, (steady, moving), j = _axis(chain, i), seen, int(chain.joint[i])
    found = [np.concatenate([_pairing(axis, v), np.zeros(tables.constant.shape[1])]) for v in moving]
    for k, v in steady.items():
        beside = tables.constant[j] if k < 0 else tables.inertia[j, k]
        found.append(np.concatenate([_pairing(axis, v), beside]))
    if not np.any(chain.gravity):
        found.append(np.concatenate([np.zeros(10), tables.constant[j]]))
    return np.array(found)


def _pairing(a: Array, b: Array) -> Array:
    """Return a' I b as a function of the ten parameters, shape (10,)."""
    return np.array([a @ _matrix(unit) @ b for unit in np.eye(10)])


def _pure_rows(chain: Chain, tables: _Tables) -> Array:
    """Return the entries of M between joints of different branches, which only coupled rotors can fill."""
    size = 10 * chain.links
    link_of = {int(j): i for i, j in enumerate(chain.joint)}
    ancestors = []
    for i in range(chain.links):
        above = int(chain.parent[i])
        ancestors.append({i} | (ancestors[above] if above >= 0 else set()))
    found = [
        np.concatenate([np.zeros(size), tables.inertia[j, k]])
        for j in range(chain.joints)
        for k in range(j)
        if link_of[k] not in ancestors[link_of[j]] and link_of[j] not in ancestors[link_of[k]]
    ]
    return np.array(found).reshape(-1, size + tables.constant.shape[1])


def _span(vectors: Array) -> Array:
    """Return an orthonormal basis of the span of rows, the directions that are only rounding left out."""
    if not len(vectors):
        return vectors
    _, values, directions = np.linalg.svd(vectors, full_matrices=False)
    return directions[values > TOLERANCE * max(1.0, values[0])]


def _row_space(rows: Array) -> Array:
    _, values, directions = np.linalg.svd(rows, full_matrices=False)
    rank = int(np.sum(values > TOLERANCE * values[0]))
    after = values[rank] if rank < len(values) else 0.0
    if after * 1e2 > values[rank - 1]:
        raise SolverFailed(
            "the exact count of base parameters",
            f"singular values {values[rank - 1]:.2g} and {after:.2g} leave the rank open",
            "check the robot model for nearly, but not exactly, parallel or intersecting axes",
        )
    return directions[:rank]
