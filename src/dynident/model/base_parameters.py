"""Base parameters: which combinations of the standard parameters move the torque, by name.

Numeric method of Gautier 1991: the columns of Y on random states are reduced to a triangle; a column that depends on
those chosen before it is expressed by them. The order in which columns are offered decides only the names, and follows
the grouping rules of Khalil and Dombre 2002, section 9.4: the second moment across the axis, the first moment along
it and the mass go into the links before.

Axes that are a little off, as a calibration finds them, leave singular values of every size. The rank is then the
number above one line, strong columns come first, and columns are exchanged until none of those left out is a large
multiple of those kept (Gu and Eisenstat 1996, strong rank-revealing QR); what lies near the line is told by ``shares``
and ``neglected``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property

import numpy as np

from dynident.arrays import Array, BoolArray, IntArray
from dynident.errors import check_kind
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import Friction, Motion
from dynident.model.parameters import Parameter
from dynident.model.reduction import triangle_of
from dynident.model.robot import Robot

#: A column is dependent when what remains of it is below this share of the largest of its kind, and a combination when
#: its singular value is. Descriptions with angles like 1.5708 tilt axes by 4e-6 rad; what that lets through is no
#: information, while true columns keep a hundredth and more.
TOLERANCE = 1e-5

#: A base parameter is weak where the others leave less than this share of it: a log tells it only where the torque is
#: known better than to about this share. Arms with exact axes keep a hundredth and more.
WEAK = 1e-3

#: Singular values below this share of the largest are rounding of double precision.
_EXACT = 1e-12

#: Columns are exchanged until none is more than this multiple of a kept one, each in the unit of its kind.
_MULTIPLE = 100.0

#: A column this much smaller than the largest of its kind is zero but for such rounding. Kinds are second moments,
#: first moments, masses, each coefficient of the drives: against another unit small arms lose columns that count.
ZERO = 5e-6

#: Random motions have speeds of 3 rad/s and accelerations of 10 rad/s^2; gravity is made to count like them.
_ACCELERATION = 10.0

#: Slow motion goes down to this share of the random speeds.
_SLOWEST = 1e-3

#: Distances in m below this are rounding of a description.
_POINT = 1e-6

#: Models whose base parameters are kept, and these, the last first.
KEPT = 4
_known: list[tuple[Robot, tuple[object, ...], BaseParameters]] = []

IDENTIFIABLE, COMBINED, NOT_IDENTIFIABLE = "identifiable", "only in combination", "not identifiable"


@dataclass(frozen=True)
class BaseParameters:
    """The map between standard and base parameters: beta = K theta, and Y theta = Y[:, independent] beta.

    Attributes:
        parameters: The p standard parameters.
        independent: Positions in theta of the columns that are kept, ascending, shape (b,).
        matrix: K, shape (b, p); identity on the kept columns.
        matters: Which entries of K are more than rounding, and stand in names and verdicts, shape (b, p).
        shares: Norm on random states of what no combination of the others gives of each kept column, as a share of the
            largest column of its kind (second moments, first moments, masses, one coefficient of the drives), (b,).
        neglected: The largest singular value, or column alone, that was taken for rounding, in the same unit; 0 where
            nothing was left out but rounding of double precision.
    """

    parameters: tuple[Parameter, ...]
    independent: IntArray
    matrix: Array
    matters: BoolArray
    shares: Array
    neglected: float = 0.0

    @property
    def count(self) -> int:
        """Number of base parameters, b."""
        return len(self.independent)

    def rank_of(self, size: int) -> int:
        """Return how many base parameters a model with the first ``size`` of the standard parameters alone has."""
        chosen = self.independent < size
        others = np.where(self.matters, self.matrix, 0.0)[~chosen, :size]
        return int(chosen.sum()) + (int(np.linalg.matrix_rank(others)) if others.any() else 0)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Readable combinations, such as ``Izz[link1] + 0.16 m[link2]``."""
        return tuple(self._combination(row) for row in range(self.count))

    @cached_property
    def units(self) -> tuple[str, ...]:
        """Unit of each base parameter."""
        return tuple(self.parameters[i].unit for i in self.independent)

    @cached_property
    def is_friction(self) -> BoolArray:
        """Which base parameters are friction or offset, and no inertia of a rotor, shape (b,)."""
        return np.array([self.parameters[i].kind == "friction" for i in self.independent], dtype=bool)

    @cached_property
    def verdicts(self) -> tuple[str, ...]:
        """For each standard parameter: identifiable, only in combination, or not identifiable."""
        used = self.matters
        alone = used & (used.sum(axis=1) == 1)[:, None]
        return tuple(
            IDENTIFIABLE if alone[:, k].any() else COMBINED if used[:, k].any() else NOT_IDENTIFIABLE
            for k in range(len(self.parameters))
        )

    @property
    def weak(self) -> IntArray:
        """Base parameters that a log will hardly tell from the others, the weakest first: shares below 1e-3."""
        order = np.argsort(self.shares, kind="stable")
        return order[self.shares[order] < WEAK].astype(np.int64)

    def from_standard(self, theta: Array) -> Array:
        """Return beta = K theta, shape (b,)."""
        return self.matrix @ np.asarray(theta, dtype=float)

    def to_standard(self, beta: Array) -> Array:
        """Return the theta with zeros outside the kept columns, shape (p,): the same torque, in general no body."""
        theta = np.zeros(len(self.parameters))
        theta[self.independent] = beta
        return theta

    def _combination(self, row: int) -> str:
        lead = int(self.independent[row])
        text = self.parameters[lead].name
        for k in np.flatnonzero(self.matters[row]):
            value = self.matrix[row, k]
            if k == lead:
                continue
            size = "" if np.isclose(abs(value), 1.0, rtol=1e-9) else f"{abs(value):.6g} "
            text += f" {'-' if value < 0 else '+'} {size}{self.parameters[k].name}"
        return text


def base_parameters(model: DynamicModel, inertial_only: bool = False, seed: int = 0) -> BaseParameters:
    """Return the base parameters of a model; models of the very robot with the same friction share them.

    Args:
        model: Robot, drives and friction.
        inertial_only: Leave out friction, offset and rotor inertia: the count the literature states for an arm.
        seed: Seed of the random states.
    """
    check_kind("model", model, DynamicModel, 'di.base_parameters(di.DynamicModel(robot, ["coulomb", "viscous"]))')
    key = (model.friction, inertial_only, seed)
    for robot, other, base in _known:
        if robot is model.robot and other == key:
            return base
    base = _found(model, inertial_only, seed)
    _known[:] = [(model.robot, key, base), *_known[: KEPT - 1]]
    return base


def _found(model: DynamicModel, inertial_only: bool, seed: int) -> BaseParameters:
    samples = max(40, 4 * len(model.parameters) // max(model.robot.dof, 1))
    regressor = _balanced(model, _states(model, samples, seed))
    size = model.inertial_count if inertial_only else regressor.shape[-1]
    triangle = triangle_of(regressor[..., :size].reshape(-1, size))
    norms = np.linalg.norm(triangle, axis=0)
    sizes = _sizes(model, norms)
    live = sizes > ZERO
    unit = np.where(live, norms / np.where(live, sizes, 1.0), 1.0)  # norm of the largest column of the kind
    scaled = np.where(live, triangle / unit, 0.0)
    rank, after = _rank(scaled[:, live])
    neglected = max(after, sizes[~live].max(initial=0.0))
    chosen = _independent(scaled, [k for k in _preference(model, size) if live[k]], rank)
    matrix = np.zeros((rank, size))
    matrix[:, live] = _express(scaled[:, chosen], scaled[:, live]) / unit[chosen, None] * unit[live]
    largest = norms[chosen, None] * np.abs(matrix) / np.where(live, norms, np.inf)
    matrix[largest < 1e-13] = 0.0
    matrix[:, chosen] = np.eye(rank)
    matrix.setflags(write=False)
    matters = largest >= TOLERANCE
    shares = remainders(scaled[:, chosen])
    return BaseParameters(model.parameters[:size], chosen, matrix, matters, shares, float(neglected))


def with_stated_rotors(model: DynamicModel, arms: bool = False) -> DynamicModel:
    """Return the model without a choice about inertia of rotors that acts as an inertia of bodies for sure.

    That of a slide does, as mass, where no motion tells it from the mass beside the offset of the torque: a vertical
    one as well, whose weight the offset takes up. So does that of all joints of a gantry with a wrist of two axes. No
    sample decides on such inertia, and what is left out would count as mass; of a robot without slides as inertia of
    its links alone, which is looked at with ``arms``.
    """
    slides = {joint.name for joint in model.robot.active if joint.kind == "prismatic"}
    if not (slides or arms) or not any(part.is_optional and all(part.is_inertia) for part in model.friction):
        return model
    drives = [replace(part, choose=None) for part in model.friction if all(part.is_inertia)]
    constant = [part for part in model.friction if all(part.is_constant) and not part.is_optional]
    full = replace(model, friction=(*constant, *drives))
    verdicts = zip(full.parameters, base_parameters(full).verdicts, strict=True)
    apart = {one.owner for one, verdict in verdicts if one.kind == "rotor" and verdict == IDENTIFIABLE}
    every = model.robot.joint_names
    stated = {name for name in every if name not in apart and (name in slides or not apart)}
    return replace(model, friction=tuple(own for part in model.friction for own in _by_verdict(part, every, stated)))


def _by_verdict(part: Friction, every: Sequence[str], stated: set[str]) -> tuple[Friction, ...]:
    """Return an optional part for rotors as one for the stated and one for the other joints; others as they are."""
    joints = every if part.joints is None else part.joints
    if not (part.is_optional and all(part.is_inertia)) or not stated.intersection(joints):
        return (part,)
    own, others = (tuple(name for name in joints if (name in stated) is there) for there in (True, False))
    return replace(part, joints=own, choose=None), *([replace(part, joints=others)] if others else [])


def _states(model: DynamicModel, samples: int, seed: int) -> Motion:
    """Return random states; as many again at slow motion where friction shows there what it does not show at speed.

    What fades over hundredths of a radian a second would else count where one of the random speeds is slow by luck.
    """
    usual = model.random_motion(samples, seed)
    share = _SLOWEST ** np.random.default_rng([seed, 1]).uniform(0.0, 1.0, usual.dq.shape)
    slow = replace(model.random_motion(samples, seed + 1), dq=usual.dq * share)
    sizes = [np.linalg.norm(model.friction_values(motion), axis=0) for motion in (usual, slow)]
    if not np.any(sizes[1] > 2.0 * sizes[0]):
        return usual
    pairs = ((getattr(usual, each.name), getattr(slow, each.name)) for each in fields(Motion))
    return Motion(*(None if one is None else np.concatenate([one, other]) for one, other in pairs))  # type: ignore[arg-type]


def _balanced(model: DynamicModel, motion: Motion) -> Array:
    """Return the regressor on a motion with gravity and forces weighed as if the arm were of unit size, (N, n, p).

    Part of what holds at rest is taken off: Y - (1 - k) Y_rest with k > 0 has the null space of Y, since what is zero
    on all states is zero on those at rest. At arms of millimetres gravity would else drown what only speed shows, and
    gravity along an axis that is tilted by rounding would pass for a parameter.
    """
    length, gravity = _length(model), float(np.linalg.norm(model.robot.gravity))
    arm = np.array([1.0 if joint.kind == "revolute" else length for joint in model.robot.active])
    motion = replace(motion, q=motion.q * arm)
    regressor = model.regressor(motion, once=True)
    if gravity > 0:
        still = np.zeros_like(motion.q)
        rest = model.regressor(replace(motion, dq=still, ddq=still), once=True)
        regressor = regressor - (1.0 - length * _ACCELERATION / gravity) * rest
    return regressor * arm[:, None]


def _length(model: DynamicModel) -> float:
    """Return the typical distance between joints in m, 1 where all axes meet."""
    distances = np.linalg.norm(model.robot.chain.translation, axis=1)
    return float(distances[distances > _POINT].mean()) if np.any(distances > _POINT) else 1.0


def _sizes(model: DynamicModel, norms: Array) -> Array:
    """Return each column's norm (p,) as a share of the largest of its kind; 0 for rounding of double precision."""
    length, links = _length(model), model.inertial_count // 10
    drive, column = (np.asarray(each) for each in model.terms)
    slides = np.array([joint.kind != "revolute" for joint in model.robot.active])
    drives = 3 + 2 * column + slides[drive]  # forces and torques apart, each coefficient by itself
    kinds = np.concatenate([np.tile([0] * 6 + [1] * 3 + [2], links), drives])[: len(norms)]
    unit = norms / np.array([1.0, length, length**2, 1.0])[np.minimum(kinds, 3)]  # as if the arm were of unit size
    floor = _EXACT * unit.max(initial=0.0)  # a kind of which nothing counts
    largest = np.array([unit[kinds == k].max() for k in kinds])
    return np.where(unit > np.maximum(floor, _EXACT * largest), unit / np.where(largest > 0, largest, 1.0), 0.0)


def _rank(scaled: Array) -> tuple[int, float]:
    """Return how many singular values count, and the largest of the others."""
    values = np.linalg.svd(scaled, compute_uv=False)
    rank = int(np.sum(values > TOLERANCE))
    after = float(values[rank]) if rank < len(values) else 0.0
    return rank, after if after > _EXACT * values[0] else 0.0


def _independent(scaled: Array, order: list[int], rank: int) -> IntArray:
    """Return ``rank`` columns that give the others, ascending: the first in ``order`` that depend on no earlier one.

    Where singular values leave no gap, that alone may take too few or nearly dependent ones. Then those of which most
    is left follow, and columns change places until no multiple is large: each exchange makes the volume of the kept
    ones larger by that multiple, so that it ends.
    """
    chosen, rest = _first_independent(scaled, order, rank)
    while len(chosen) < rank:
        chosen.append(max((k for k in order if k not in chosen), key=lambda k: float(np.linalg.norm(rest[:, k]))))
        rest = _less(rest, rest[:, chosen[-1]])
    while True:
        others = [k for k in order if k not in chosen]
        multiples = np.abs(_express(scaled[:, chosen], scaled[:, others]))
        if multiples.max(initial=0.0) <= _MULTIPLE:
            return np.array(sorted(chosen), dtype=np.int64)
        leaves, enters = np.unravel_index(np.argmax(multiples), multiples.shape)
        chosen[leaves] = others[enters]


def _first_independent(scaled: Array, order: list[int], rank: int) -> tuple[list[int], Array]:
    """Return up to ``rank`` columns in ``order`` that depend on none before, strong ones first, and what all leave."""
    rest, chosen = scaled, list[int]()
    for line in (WEAK, TOLERANCE):
        for k in order:
            if len(chosen) < rank and k not in chosen and np.linalg.norm(rest[:, k]) > line:
                chosen.append(k)
                rest = _less(rest, rest[:, k])
    return chosen, rest


def _less(columns: Array, direction: Array) -> Array:
    """Return columns less what lies along a direction (Gram-Schmidt, twice)."""
    unit = direction / np.linalg.norm(direction)
    for _ in range(2):
        columns = columns - np.outer(unit, unit @ columns)
    return columns


def remainders(kept: Array) -> Array:
    """Return the norm of what all other columns leave of each, shape (b,)."""
    inverse = np.linalg.inv(np.linalg.qr(kept, mode="r"))
    return 1.0 / np.linalg.norm(inverse, axis=1)


def _express(basis: Array, columns: Array) -> Array:
    return np.linalg.lstsq(basis, columns, rcond=None)[0]


def _preference(model: DynamicModel, size: int) -> list[int]:
    """Return the order in which columns are offered: see the module's docstring."""
    second = {0: 3, 1: 0, 2: 3}  # axis x: Iyy goes; axis y: Ixx goes; axis z: Iyy goes
    first: list[int] = []
    last: list[int] = []
    for i, joint in enumerate(model.robot.joints):
        axis = int(np.argmax(np.abs(joint.axis)))
        grouped = {second[axis], 6 + axis, 9}
        for k in range(10):
            (last if k in grouped else first).append(10 * i + k)
    friction = list(range(model.inertial_count, size))
    # Mass first among the grouped, so that a sliding joint keeps m rather than a moment.
    last.sort(key=lambda k: (k % 10 != 9, k))
    return [*first, *last, *friction]
