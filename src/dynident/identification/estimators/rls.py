"""Recursive least squares with forgetting."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from dynident.arrays import Array, IntArray
from dynident.errors import BadOption
from dynident.identification.estimators.wls import WLS
from dynident.identification.problem.estimator import Estimator, Solution
from dynident.identification.problem.method_run import MethodRun
from dynident.identification.problem.problem import Problem
from dynident.identification.problem.regressor_stream import rows_in_time
from dynident.identification.recursive import RecursiveLeastSquares
from dynident.identification.residuals.bands import bands_beside
from dynident.identification.residuals.coloured import Influence, Uncertainty, uncertainty_of
from dynident.identification.residuals.row_passes import RowPasses
from dynident.model.reduction import least_squares

#: Rows of each joint that are taken at a time.
BATCH = 256

#: Points of the course of the parameters in the run.
POINTS = 50


@dataclass(frozen=True, kw_only=True)
class RecursiveRun(MethodRun):
    """``memory``: rows a joint that count; None for all."""

    memory: float | None


@dataclass(frozen=True)
class RLS(Estimator):
    """Recursive least squares over samples in order of time, with exponential forgetting (Ljung 1999, (11.16)).

    With ``forgetting`` 1 it is least squares, with the joints' weights of weighted least squares; below 1 the estimate
    is that of the end of the last log, for drives that warm up; its covariance counts each row by what the memory has
    left of it, for noise alone, not for what the parameters have moved. The run has the course of the parameters. To
    take rows as they come use ``dynident.identification.recursive.RecursiveLeastSquares``.

    Attributes:
        forgetting: Weight of a sample relative to the next one; the memory is about 1 / (1 - forgetting) rows a joint.
        weighted: Whether each joint's rows are divided by its residual standard deviation.
    """

    forgetting: float = 1.0
    weighted: bool = True

    def __post_init__(self) -> None:
        if not 0 < self.forgetting <= 1:
            raise BadOption("forgetting", self.forgetting, "give a number above 0, at most 1, such as 0.999")

    def solve(self, problem: Problem) -> Solution:
        """Take all samples in order."""
        size = problem.base.count
        whole = WLS().solve(problem)
        weights = whole.weights if self.weighted else np.ones(len(problem.triangles))
        state = RecursiveLeastSquares(size, self.forgetting)
        seen: list[tuple[int, Array, float]] = []
        every = max(1, problem.samples // POINTS)
        for matrix, torque, joint, age in _batches(problem, min(BATCH, every)):
            state.update(matrix * weights[joint, None], torque * weights[joint], age)
            if not seen or state.samples >= seen[-1][0] + every or state.samples == problem.samples:
                seen.append((state.samples, state.estimate(), state.reduced.rest))
        run = self._run(problem, seen)
        beta = state.estimate()
        if self.forgetting == 1:
            return Solution(beta, weights, run=run)
        sure = self._uncertainty(problem, whole, state.covariance(), weights)
        return Solution(beta, weights, covariance=sure.covariance, degrees=sure.degrees, run=run)

    def _uncertainty(self, problem: Problem, whole: Solution, inverse: Array, weights: Array) -> Uncertainty:
        """Return the covariance of a memory that fades: rows times what is left of them, noise of the fit of all."""
        passes = RowPasses(problem)
        left = self.forgetting ** np.arange(problem.samples - 1, -1, -1.0)
        residual = passes.residuals(whole.beta)
        free = least_squares(problem.reduced(whole.weights)).unscaled_covariance
        plain = Influence.of_rows(problem, residual, free, whole.weights**2)
        influence = replace(plain, gains=np.concatenate([np.zeros_like(plain.gains), plain.gains], axis=2))
        asked = (weights**2)[:, None, None] * np.hstack([inverse, np.zeros_like(inverse)])
        return uncertainty_of(bands_beside(passes, left), residual, influence, asked)

    def _run(self, problem: Problem, seen: list[tuple[int, Array, float]]) -> RecursiveRun:
        step = problem.logs[0].every / problem.logs[0].log.rate
        joints = len(problem.triangles)
        counts = [self._memory(samples) * joints for samples, _, _ in seen]
        return RecursiveRun(
            trace=[float(np.sqrt(rest / count)) for count, (_, _, rest) in zip(counts, seen, strict=True)],
            times=[samples * step for samples, _, _ in seen],
            course=[beta.tolist() for _, beta, _ in seen],
            memory=None if self.forgetting == 1 else 1.0 / (1.0 - self.forgetting),
        )

    def _memory(self, samples: int) -> float:
        if self.forgetting == 1:
            return float(samples)
        return (1.0 - self.forgetting**samples) / (1.0 - self.forgetting)


def _batches(problem: Problem, size: int) -> Iterator[tuple[Array, Array, IntArray, IntArray]]:
    """Yield rows in order of time: matrix (m, b), torque (m,), joint (m,) and age (m,) within the batch."""
    regressor = problem.regressor
    joints = len(problem.triangles)
    for log, mask in zip(problem.logs, problem.masks, strict=True):
        for _, matrix, torque in rows_in_time(regressor, log, mask, size):
            count = len(matrix)
            age: IntArray = np.repeat(np.arange(count)[::-1], joints)
            joint: IntArray = np.tile(np.arange(joints), count)
            yield matrix.reshape(-1, problem.base.count), torque.ravel(), joint, age
