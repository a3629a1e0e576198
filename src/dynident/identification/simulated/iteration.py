"""Estimators that simulate with the parameters of the moment: where they start, when they end, what they tell."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from dynident.arrays import Array
from dynident.errors import BadOption, SolverFailed
from dynident.identification.estimators.consistent import Consistent
from dynident.identification.problem.estimator import Estimator
from dynident.identification.problem.problem import Problem
from dynident.identification.residuals.instruments import Instruments, instruments
from dynident.identification.simulated.closed_loop import (
    ClosedLoop,
    SimulatingRun,
    closed_loop,
    possible_beta,
    simulated_logs,
)
from dynident.identification.simulated.course import LoopOptions
from dynident.model.reduction import least_squares
from dynident.plugins import bounded

#: Changes from round to round that fall by less than to this share will not come to an end in time.
SETTLING = 0.95

#: Change of a parameter, as a share of its natural size, that rounding and the integration leave.
ROUNDING = 1e-7


def start_of(problem: Problem) -> Array:
    """Return base parameters that can be simulated: those of the physically consistent fit, shape (b,)."""
    return np.array(Consistent(bodies="free").solve(problem).beta)


def started(
    problem: Problem, options: LoopOptions, unknown: str = "computed", as_instruments: bool = False
) -> tuple[ClosedLoop, Array]:
    """Return the closed loop of a problem and base parameters to start from, shape (b,).

    The start is the instrumental-variable estimate with the reference motion for instruments, which no noise of the
    measured states biases where the reference is commanded; or its mixture with the physically consistent fit where
    its mass matrix is indefinite.

    Args:
        problem: Robot, base parameters and logs.
        options: Controller and reference.
        unknown: What is fed forward where no gains are stated.
        as_instruments: See ``closed_loop``.

    Raises:
        BadOption: Gains for another number of joints.
        LogMismatch: A log without the positions or torques that are asked for.
    """
    possible = start_of(problem)
    loop = closed_loop(problem, options, possible, unknown, as_instruments)
    along = [np.stack([*course.reference, course.reference[0]], axis=1) for course in loop.courses]
    made = instruments(problem, simulated_logs(loop, tuple(along)))
    try:
        found = made.solve(1.0 / problem.joint_deviations(least_squares(problem.reduced()).beta))
    except SolverFailed:
        return loop, possible
    start, _ = possible_beta(loop, found, possible)
    if all(map(loop.is_exact, loop.courses)):  # no integration, so gains do not matter
        return loop, start
    return closed_loop(problem, options, start, unknown, as_instruments), start


@dataclass(frozen=True)
class Iterated(LoopOptions, Estimator):
    """An estimator that simulates the robot again and again, with the parameters of the moment.

    Attributes:
        iterations: Rounds of simulation, or Gauss-Newton steps, at most.
        tolerance: Largest change of a parameter, as a share of its standard deviation, that ends the iteration.
    """

    iterations: int = bounded(10, most=10_000)
    tolerance: float = 0.025

    def __post_init__(self) -> None:
        self.check()
        if self.iterations < 1:
            raise BadOption("iterations", self.iterations, "give 1 or more")
        if not 0 <= self.tolerance < np.inf:
            step = "give a share of a standard deviation, 0 or more, such as 0.025"
            raise BadOption("tolerance", self.tolerance, step)


def largest_change(problem: Problem, before: Array, after: Array, deviations: Array) -> float:
    """Return the largest change of a parameter in its standard deviations, rounding left aside."""
    norms = problem.reduced().column_norms
    size = np.linalg.norm(after * norms) / np.where(norms > 0, norms, 1.0)
    return float(np.max(np.abs(after - before) / (deviations + ROUNDING * size)))


@dataclass
class _Trace:
    """What happened step by step; lives inside one call."""

    changes: list[float] = field(default_factory=list)
    residuals: list[float] = field(default_factory=list)
    replaced: list[int] = field(default_factory=list)


@dataclass(frozen=True)
class Round:
    """One round of an iteration on simulated states.

    Attributes:
        beta: The new parameters, shape (b,).
        weights: Weight of each joint's rows in it, shape (n,).
        residual: Weighted root mean square residual of the rows.
        covariance: Of beta without correlation of the rows, shape (b, b): it measures the change.
    """

    beta: Array
    weights: Array
    residual: float
    covariance: Array


def fixed_point(
    loop: ClosedLoop,
    start: Array,
    step: Callable[[tuple[Array, ...], Array], Round],
    iterations: int,
    tolerance: float,
    solver: str,
) -> tuple[Round, SimulatingRun]:
    """Repeat: simulate with the parameters of the moment, estimate from the simulated states.

    Where an estimate cannot be simulated since its mass matrix is indefinite, the robot of the round is a mixture with
    the start, the nearest of a few that can be; the run counts such rounds. The last one may not be one of them.

    Args:
        loop: The closed loop.
        start: Parameters that can be simulated, shape (b,).
        step: From the simulated states and the parameters of the moment to the next ones.
        iterations: Rounds at most.
        tolerance: Largest change of a parameter, in its standard deviations, that ends the iteration.
        solver: Name for messages.

    Returns:
        The last round, and the run, whose trace is the root mean square residual after each round.

    Raises:
        SolverFailed: Not settled within the rounds, or settled where the robot cannot be simulated.
    """
    trace, beta, done = _Trace(), start, False
    found = Round(start, np.ones(loop.gains.shape[1]), np.nan, np.zeros((0, 0)))
    while not done and len(trace.changes) < iterations:
        simulated, is_own = possible_beta(loop, beta, start)
        found = step(loop.simulate(simulated), beta)
        change = largest_change(loop.problem, beta, found.beta, np.sqrt(np.diag(found.covariance)))
        trace.changes.append(change)
        trace.residuals.append(found.residual)
        trace.replaced.append(not is_own)
        beta = found.beta
        done = change <= tolerance and is_own
    if not done:
        _refuse(loop, solver, trace, tolerance)
    return found, loop.run(trace.residuals, trace.changes, len(trace.changes), mixed=int(sum(trace.replaced)))


def _refuse(loop: ClosedLoop, solver: str, trace: _Trace, tolerance: float) -> None:
    if trace.replaced[-1]:
        evidence = "the mass matrix of its parameters is not positive definite along the motion"
        stated = "check kp, kd and q_ref" if loop.options.kp is not None else "state commanded positions and gains"
        raise SolverFailed(solver, evidence, f"filter the log, {stated}, or use --estimator consistent")
    evidence = f"after {len(trace.changes)} rounds a parameter still moves by {trace.changes[-1]:.3g} of its deviation"
    raise SolverFailed(solver, evidence, after_changes(trace.changes, tolerance))


def after_changes(changes: Sequence[float], tolerance: float) -> str:
    """Return what to do after changes that did not fall below the tolerance: as many more as they need, or other data.

    Args:
        changes: Of each round, in standard deviations.
        tolerance: That ends the iteration.
    """
    last = list(changes[-3:])
    pace = (last[-1] / last[0]) ** (1.0 / (len(last) - 1)) if len(last) > 1 else 0.0
    if pace >= SETTLING:
        told = ", ".join(f"{change:.3g}" for change in last)
        better = "check kp, kd and q_ref, filter the log at a lower frequency, or use --estimator wls"
        return f"its changes do not fall ({told}), so that more iterations are of no use: {better}"
    count = f" (about {len(changes) + math.ceil(math.log(tolerance / last[-1], pace))})" if pace * tolerance > 0 else ""
    return f"give more iterations{count}, or a tolerance above {tolerance:g}"


def least_squares_round(simulated: Problem, beta: Array) -> Round:
    """Return weighted least squares on rows of simulated states, weights from the residuals at ``beta``."""
    weights = 1.0 / simulated.joint_deviations(beta)
    reduced = simulated.reduced(weights)
    found = least_squares(reduced)
    residual = np.sqrt(reduced.residual_square(found.beta) / max(reduced.rows, 1))
    return Round(found.beta, weights, float(residual), found.unscaled_covariance)


def instrument_round(made: Instruments, beta: Array) -> Round:
    """Return the instrumental-variable estimate, weights from the residuals at ``beta``."""
    problem = made.problem
    weights = 1.0 / problem.joint_deviations(beta)
    found = made.solve(weights)
    residual = np.sqrt(problem.reduced(weights).residual_square(found) / max(int(problem.counts.sum()), 1))
    spread = made.stacked(weights)[: problem.base.count, : problem.base.count] @ made.influence(weights).T
    return Round(found, weights, float(residual), spread.T @ spread)  # of residuals of one, all independent
