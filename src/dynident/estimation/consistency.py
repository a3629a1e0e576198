"""Physical consistency as a convex program: pseudo-inertia LMIs, friction and rotor inertia >= 0.

Conditions: P_i > 0 for every link (Wensing, Kim and Slotine 2018, (12)); solved with Clarabel on the reduced triangle,
which is kept as R (never squared), so the number of rows does not matter (Sousa and Cortesao 2014).
"""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse

from dynident.arrays import Array
from dynident.errors import SolverFailed
from dynident.estimation.estimate import Consistency
from dynident.model.base_parameters import BaseParameters
from dynident.model.dynamic_model import DynamicModel
from dynident.model.inertia import PSEUDO_BASIS, Inertia
from dynident.model.kernels import batched
from dynident.model.reduction import Reduced

#: Smallest eigenvalue of a link's pseudo-inertia in units of its own scale: how far inside the cone estimates stay.
MARGIN = 1e-8

#: How tightly the prior holds: its standard deviation is 1 / sqrt(PULL) natural sizes, ten of them.
PULL = 0.01

#: When the solver stalls, the same problem is posed again a little farther inside the cone and a little stiffer.
ATTEMPTS = (1.0, 10.0, 100.0)

_ROOT2 = np.sqrt(2.0)
_UPPER = [(i, j) for j in range(4) for i in range(j + 1)]  # Clarabel's order: upper triangle by columns


@dataclass(frozen=True)
class Scale:
    """Natural size of each standard parameter, so that regularisers and margins mean the same for every robot.

    Attributes:
        mass: Of each link, shape (l,), in kg.
        length: Of each link, shape (l,), in m.
        parameters: Of each standard parameter, shape (p,).
        prior: Standard parameters that nothing in the data contradicts, shape (p,).
        source: Where the prior comes from, in words.
    """

    mass: Array
    length: Array
    parameters: Array
    prior: Array
    source: str


def natural_scale(model: DynamicModel, torque: Array, acceleration: Array) -> Scale:
    """Return the scale from the description's inertias where all are possible, else from the data.

    Without a usable description each link is a ball as long as its lever arms, and heavy enough that all together
    explain the largest joint torque.

    Args:
        model: Robot, drives and friction.
        torque: Root mean square torque of each joint, shape (n,).
        acceleration: Root mean square acceleration of each joint, shape (n,).
    """
    robot = model.robot
    length = _lengths(model)
    known = [link.inertia for link in robot.links if link.inertia is not None and link.inertia.is_consistent()]
    if len(known) == len(robot.links):
        mass = np.array([inertia.mass for inertia in known])
        length = np.array([np.sqrt(np.trace(inertia.pseudo[:3, :3]) / inertia.mass) for inertia in known])
        inertial = np.concatenate([inertia.vector for inertia in known])
        source = "the description's inertias"
    else:
        reach = float(np.sum(length))
        lever = np.array([reach if joint.kind == "revolute" else 1.0 for joint in robot.active])
        pull = lever * (np.linalg.norm(robot.gravity) + acceleration * lever)
        total = float(np.max(torque / np.maximum(pull, 1e-12)))
        mass = np.full(len(robot.links), max(total, 1e-6) * 2.0 / len(robot.links))
        ball = [Inertia(m, np.zeros(3), 0.4 * m * s**2 * np.eye(3)) for m, s in zip(mass, length, strict=True)]
        inertial = np.concatenate([inertia.vector for inertia in ball])
        source = "balls that explain the size of the torques"
    sizes = _sizes(model, mass, length, torque)
    rest = np.zeros(len(sizes) - model.inertial_count)
    return Scale(mass, length, sizes, np.concatenate([inertial, rest]), source)


def _sizes(model: DynamicModel, mass: Array, length: Array, torque: Array) -> Array:
    """Return the natural size of each standard parameter: a rotor counts as the largest link, friction as torque."""
    links = [np.r_[np.full(6, m * s**2), np.full(3, m * s), m] for m, s in zip(mass, length, strict=True)]
    rotor = {"kg m^2": float(np.max(mass * length**2)), "kg": float(np.max(mass))}
    largest = float(np.max(torque, initial=0.0))
    own = np.maximum(torque, 1e-3 * largest) if largest > 0 else np.ones(model.robot.dof)
    joint = dict(zip(model.robot.joint_names, own.tolist(), strict=True))
    tail = [rotor.get(p.unit, joint[p.owner]) for p in model.parameters[model.inertial_count :]]
    return np.concatenate([*links, tail])


def _lengths(model: DynamicModel) -> Array:
    """Return the lever arm of each link: to its farthest child or its own offset, at least a third of the mean."""
    joints = model.robot.joints
    arms = np.zeros(len(joints))
    for i, joint in enumerate(joints):
        away = float(np.linalg.norm(joint.translation))
        arms[i] = max(arms[i], away / 2)
        if joint.parent >= 0:
            arms[joint.parent] = max(arms[joint.parent], away)
    typical = float(np.mean(arms)) or 0.1
    return np.maximum(arms, typical / 3)


@dataclass(frozen=True)
class _Cones:
    """A theta = b - s, s in the cones, for all links and non-negative coefficients, in scaled variables."""

    matrix: scipy.sparse.csc_matrix
    offset: Array
    cones: list[Any]


def _consistency_cones(model: DynamicModel, scale: Scale, margin: float) -> _Cones:
    """Return the cones of scaled variables phi = theta / scale: P_i(phi) - margin I in S+, coefficients >= 0.

    In these variables the pseudo-inertia of a link is D P D / m with D = diag(1/L, 1/L, 1/L, 1).
    """
    clarabel: Any = importlib.import_module("clarabel")  # a compiled module without type stubs

    size = len(model.parameters)
    rows: list[Array] = []
    offsets: list[float] = []
    signs = [k for k, p in enumerate(model.parameters) if p.nonnegative]
    for k in signs:
        rows.append(-np.eye(size)[k])
        offsets.append(0.0)
    cones: list[Any] = [clarabel.NonnegativeConeT(len(signs))] if signs else []
    for link in range(len(model.robot.links)):
        for i, j in _UPPER:
            row = np.zeros(size)
            row[10 * link : 10 * link + 10] = -PSEUDO_BASIS[:, i, j] * (1.0 if i == j else _ROOT2)
            rows.append(row)
            offsets.append(-margin if i == j else 0.0)
        cones.append(clarabel.PSDTriangleConeT(4))
    return _Cones(scipy.sparse.csc_matrix(np.array(rows)), np.array(offsets), cones)


def _solve(quadratic: Any, linear: Array, matrix: Any, offset: Array, cones: list[Any]) -> tuple[Any, Array]:
    clarabel: Any = importlib.import_module("clarabel")  # a compiled module without type stubs

    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.max_threads = 1
    solver = clarabel.DefaultSolver(
        scipy.sparse.csc_matrix(scipy.sparse.triu(quadratic)), linear, matrix, offset, cones, settings
    )
    found = solver.solve()
    return found, np.array(found.x)


def consistent_fit(
    model: DynamicModel,
    base: BaseParameters,
    reduced: Reduced,
    scale: Scale,
    pull: float = PULL,
    margin: float = MARGIN,
) -> Array:
    """Return the physically consistent standard parameters that fit best, shape (p,).

    Minimises |R K theta - z|^2 + pull s^2 |(theta - prior) / scale|^2 with the residual variance s^2 = rest / rows of
    the unconstrained fit: a normal prior whose standard deviation is 1 / sqrt(pull) natural sizes. It settles what the
    data leave open, and its bias vanishes as rows are added, faster than the standard deviation.

    Args:
        model: Robot, drives and friction.
        base: Its base parameters.
        reduced: The weighted problem.
        scale: Natural sizes and prior.
        pull: See above.
        margin: Smallest eigenvalue of the scaled pseudo-inertia of each link.

    Raises:
        SolverFailed: No solution, or one that does not pass the check of its own conditions.
    """
    status, nearly = "", []
    for stiffer in ATTEMPTS:
        status, theta = _attempt(model, base, reduced, scale, pull * stiffer, margin * stiffer)
        if not status:
            return theta
        if "AlmostSolved" in status or "status Solved" in status:
            nearly += [inside for inside in [_moved_inside(model, theta, scale)] if inside is not None]
    if nearly:
        return min(nearly, key=lambda theta: reduced.residual_square(base.from_standard(theta)))
    step = "check the units of the log and the robot description, or use --estimator wls"
    raise SolverFailed("the consistent fit (Clarabel)", status, step)


def _attempt(
    model: DynamicModel, base: BaseParameters, reduced: Reduced, scale: Scale, pull: float, margin: float
) -> tuple[str, Array]:
    """Return what is wrong with the solution, empty where nothing is, and the standard parameters."""
    clarabel: Any = importlib.import_module("clarabel")  # a compiled module without type stubs

    size, count = len(model.parameters), base.count
    unit = np.sqrt(max(reduced.rest, 1e-14 * (reduced.rest + float(reduced.z @ reduced.z))))
    r = reduced.r @ (base.matrix * scale.parameters) / unit
    z = reduced.z / unit
    each = pull / max(reduced.rows, 1)
    weights = np.full(size, each)
    weights[model.inertial_count :] = [
        each if p.unit.startswith("kg") else 0.0 for p in model.parameters[model.inertial_count :]
    ]
    prior = scale.prior / scale.parameters
    cones = _consistency_cones(model, scale, margin)
    quadratic = scipy.sparse.block_diag([scipy.sparse.diags(weights), scipy.sparse.identity(count)])
    linear = np.concatenate([-weights * prior, np.zeros(count)])
    # Variables (phi, e) with e = R phi - z as equality rows: R is never squared.
    equality = scipy.sparse.hstack([scipy.sparse.csc_matrix(r), -scipy.sparse.identity(count)])
    inside = scipy.sparse.hstack([cones.matrix, scipy.sparse.csc_matrix((len(cones.offset), count))])
    found, x = _solve(
        quadratic,
        linear,
        scipy.sparse.csc_matrix(scipy.sparse.vstack([equality, inside])),
        np.concatenate([z, cones.offset]),
        [clarabel.ZeroConeT(count), *cones.cones],
    )
    theta = _clipped(model, x[:size] * scale.parameters, scale)
    broken = broken_conditions(model, theta)
    if str(found.status) == "Solved" and not broken:
        return "", theta
    return f"status {found.status}" + (f", {broken[0]}" if broken else ""), theta


def _moved_inside(model: DynamicModel, theta: Array, scale: Scale) -> Array | None:
    """Return theta moved towards the prior, by a thousandth at most, until it is possible; None where that fails."""
    for share in (0.0, *np.geomspace(1e-9, 1e-3, 7)):
        moved = _clipped(model, (1 - share) * theta + share * scale.prior, scale)
        if not broken_conditions(model, moved):
            return moved
    return None


def _clipped(model: DynamicModel, theta: Array, scale: Scale) -> Array:
    """Set non-negative coefficients that the solver left a rounding below zero to zero."""
    signs = np.array([p.nonnegative for p in model.parameters])
    return np.where(signs & (theta < 0) & (theta > -1e-6 * scale.parameters), 0.0, theta)


def broken_conditions(model: DynamicModel, theta: Array) -> tuple[str, ...]:
    """Return which conditions of physical consistency standard parameters (p,) break, in words."""
    reasons = []
    for i, link in enumerate(model.robot.links):
        inertia = Inertia.from_vector(theta[10 * i : 10 * i + 10])
        if not inertia.is_consistent():
            why = inertia.defect() or "the pseudo-inertia is not positive definite"
            reasons.append(f"{link.name}: {why}")
    for parameter, value in zip(model.parameters, theta, strict=True):
        if parameter.nonnegative and value < 0:
            reasons.append(f"{parameter.name} = {value:.4g} {parameter.unit} is negative")
    return tuple(reasons)


def judge(model: DynamicModel, base: BaseParameters, beta: Array, theta: Array | None) -> Consistency:
    """Say whether a possible robot stands behind an estimate; see :class:`Consistency`."""
    smallest = smallest_inertia(model, base.to_standard(beta))
    reasons = list(broken_conditions(model, theta)) if theta is not None else _unreachable(model, base, beta)
    if smallest <= 0:
        reasons.append(f"the inertia matrix M(q) has the eigenvalue {smallest:.4g}")
    return Consistency(not reasons, tuple(reasons), smallest)


def smallest_inertia(model: DynamicModel, theta: Array, samples: int = 200, seed: int = 1) -> float:
    """Return the smallest eigenvalue of M(q), rotors included, over random states, in kg m^2 (or kg)."""
    motion = model.random_motion(samples, seed)
    mass = batched.mass_matrix(model.robot.chain, theta[: model.inertial_count], motion.q)
    symbols = [(k, p) for k, p in enumerate(model.parameters) if p.symbol == "Ia"]
    rotor = np.diag([theta[k] for k, _ in symbols]) if symbols else np.zeros((model.robot.dof, model.robot.dof))
    coupling = np.asarray(model.robot.coupling)
    total = mass + model.robot.reflected_inertia + coupling.T @ rotor @ coupling
    return float(np.min(np.linalg.eigvalsh(total)))


def _unreachable(model: DynamicModel, base: BaseParameters, beta: Array) -> list[str]:
    """Return why no consistent theta has K theta = beta; empty where one has.

    Maximises t such that the scaled pseudo-inertias exceed t I and the coefficients t, with K theta = beta.
    """
    reachable = deepest_consistent(model, base, beta)
    if reachable is not None and not broken_conditions(model, reachable):
        return []
    return ["no links with positive mass density and friction >= 0 have these base parameters"]


def deepest_consistent(model: DynamicModel, base: BaseParameters, beta: Array) -> Array | None:
    """Return the theta deepest inside the cones with K theta = beta, shape (p,); None where there is none."""
    clarabel: Any = importlib.import_module("clarabel")  # a compiled module without type stubs

    size = len(model.parameters)
    length = _lengths(model)
    mass = np.full(len(length), max(_mass_of(model, base, beta, float(np.max(length))), 1e-9))
    scale = Scale(mass, length, _sizes(model, mass, length, _friction_of(model, base, beta)), np.zeros(size), "beta")
    cones = _consistency_cones(model, scale, 0.0)
    matrix = base.matrix * scale.parameters
    rows = np.linalg.norm(matrix, axis=1)
    shift = _depth_column(model)
    bounded = np.r_[np.zeros(size), 1.0]
    equality = np.column_stack([matrix / rows[:, None], np.zeros(base.count)])
    stacked = scipy.sparse.vstack(
        [scipy.sparse.csc_matrix(equality), scipy.sparse.hstack([cones.matrix, shift]), bounded[None, :]]
    )
    found, x = _solve(
        scipy.sparse.csc_matrix((size + 1, size + 1)),
        -bounded,
        scipy.sparse.csc_matrix(stacked),
        np.concatenate([beta / rows, cones.offset, [1.0]]),
        [clarabel.ZeroConeT(base.count), *cones.cones, clarabel.NonnegativeConeT(1)],
    )
    if "Solved" not in str(found.status) or x[-1] <= 0:
        return None
    return _clipped(model, x[:size] * scale.parameters, scale)


def _depth_column(model: DynamicModel) -> Array:
    """Return the column of t: it lowers every diagonal entry; coefficients need only be >= 0."""
    signs = sum(p.nonnegative for p in model.parameters)
    link = [1.0 if i == j else 0.0 for i, j in _UPPER]
    return np.concatenate([np.zeros(signs), np.tile(link, len(model.robot.links))])[:, None]


def _mass_of(model: DynamicModel, base: BaseParameters, beta: Array, length: float) -> float:
    """Return a mass that goes with the size of the inertial base parameters."""
    sizes = {"kg": 1.0, "kg m": length, "kg m^2": length**2}
    masses = [
        abs(value) / sizes[unit]
        for k, value, unit in zip(base.independent, beta, base.units, strict=True)
        if k < model.inertial_count
    ]
    return max(masses, default=1.0)


def _friction_of(model: DynamicModel, base: BaseParameters, beta: Array) -> Array:
    """Return the largest friction coefficient of each joint, shape (n,)."""
    sizes = dict.fromkeys(model.robot.joint_names, 0.0)
    for k, value, unit in zip(base.independent, beta, base.units, strict=True):
        owner = base.parameters[k].owner
        if k >= model.inertial_count and not unit.startswith("kg"):
            sizes[owner] = max(sizes[owner], abs(float(value)))
    return np.array(list(sizes.values()))


def describe_reasons(reasons: Sequence[str], most: int = 3) -> str:
    """Return the first reasons in one line."""
    more = f" and {len(reasons) - most} more" if len(reasons) > most else ""
    return "; ".join(reasons[:most]) + more
