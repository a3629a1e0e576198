"""The consistent fit: the program is posed, solved by one path after another until one passes the check, and judged."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal, TypeAlias

import numpy as np

from dynident.arrays import Array
from dynident.errors import SolverFailed
from dynident.identification.consistency.barrier import inside, solve_barrier
from dynident.identification.consistency.certificate import check_room
from dynident.identification.consistency.conditions import Conditions, conditions_of
from dynident.identification.consistency.conic import ConicCandidate, solve_conic
from dynident.identification.consistency.program import Optimality, Program, optimality, whitened_rows
from dynident.identification.estimate.plausibility import ConsistentRun
from dynident.identification.problem.prior import PULL, Scale, natural_scale
from dynident.identification.problem.problem import Problem
from dynident.model.base_parameters import BaseParameters
from dynident.model.body_constraints import Constraints
from dynident.model.dynamic_model import DynamicModel
from dynident.model.inertia import PSEUDO_BASIS
from dynident.model.lapack import solve_upper
from dynident.model.reduction import Reduced, triangle_of
from dynident.model.threads import one_blas_thread

#: Smallest eigenvalue of a link's pseudo-inertia in units of its own scale: how far inside the cone estimates stay.
MARGIN = 1e-8

#: Proven gap, as a share of the objective, with which a path's answer is taken at once.
GOOD = 1e-7

#: Proven gap with which the best answer of all paths is taken when none is good; the run states it.
FAIR = 1e-3

#: By how much a condition may be missed, in natural sizes.
MISSED = 1e-7

#: Slack in natural sizes below which a condition is active.
ACTIVE = 1e-5

#: Residual of possible robots over that of the free fit from which the latter is no unit where solvers fail; and how
#: often the unit is renewed then.
FAR, RENEWALS = 10.0, 4

#: The prior's pseudo-inertias are whitened with eigenvalues of at least this share of their trace.
_THIN = 1e-6

Metric: TypeAlias = Literal["natural", "pull_back", "entropic"]

METRICS: tuple[Metric, ...] = ("natural", "pull_back", "entropic")


@dataclass(frozen=True)
class ConsistentFit:
    """Standard parameters that fit best, with the proof.

    Attributes:
        theta: Standard parameters, shape (p,).
        optimality: Gap and its parts, computed from the program's own data.
        path: Which solver's answer it is.
        failed: What the paths before it were found to lack.
        active: Conditions that hold the estimate, in words, with slack and multiplier in natural sizes.
        data_share: Share of each standard parameter that comes from data: 1 less the variance that is left over the
            prior's variance, shape (p,); 1 where there is no prior.
    """

    theta: Array
    optimality: Optimality
    path: str
    failed: tuple[str, ...]
    active: tuple[Mapping[str, Any], ...]
    data_share: Array


def consistent_fit(
    model: DynamicModel,
    base: BaseParameters,
    reduced: Reduced,
    scale: Scale,
    pull: float = PULL,
    margin: float = MARGIN,
    metric: Metric = "natural",
    constraints: Constraints | None = None,
) -> ConsistentFit:
    """Return the physically consistent standard parameters that fit best.

    Minimises |R K theta - z|^2 + pull s^2 d(theta, prior) with the residual variance s^2 = rest / rows of the
    unconstrained fit. The distance d is for ``natural`` |(theta - prior) / scale|^2: a normal prior whose standard
    deviation is 1 / sqrt(pull) natural sizes; for ``pull_back`` sum_i |P_i(prior)^-1/2 (P_i - P_i(prior))
    P_i(prior)^-1/2|^2 (Lee and Park 2018); for ``entropic`` 2 sum_i (tr Q_i - log det Q_i - 4), Q_i = P_i(prior)^-1 P_i
    (Lee, Wensing and Park 2020), which near the prior is the same. The last two depend on no choice of frames. It
    settles what the data leave open, and its bias vanishes as rows are added, faster than the standard deviation.

    Args:
        model: Robot, drives and friction.
        base: Its base parameters.
        reduced: The weighted problem.
        scale: Natural sizes and prior.
        pull: See above.
        margin: Smallest eigenvalue of the scaled pseudo-inertia of each link.
        metric: See above.
        constraints: What else is known about bodies.

    Raises:
        ContradictoryConstraints: No robot meets the constraints; the message names those that clash.
        SolverFailed: No path reached a solution that passes the check of its own conditions.
    """
    program = pose_program(model, base, reduced, scale, pull, margin, metric, constraints)
    with one_blas_thread():  # matrices this small are slower on several threads
        return judged(solve_program(program, constraints is not None and not constraints.is_empty), scale)


def judged(answer: Answer, scale: Scale) -> ConsistentFit:
    """Return a checked answer as standard parameters with its proof."""
    found = answer.candidate
    shares = data_shares(answer.program, found.phi)
    theta, active = found.phi * scale.parameters, active_conditions(answer.program.conditions, found)
    return ConsistentFit(theta, answer.optimality, answer.path, answer.failed, active, shares)


def pose_program(
    model: DynamicModel,
    base: BaseParameters,
    reduced: Reduced,
    scale: Scale,
    pull: float = PULL,
    margin: float = MARGIN,
    metric: Metric = "natural",
    constraints: Constraints | None = None,
) -> Program:
    """Return the program of :func:`consistent_fit` in variables theta / scale, in units of the residual."""
    size, inertial = len(model.parameters), model.inertial_count
    data, target = scaled_data(base, reduced, scale)
    start = scale.prior / scale.parameters
    each = pull / max(reduced.rows, 1)
    held = np.array([metric == "natural" or k >= inertial for k in range(size)])
    held &= np.array([p.kind != "friction" for p in model.parameters])
    rows = np.sqrt(each) * np.eye(size)[held]
    aim = np.sqrt(each) * start[held]
    whitening = np.zeros((0, 4, 4))
    if metric != "natural":
        bodies = np.einsum("lk,kij->lij", start[:inertial].reshape(-1, 10), PSEUDO_BASIS)
        roots = np.linalg.cholesky(lifted(bodies))
        whitening = np.linalg.inv(roots)
        if metric == "pull_back":
            bound = np.sqrt(each) * whitened_rows(roots, size)
            rows, aim = np.vstack([bound, rows]), np.concatenate([bound @ start, aim])
    return Program(
        data=data,
        target=target,
        pull=rows,
        pull_target=aim,
        weight=each if metric == "entropic" else 0.0,
        whitening=whitening,
        conditions=conditions_of(model, scale, margin, constraints),
        start=start,
    )


def scaled_data(base: BaseParameters, reduced: Reduced, scale: Scale) -> tuple[Array, Array]:
    """Return A and y of a program: the triangle over scaled parameters in units of the unconstrained residual."""
    unit = np.sqrt(max(reduced.rest, 1e-14 * (reduced.rest + float(reduced.z @ reduced.z))))
    return reduced.r @ (base.matrix * scale.parameters) / unit, reduced.z / unit


def lifted(bodies: Array) -> Array:
    """Return pseudo-inertias whose eigenvalues are at least a small share of their trace."""
    values, vectors = np.linalg.eigh(bodies)
    values = np.maximum(values, _THIN * values.sum(axis=1, keepdims=True))
    return np.einsum("lij,lj,lkj->lik", vectors, values, vectors)


def _check_room(program: Program) -> None:
    rules = program.conditions
    place = program.start + 1e-3 * (np.arange(rules.size) >= 10 * program.links)  # the prior with a little friction
    if rules.shortfall(place) == 0.0 and np.min(rules.signs(place), initial=1.0) > 1e-6:
        return  # where it is inside, nothing is to be proven
    check_room(rules)


@dataclass(frozen=True)
class Answer:
    """A checked answer, the program that it answers, the path that gave it, and what the paths before it lack."""

    program: Program
    candidate: ConicCandidate
    optimality: Optimality
    path: str
    failed: tuple[str, ...] = ()


def _residual(program: Program, phi: Array) -> float:
    """Return the residual in units of the program, that of the free fit included."""
    return float(np.hypot(1.0, np.linalg.norm(program.data @ phi - program.target)))


def solve_program(program: Program, stated: bool = False) -> Answer:
    """Return the first answer that passes the check, else the best fair one.

    Args:
        program: The program.
        stated: Whether conditions are stated that may not hold together; that is looked at first.

    Raises:
        ContradictoryConstraints: They cannot.
        SolverFailed: No path reached a solution that passes the check.
    """
    if stated:
        _check_room(program)  # else a body of next to no mass could pass for one within the tolerances
    failed: list[str] = []
    best = _best_answer(program, failed)
    if best is None or best.optimality.gap > GOOD:
        place = inside(program) if best is None else best.candidate.phi
        best = best if place is None else _in_own_units(program, place) or best
    if best is not None:
        return replace(best, failed=tuple(failed))
    _check_room(program)
    step = "check the units of the log and the robot model, or use --estimator wls"
    raise SolverFailed("the consistent fit", "; ".join(failed), step)


def _best_answer(program: Program, failed: list[str]) -> Answer | None:
    """Return the first answer with a good gap, else the best fair one; what paths lack is added to ``failed``."""
    fair: list[Answer] = []
    first = "Clarabel with exponential cones" if program.weight else "Clarabel"
    for name, path in ((first, solve_conic), ("log-det barrier", solve_barrier)):
        try:
            raw = path(program)
        except (ValueError, np.linalg.LinAlgError, FloatingPointError) as error:
            failed.append(f"{name}: {error}")
            continue
        found = checked(program, raw)
        if found is None:
            failed.append(f"{name}: status {raw.said}, and its answer breaks the conditions")
            continue
        answer = Answer(program, *found, name)
        if answer.optimality.gap <= GOOD:
            return answer
        failed.append(f"{name}: status {raw.said}, proven gap {answer.optimality.gap:.2g}")
        if answer.optimality.gap <= FAIR:
            fair.append(answer)
    return min(fair, key=lambda answer: answer.optimality.gap, default=None)


def _in_own_units(program: Program, place: Array) -> Answer | None:
    """Return the answer in units of the residual that possible robots leave, from a place near; None without one.

    Where data have next to no noise and ask for the impossible, the free fit's residual is no unit: the data's part is
    so many times the prior's that no solver sees both. The residual variance that weighs the prior is then that of the
    consistent fit itself, renewed a few times.
    """
    best: Answer | None = None
    for _ in range(RENEWALS):
        unit = _residual(program, place)
        if unit < FAR:
            break
        found = _best_answer(replace(program, data=program.data / unit, target=program.target / unit), [])
        if found is None:
            break
        best = replace(found, path=f"{found.path}, in units of its own residual")
        place = found.candidate.phi
        if _residual(program, place) > unit / 2:
            break
    return best


def checked(program: Program, raw: ConicCandidate) -> tuple[ConicCandidate, Optimality] | None:
    """Return an answer mended by roundings until it meets its conditions, and how good it is; None where it cannot."""
    prices = raw.multipliers
    are_finite = (np.all(np.isfinite(part)) for part in (raw.phi, prices.zero, prices.sign, prices.cones))
    phi = _mended(program, raw.phi) if all(are_finite) else None
    if phi is None:
        return None
    return replace(raw, phi=phi, multipliers=prices.projected()), optimality(program, phi, prices)


def _mended(program: Program, phi: Array) -> Array | None:
    """Return phi with coefficients a rounding below their bound put on it, and moved towards the prior.

    It is moved by a thousandth at most, until every link is possible.
    """
    rules = program.conditions
    for share in (0.0, 1e-9, 1e-8, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3):
        moved = _clipped(rules, (1 - share) * phi + share * program.start)
        if rules.shortfall(moved) <= MISSED and np.min(np.linalg.eigvalsh(program.inertias(moved)), initial=1.0) > 0.0:
            return moved
    return None


def _clipped(rules: Conditions, phi: Array) -> Array:
    """Set coefficients that the solver left a rounding below or above zero to zero."""
    single = np.flatnonzero((np.count_nonzero(rules.sign, axis=1) == 1) & (rules.sign_offset == 0.0))
    columns = np.argmax(rules.sign[single], axis=1)
    columns = columns[columns >= 10 * len(rules.links)]
    clipped = phi.copy()
    low = (phi[columns] < 1e-9) & (phi[columns] > -1e-6)
    clipped[columns[low]] = 0.0
    return clipped


def active_conditions(rules: Conditions, found: ConicCandidate) -> tuple[Mapping[str, Any], ...]:
    """Return the conditions that hold an answer: stated in words, with slack and multiplier in natural sizes."""
    active = []
    for words, slack, price in zip(rules.sign_words, rules.signs(found.phi), found.multipliers.sign, strict=True):
        if slack < ACTIVE:
            active.append({"condition": words, "slack": max(float(slack), 0.0), "multiplier": float(price)})
    for words, body, price in zip(rules.cone_words, rules.pseudo(found.phi), found.multipliers.cones, strict=True):
        smallest = float(np.linalg.eigvalsh(body)[0])
        if smallest < ACTIVE * max(float(np.trace(body)), 1e-3):
            active.append({"condition": words, "slack": max(smallest, 0.0), "multiplier": float(np.trace(price))})
    return tuple(active)


def scale_of(problem: Problem) -> Scale:
    """Return natural sizes and prior of a problem."""
    torque = np.array([np.sqrt(t.torque_square / max(t.rows, 1)) for t in problem.triangles])
    if problem.left is not None:
        return natural_scale(problem.model, torque, problem.left.accelerations, problem.prior)
    squares = [np.asarray(log.log.ddq) ** 2 for log in problem.logs]
    return natural_scale(problem.model, torque, np.sqrt(np.mean(np.concatenate(squares), axis=0)), problem.prior)


def run_of(
    fit: ConsistentFit, scale: Scale, reduced: Reduced, beta: Array, metric: Metric | None = None
) -> ConsistentRun:
    """Return what an estimator states of its fit."""
    above = np.sqrt(reduced.residual_square(beta) / reduced.rest) - 1.0 if reduced.rest > 0 else None
    return ConsistentRun(
        prior=scale.source,
        data_share=fit.data_share.tolist(),
        metric=metric,
        residual_above_unconstrained=None if above is None else float(above),
        gap=fit.optimality.gap,
        solver=fit.path,
        failed_solvers=fit.failed,
        active=[condition["condition"] for condition in fit.active],
        active_slack=[condition["slack"] for condition in fit.active],
        active_multiplier=[condition["multiplier"] for condition in fit.active],
    )


def data_shares(program: Program, phi: Array) -> Array:
    """Return 1 - (variance with data and prior) / (variance with the prior alone) of each parameter, shape (p,).

    Variances are diagonals of the inverse Hessians of f and of its prior part (Laplace's approximation); equations of
    the conditions hold in both. Without a prior, as for friction, the share is 1; a value that an equation fixes has 0.
    """
    size = program.data.shape[1]
    prior = program.curvature(phi)[len(program.data) :]
    free = np.abs(prior).sum(axis=0) == 0.0  # nothing but data
    both = triangle_of(np.vstack([program.data, prior]))
    inverse = program.conditions.free
    after = _spread(both, inverse)
    before = _spread(triangle_of(np.vstack([prior, np.eye(size)[free]])), inverse)
    shares = 1.0 - np.divide(after, before, out=np.ones(size), where=before > 1e-20)
    return np.where(free & (after > 0), 1.0, np.clip(shares, 0.0, 1.0))


def _spread(root: Array, free: Array) -> Array:
    """Return the diagonal of F (F' root' root F)^-1 F' for free directions F, shape (p,)."""
    factor = triangle_of(root @ free)
    turned = solve_upper(factor, free.T, transposed=True)
    return np.sum(turned**2, axis=0)
