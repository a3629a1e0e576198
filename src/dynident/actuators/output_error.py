"""Output error of servo roll-outs: bounded nonlinear least squares with exact derivatives, from several starts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from dynident.actuators.parameters import PARAMETERS, PLACE, FrictionModel
from dynident.actuators.rollout import (
    NONE,
    SEARCH,
    STEP,
    JointRecord,
    encoder_step,
    from_best_start,
    rolled_out,
    started,
)
from dynident.actuators.rollout_loop import START_Q, START_V
from dynident.arrays import Array, IntArray
from dynident.errors import SolverFailed

#: Length of the first shooting intervals in s; then whole logs.
SHOOTING_S = 1.0

#: Starts whose results on intervals differ by less than this share of each parameter go on as one.
_ALIKE = 0.05

#: Errors count by their size from this many medians on, two standard deviations, where the start is near the answer:
#: from the median on, errors of an encoder's step would be spread 1.3 times as far as least squares spreads them.
_NEAR = 3.0

#: Least root mean square error of a log, as a share of their median, that its weight goes by.
_LEAST_SHARE = 0.5

#: The same as a share of the step of the encoder.
_LEAST_STEP = 0.1


@dataclass(frozen=True)
class RefineEffort:
    """How long the output error looks.

    Attributes:
        few: Evaluations of each start on intervals.
        many: Evaluations of the best starts on whole logs.
        go_on: Starts that go on to whole logs, beside the first one.
        reweights: Times that the weights of the logs are found anew.
        finish: Evaluations with the step of the answer, behind all others.
    """

    few: int
    many: int
    go_on: int
    reweights: int
    finish: int


#: Of the answer, of a joint of an arm before its load is known better, and of a fold of the cross-validation.
THOROUGH, ROUGH, FOLD = RefineEffort(12, 60, 4, 3, 8), RefineEffort(12, 25, 2, 1, 0), RefineEffort(8, 25, 0, 1, 0)


#: Starts beside the linear one, as multiples of its parameters.
_OTHER_STARTS: tuple[Mapping[str, float], ...] = (
    {"armature": 2.0, "coulomb": 0.5},
    {"full_torque": 1.2, "viscous": 0.5, "back_emf": 1.5},
    {"full_torque": 0.85, "coulomb": 2.0},
)


@dataclass(frozen=True)
class ServoProblem:
    """Roll-outs of one joint and the parameters that are free.

    Attributes:
        records: The joint in the logs.
        free: Names of the free parameters.
        friction: Friction model, with its equal parameters.
        longest: Longest step of the integration in s, or SEARCH.
    """

    records: tuple[JointRecord, ...]
    free: tuple[str, ...]
    friction: FrictionModel
    longest: float = SEARCH

    @property
    def finely(self) -> ServoProblem:
        """The problem with the step of the answer."""
        return replace(self, longest=STEP)

    @property
    def places(self) -> list[int]:
        """Columns of the free parameters."""
        return [PLACE[name] for name in self.free]

    def full(self, values: Array, base: Array) -> Array:
        """Return all parameters, shape (COUNT,), from the free ones (f,) and the others."""
        parameters = base.copy()
        parameters[self.places] = values
        for tied, other in self.friction.tied:
            parameters[PLACE[tied]] = parameters[PLACE[other]]
        return parameters

    def columns(self) -> IntArray:
        """Return the column of the derivatives by each parameter, shape (COUNT + 2,); equal parameters share one.

        The last two are position and velocity at the start.
        """
        found = NONE.copy()
        found[self.places] = np.arange(len(self.free))
        for tied, other in self.friction.tied:
            found[PLACE[tied]] = found[PLACE[other]]
        found[[START_Q, START_V]] = len(self.free), len(self.free) + 1
        return found

    def bounds(self) -> tuple[Array, Array]:
        """Return the bounds of the free parameters, each (f,)."""
        own = [PARAMETERS[place] for place in self.places]
        return np.array([one.lower for one in own]), np.array([one.upper for one in own])

    def scales(self) -> Array:
        """Return the sizes of typical changes, shape (f,)."""
        return np.array([PARAMETERS[place].scale for place in self.places])

    def started(self, parameters: Array) -> ServoProblem:
        """Return the problem with each log started where its roll-out follows it best."""
        return replace(self, records=tuple(started(one, parameters, longest=self.longest) for one in self.records))

    def residuals(self, parameters: Array) -> list[Array]:
        """Return the errors in rad, log by log."""
        runs = [(record, rolled_out(record, parameters, longest=self.longest).q) for record in self.records]
        return [(q - record.q)[record.used] for record, q in runs]

    def errors(self, parameters: Array, beside: Sequence[Array] = ()) -> tuple[list[Array], list[Array]]:
        """Return the errors in rad and their derivatives by the free parameters, log by log.

        Both are less what position and velocity at the start of each log explain.

        Args:
            parameters: Shape (COUNT,).
            beside: Derivatives by d other numbers, log by log, each (N, d), to stand behind the others.
        """
        errors, slopes, columns = [], [], self.columns()
        for k, record in enumerate(self.records):
            run = rolled_out(record, parameters, columns, self.longest)
            own = run.slopes[record.used]
            own = np.hstack([own[:, :-2], beside[k], own[:, -2:]]) if beside else own
            error, slope, _ = from_best_start(record, (run.q - record.q)[record.used], own)
            errors.append(error)
            slopes.append(slope)
        return errors, slopes


@dataclass(frozen=True)
class ServoFit:
    """Where an output-error fit ended.

    Attributes:
        parameters: Shape (COUNT,).
        cost: Of the robust least squares.
        start: Number of the start, from 0.
        evaluations: Roll-outs of all logs that were made, over all starts.
        costs: Cost that each start reached on whole logs; infinite for one that was left on intervals.
    """

    parameters: Array
    cost: float
    start: int
    evaluations: int
    costs: tuple[float, ...]


def output_error(
    problem: ServoProblem, starts: Sequence[Array], loss_scale: float = 0.0, effort: RefineEffort = THOROUGH
) -> ServoFit:
    """Return the parameters whose roll-outs are nearest to the measured positions.

    All starts are refined on intervals of SHOOTING_S that begin at the measurement (multiple shooting), the best of
    them on whole logs, those that ended alike as one. The loss is Huber's, smoothed (soft L1), so that failed reads
    and single slips count little.
    Then the logs are weighted by their own root mean square error, as maximum likelihood does where each log has a
    variance of its own: a log that the model cannot follow (a hot drive, a supply that sags) does not rule the others.

    Args:
        problem: Roll-outs and free parameters.
        starts: Parameters, each (COUNT,).
        effort: How long to look.
        loss_scale: Error in rad from which it counts by its size, not its square; 0: the median of the first start.

    Raises:
        SolverFailed: No start gives a finite roll-out.
    """
    if loss_scale <= 0.0:
        loss_scale = _loss_scale(problem, problem.full(starts[0][problem.places], starts[0]))
    pieces = replace(problem, records=_intervals(problem.records))
    coarse, evaluations = [], 0
    for start in starts if effort.go_on else ():
        values, cost, count = _refined(pieces, start, loss_scale, effort.few)
        evaluations += count
        coarse.append((cost, values))
    order = _distinct(coarse, problem)[: effort.go_on]
    costs = [np.inf] * len(starts)
    best: tuple[Array, float, int] | None = None
    tried = [(k, coarse[k][1]) for k in order] + [(0, starts[0])]
    for k, first in tried:
        values, cost, count = _refined(problem, first, loss_scale, effort.many)
        evaluations += count
        costs[k] = min(costs[k], cost)
        if np.isfinite(cost) and (best is None or cost < best[1]):
            best = (values, cost, k)
    if best is None:
        step = "check the drive law (error_gain, limit) and the robot model's inertias"
        raise SolverFailed("the output error of the servo", "no start gives a finite roll-out", step)
    is_weighted = len(problem.records) > 2
    passes = [(problem, effort.many)] * (effort.reweights if is_weighted else 0)
    passes += [(problem.finely, effort.finish)] if effort.finish else []
    for one, most in passes:
        own = one.started(best[0])
        weights = log_weights(own, best[0]) if is_weighted else None
        values, cost, count = _refined(own, best[0], loss_scale, most, weights)
        evaluations += count
        best = (values, cost, best[2])
    return ServoFit(best[0], best[1], best[2], evaluations, tuple(costs))


def refined(problem: ServoProblem, start: Array, most: int) -> Array:
    """Return the output error from a start that is near it, shape (COUNT,), by at most some evaluations."""
    weights = log_weights(problem, start) if len(problem.records) > 2 else None
    return _refined(problem, start, _NEAR * _loss_scale(problem, start), most, weights)[0]


def _loss_scale(problem: ServoProblem, parameters: Array) -> float:
    """Return the median absolute error in rad, from which the loss counts errors by their size."""
    sizes = np.abs(np.concatenate(problem.residuals(parameters)))
    return max(float(np.median(sizes[np.isfinite(sizes)])) if np.isfinite(sizes).any() else 0.1, 1e-4)


def _distinct(found: Sequence[tuple[float, Array]], problem: ServoProblem) -> list[int]:
    """Return the numbers of results (cost, parameters), the best first, without those that are like a better one."""
    kept: list[int] = []
    for k in np.argsort([cost for cost, _ in found]):
        own = found[k][1][problem.places]
        size = np.maximum(np.abs(own), problem.scales())
        if all(np.max(np.abs(own - found[j][1][problem.places]) / size) > _ALIKE for j in kept):
            kept.append(int(k))
    return kept


def log_weights(problem: ServoProblem, parameters: Array) -> Array:
    """Return the weight of each log by its root mean square error, shape (logs,), of mean 1."""
    weights = 1.0 / log_errors(problem, parameters)
    return weights / weights.mean()


def log_errors(problem: ServoProblem, parameters: Array) -> Array:
    """Return the root mean square error of each log in rad, shape (logs,).

    It is at least a share of their median, and of the encoder's step: where most logs hold the joint, and its reading
    does not change, the others would have next to no weight, and the search would end where it begins.
    """
    sizes = []
    for error in problem.residuals(parameters):
        sizes.append(float(np.sqrt(np.mean(np.minimum(np.nan_to_num(error**2, nan=10.0), 10.0)))))
    least = _LEAST_STEP * encoder_step(problem.records)
    return np.maximum(sizes, max(_LEAST_SHARE * float(np.median(sizes)), least, 1e-9))


def _intervals(records: Sequence[JointRecord]) -> tuple[JointRecord, ...]:
    parts = []
    for record in records:
        time = record.samples[:, 0]
        count = max(1, round((time[-1] - time[0]) / SHOOTING_S))
        cuts = np.searchsorted(time, np.linspace(time[0], time[-1], count + 1))
        cuts[-1] = len(time)
        parts += [record.part(int(a), int(b)) for a, b in pairwise(cuts) if b - a > 10]
    return tuple(parts)


def _refined(
    problem: ServoProblem, start: Array, loss_scale: float, most: int, log_weight: Array | None = None
) -> tuple[Array, float, int]:
    """Return parameters (COUNT,), cost and number of evaluations of one bounded search."""
    lower, upper = problem.bounds()
    weights = [1.0 / np.sqrt(max(int(record.used.sum()), 1)) for record in problem.records]
    if log_weight is not None:
        weights = [one * float(own) for one, own in zip(weights, log_weight, strict=True)]
    total = np.sqrt(sum(int(record.used.sum()) for record in problem.records) / len(problem.records))
    at: dict[bytes, tuple[Array, Array]] = {}

    def rows(values: Array) -> tuple[Array, Array]:
        key = values.tobytes()
        if key not in at:
            at.clear()
            errors, slopes = problem.errors(problem.full(values, start))
            scales = np.repeat(weights, [len(error) for error in errors]) * total
            error, slope = np.concatenate(errors) * scales, np.concatenate(slopes) * scales[:, None]
            if not (np.isfinite(error).all() and np.isfinite(slope).all()):
                error, slope = np.nan_to_num(error, nan=10.0, posinf=10.0, neginf=-10.0), np.nan_to_num(slope)
            at[key] = error, slope
        return at[key]

    first = np.clip(start[problem.places], lower, upper)
    room = 1e-6 * problem.scales()
    first = np.clip(first, lower + room, np.where(np.isfinite(upper), upper - room, upper))

    def slopes_at(values: Array) -> Array:
        return rows(values)[1]

    slope_of: Any = slopes_at  # the stubs of scipy know words only
    found = least_squares(
        lambda values: rows(values)[0],
        first,
        slope_of,
        bounds=(lower, upper),
        x_scale=problem.scales(),
        loss="soft_l1",
        f_scale=loss_scale,
        max_nfev=most,
        xtol=1e-6,
        ftol=1e-7,
    )
    return problem.full(found.x, start), float(found.cost), int(found.nfev)


def starts_from(linear: Array, friction: FrictionModel) -> list[Array]:
    """Return starts of the output error: the linear one, and ones with other friction, armature and delay."""
    found = [linear.copy()]
    for factors in _OTHER_STARTS:
        found.append(linear.copy())
        for name, factor in factors.items():
            found[-1][PLACE[name]] *= factor
    if "coulomb_stribeck" in friction.free:
        for one in found:
            one[PLACE["coulomb_stribeck"]] = 0.3 * one[PLACE["coulomb"]] + 1e-4
            one[PLACE["stribeck_velocity"]] = 0.5
            one[PLACE["stribeck_exponent"]] = 1.3
            if "load_motor_stribeck" in friction.free:
                one[PLACE["load_motor_stribeck"]] = one[PLACE["load_external_stribeck"]] = 0.05
    return found
