"""Output error of a simulated closed loop: Gauss-Newton with the exact derivatives of the simulation."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from dynident.arrays import Array, BoolArray
from dynident.errors import LogMismatch, NotConsistent, SolverFailed
from dynident.excitation.design.observation import Observation
from dynident.identification.consistency.consistent_fit import consistent_fit, scale_of
from dynident.identification.estimators.consistent import Consistent
from dynident.identification.residuals.bands import bands_of
from dynident.identification.residuals.coloured import Influence, Uncertainty, uncertainty_of
from dynident.identification.residuals.row_passes import Segment
from dynident.identification.residuals.stretches import stretches_of
from dynident.identification.simulated.closed_loop import ClosedLoop, SimulatingRun
from dynident.identification.simulated.iteration import after_changes, largest_change
from dynident.identification.simulated.sensitivities import sensitivities
from dynident.model.reduction import LeastSquares, Reduced, Triangle, least_squares, reduce, triangle_of

#: Shares of a Gauss-Newton step that are tried until the error falls.
SHARES = (1.0, 0.5, 0.25, 0.125, 0.0625, 0.03125)


@dataclass(frozen=True)
class OutputErrorFit:
    """Where an output-error method ended.

    Attributes:
        beta: Base parameters, shape (b,).
        weights: Of each joint's errors, shape (n,), in 1 / N m for torques, 1 / rad for positions (1 / N, 1 / m).
        covariance: Of beta, shape (b, b).
        degrees: Degrees of freedom of its variances, shape (b,).
        run: With the weighted root mean square error after each step as trace.
    """

    beta: Array
    weights: Array
    covariance: Array
    degrees: Array
    run: SimulatingRun


@dataclass(frozen=True)
class _Rows:
    """Errors (N, n) of each log over its kept rows, and their derivative (N, n, b) where it was asked for."""

    errors: tuple[Array, ...]
    slopes: tuple[Array, ...]


@dataclass(frozen=True)
class OutputErrorTask:
    """What a fit of the output error is of: the loop, the signal that is compared, and the rows that count."""

    loop: ClosedLoop
    of: str
    masks: tuple[BoolArray, ...]

    def at(self, beta: Array) -> tuple[Array, ...]:
        """Return measured less simulated samples of each log, filtered alike, shape (N, n) each."""
        return tuple(self._error(i, rows) for i, rows in enumerate(self.loop.simulate(beta)))

    def with_slopes(self, beta: Array) -> _Rows:
        """Return also the derivative of the simulated rows, (N, n, b) each: 8 N n b bytes are held."""
        observation = Observation(self.loop.problem.model, self.loop.problem.base)
        errors, slopes = [], []
        for i, course in enumerate(self.loop.courses):
            rows, found = sensitivities(self.loop, course, beta, self.of, observation)
            errors.append(self._error(i, rows))
            flat = course.log.smooth(found.reshape(len(found), -1).T).T[course.log.keep]
            slopes.append(flat.reshape(len(flat), *found.shape[1:]))
        return _Rows(tuple(errors), tuple(slopes))

    def _error(self, log: int, rows: Array) -> Array:
        prepared = self.loop.courses[log].log
        if self.of == "q":
            return prepared.smooth((prepared.log.q - rows[:, 0]).T).T[prepared.keep]
        if prepared.log.torque is None:
            raise LogMismatch(prepared.log.name, "no torques", "map torque columns in the case file")
        return (prepared.log.torque - prepared.smooth(rows[:, 3].T).T)[prepared.keep]

    def squares(self, errors: tuple[Array, ...]) -> Array:
        """Return the sum of squares of each joint, shape (n,)."""
        found = zip(errors, self.masks, strict=True)
        return np.sum([np.sum(np.where(mask, error, 0.0) ** 2, axis=0) for error, mask in found], axis=0)

    def triangles(self, rows: _Rows) -> tuple[Triangle, ...]:
        """Return the triangle of [slopes, errors] of each joint."""
        made = []
        for joint in range(len(self.masks[0][0])):
            parts = [
                np.column_stack([slope[mask[:, joint], joint], error[mask[:, joint], joint]])
                for slope, error, mask in zip(rows.slopes, rows.errors, self.masks, strict=True)
            ]
            stacked = np.concatenate(parts)
            made.append(Triangle(np.arange(stacked.shape[1] - 1), triangle_of(stacked), len(stacked)))
        return tuple(made)

    def uncertainty(self, rows: _Rows, weights: Array, fit: LeastSquares) -> Uncertainty:
        """Return the covariance of the step with coloured errors."""
        size, joints = len(fit.beta), len(weights)
        logs = tuple(course.log for course in self.loop.courses)
        mask = np.concatenate(self.masks)
        errors = np.where(mask, np.concatenate(rows.errors), 0.0)
        deviations = np.sqrt(np.sum(errors**2, axis=0) / np.maximum(mask.sum(axis=0), 1))
        meat = reduce(self.triangles(rows), size, weights**2 * deviations).r @ fit.unscaled_covariance
        gains = (weights**2)[:, None, None] * fit.unscaled_covariance
        found = bands_of(stretches_of(logs, _segments(rows), mask), [np.arange(size)] * joints, size)
        return uncertainty_of(found, errors, Influence(gains, meat.T @ meat, np.eye(joints)))


def _segments(rows: _Rows) -> Iterator[Segment]:
    """Yield the derivatives of each log as rows of each joint, with the errors last."""
    start = 0
    for slope, error in zip(rows.slopes, rows.errors, strict=True):
        blocks = tuple(np.vstack([slope[:, i].T, error[:, i]]) for i in range(error.shape[1]))
        yield Segment(slice(start, start + len(error)), blocks)
        start += len(error)


def output_error(
    loop: ClosedLoop, start: Array, of: str, iterations: int, tolerance: float, solver: str
) -> OutputErrorFit:
    """Return the parameters whose simulation comes nearest to the measured torques or positions.

    Gauss-Newton steps, shortened until the weighted error falls and the mass matrix stays positive definite; the weight
    of each joint is renewed from its errors at every step. A step that would end at a robot that cannot be simulated
    goes to the best possible robot in its place.

    Args:
        loop: The closed loop.
        start: Parameters that can be simulated, shape (b,).
        of: ``torque`` or ``q``.
        iterations: Steps at most.
        tolerance: Largest change of a parameter, in its standard deviations, that ends the search.
        solver: Name for messages.

    Raises:
        SolverFailed: No step lowers the error, or not settled within the steps.
    """
    masks = loop.settled(start)
    task = OutputErrorTask(loop, of, masks)
    counts = np.maximum(np.sum([mask.sum(axis=0) for mask in masks], axis=0), 1)
    beta, trace, changes, simulations, bounded = start, [], [], 0, 0
    while len(changes) < iterations:
        rows = task.with_slopes(beta)
        scale = np.sqrt(np.mean([np.mean(error**2) for error in rows.errors]))
        weights = 1.0 / np.maximum(np.sqrt(task.squares(rows.errors) / counts), 1e-12 * scale + 1e-300)
        reduced = reduce(task.triangles(rows), len(beta), weights)
        fit = least_squares(reduced)
        step, is_free = consistent_step(loop, beta, reduced, fit)
        bounded += not is_free
        moved, error, tried = _stepped(task, beta, step, reduced, weights, solver)
        simulations += tried + 1
        deviations = np.sqrt(np.diag(fit.unscaled_covariance))
        changes.append(largest_change(loop.problem, beta, moved, deviations))
        trace.append(float(np.sqrt(error / counts.sum())))
        beta = moved
        if changes[-1] <= tolerance:
            sure = task.uncertainty(rows, weights, fit)
            run = loop.run(trace, changes, simulations, bounded=bounded)
            return OutputErrorFit(beta, weights, sure.covariance, sure.degrees, run)
    evidence = f"after {iterations} steps a parameter still moves by {changes[-1]:.3g} of its deviation"
    raise SolverFailed(solver, evidence, after_changes(changes, tolerance))


def consistent_step(loop: ClosedLoop, beta: Array, reduced: Reduced, fit: LeastSquares) -> tuple[Array, bool]:
    """Return the step of Gauss and Newton (b,), and whether it is free.

    Where the free step ends at a robot that cannot be simulated, it is that to the possible robot with the least error
    of the same linearised problem.
    """
    try:
        loop.check(beta + fit.beta)
    except NotConsistent:
        pass
    else:
        return fit.beta, True
    problem, how = loop.problem, Consistent(bodies="free")
    shifted = replace(reduced, z=reduced.z + reduced.r @ beta)
    found = consistent_fit(
        problem.model, problem.base, shifted, scale_of(problem), how.pull, how.margin, how.metric, problem.constraints
    )
    return problem.base.from_standard(found.theta) - beta, False


def _stepped(
    task: OutputErrorTask, beta: Array, step: Array, reduced: Reduced, weights: Array, solver: str
) -> tuple[Array, float, int]:
    """Return the parameters after a step that lowers the error, the weighted squares there, and the simulations."""
    before = reduced.residual_square(np.zeros(len(beta)))
    gain = before - reduced.residual_square(step)
    for tried, share in enumerate(SHARES, start=1):
        moved = beta + share * step
        try:
            errors = task.at(moved)
        except (NotConsistent, SolverFailed):
            continue
        after = float(np.sum(weights**2 * task.squares(errors)))
        if after < before:
            return moved, after, tried
        if gain <= 1e-6 * before:  # as low as it gets: the step is rounding
            return beta, before, tried
    evidence = f"no part of a step lowers the error ({np.sqrt(before / max(reduced.rows, 1)):.4g} of its deviation)"
    advice = "start nearer: filter the log, or check gains and commanded positions"
    raise SolverFailed(solver, evidence, advice)
