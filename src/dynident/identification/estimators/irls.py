"""Generalised least squares with the covariance of the joints, outliers out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from dynident.arrays import Array, BoolArray
from dynident.errors import BadOption, SolverFailed
from dynident.identification.problem.estimator import Estimator, Solution
from dynident.identification.problem.method_run import MethodRun
from dynident.identification.problem.problem import Problem, check_rank
from dynident.identification.residuals.bands import bands
from dynident.identification.residuals.coloured import Influence, uncertainty_of
from dynident.identification.residuals.covariance import sandwich
from dynident.identification.residuals.joint_covariance import JointWhitening, joint_covariance
from dynident.identification.residuals.robust import FINEST, huber_loss, robust_fit, robust_scales
from dynident.identification.residuals.row_passes import RowPasses
from dynident.model.reduction import least_squares, reduce
from dynident.plugins import bounded

#: Fits after which a row that is left out stays out: some at the threshold would come and go for ever.
COMING_AND_GOING = 20

#: Samples for each base parameter, at least: of fewer, the fit makes a combination of the joints' residuals all but
#: nothing, the covariance has it so, and the fit then follows that combination alone.
SAMPLES_A_PARAMETER = 2


@dataclass(frozen=True, kw_only=True)
class ReweightedRun(MethodRun):
    """``correlation``: of the joints' residuals, shape (n, n)."""

    correlation: Sequence[Sequence[float]]


@dataclass(frozen=True)
class IRLS(Estimator):
    """Iteratively reweighted least squares with the full covariance of the joints' residuals and outlier weights.

    After Han, Wu, Liu and Xiong 2020, who iterate the covariance L (n x n) of the residuals of a sample and the fit
    with L^-1 x I inside, the weights outside; here each fit renews both, which settles at the same point. ``hard``
    leaves out rows beyond the threshold, measured in robust scales of their joint, and the other joints of the sample
    keep their own covariance. ``student`` gives each sample the weight (f + n) / (f + d^2) with its squared Mahalanobis
    distance d^2: maximum likelihood for a multivariate t distribution (Lange, Little and Taylor 1989). The first scales
    are those of Huber's fit.

    Attributes:
        weights: hard: 0 or 1 for each row; student: smooth, for each sample; none: only the joint covariance.
        threshold: Residual, in scales of the joint, beyond which ``hard`` leaves a row out.
        freedom: f, degrees of freedom of ``student``; fewer are more robust.
        iterations: Fits at most.
        tolerance: Change of the fit, in its standard deviations, that ends the iterations.
    """

    weights: Literal["hard", "student", "none"] = "hard"
    threshold: float = 4.0
    freedom: float = 4.0
    iterations: int = bounded(200, most=10_000)
    tolerance: float = 1e-2

    def __post_init__(self) -> None:
        if self.weights not in ("hard", "student", "none"):
            raise BadOption("weights", self.weights, "choose hard, student or none")
        if not 2.5 <= self.threshold < np.inf:
            raise BadOption("threshold", self.threshold, "give a number of scales, 2.5 or more, such as 4")
        if not 1 <= self.freedom < np.inf:
            raise BadOption("freedom", self.freedom, "give 1 or more, such as 4")
        self.check_steps(self.iterations, self.tolerance, 0.01)

    def solve(self, problem: Problem) -> Solution:
        """Return the estimate.

        Raises:
            PoorExcitation: The rows that count do not determine all base parameters.
            SolverFailed: Not settled after so many fits, or fewer than two samples that count for each base parameter.
        """
        passes = RowPasses(problem)
        start = robust_fit(passes, huber_loss(1.345), least_squares(problem.reduced()).beta, None, 200, 1e-2)
        beta, covariance, done, change = start.beta, np.diag(start.scale**2), 0, np.inf
        before = passes.counting
        while done < self.iterations:
            keep, size = self._counting(passes, beta, covariance)
            keep = keep & before if done >= COMING_AND_GOING else keep
            before = keep
            white = self._whitening(passes, beta, keep, size)
            reduced = reduce(white.triangles(np.sqrt(size)), problem.base.count, np.ones(len(start.scale)))
            check_rank(reduced, problem.base)
            step = least_squares(reduced).beta - beta
            beta, covariance, done = beta + step, white.covariance, done + 1
            change = float(np.linalg.norm(reduced.r @ step) / np.sqrt(len(beta)))
            if change <= self.tolerance:
                return self._solution(passes, beta, JointWhitening(passes, covariance, keep), size, done)
        raise SolverFailed(
            "the reweighted fit",
            f"after {done} fits it still changes by {change:.2g} of its standard deviations",
            "allow more iterations, use weights: student, or huber",
        )

    def _counting(self, passes: RowPasses, beta: Array, covariance: Array) -> tuple[BoolArray, Array]:
        """Return which rows count, shape (N, n), and the weight of each sample, shape (N,)."""
        counting, residual = passes.counting, passes.residuals(beta)
        keep, size = counting, np.ones(len(residual))
        if self.weights == "hard":
            keep = counting & (np.abs(residual) <= self.threshold * robust_scales(passes.problem, residual, counting))
        if self.weights == "student":
            square = np.sum(JointWhitening(passes, covariance, counting).residuals(residual) ** 2, axis=1)
            size = (self.freedom + counting.sum(axis=1)) / (self.freedom + square)
        return keep, size

    def _whitening(self, passes: RowPasses, beta: Array, keep: BoolArray, size: Array) -> JointWhitening:
        problem, count, samples = passes.problem, passes.problem.base.count, int(np.count_nonzero(keep.any(axis=1)))
        if samples < SAMPLES_A_PARAMETER * count:
            evidence = f"{samples} samples are too few for the covariance of the joints beside {count} parameters"
            raise SolverFailed("the reweighted fit", evidence, "record a longer log, or use huber")
        torque = np.array([np.sqrt(t.torque_square / max(t.rows, 1)) for t in problem.triangles])
        free = max(1.0 - count / max(int(keep.sum()), 1), 1e-3)
        floor = np.maximum(FINEST * torque, 1e-300)
        return JointWhitening(passes, joint_covariance(passes.residuals(beta), keep, size, floor, free), keep)

    def _solution(self, passes: RowPasses, beta: Array, white: JointWhitening, size: Array, done: int) -> Solution:
        problem, keep = passes.problem, white.counting
        rows = np.maximum(keep.sum(axis=0), 1)
        plain = white.residuals(passes.residuals(beta))
        score = plain * size[:, None]
        slope = 1.0
        if self.weights == "student":
            joints = np.maximum(keep.sum(axis=1), 1)
            square = np.sum(plain**2, axis=1)
            slope = float(np.mean(size - 2 * (self.freedom + joints) * square / joints / (self.freedom + square) ** 2))
        free = max(1.0 - problem.base.count / max(int(keep.sum()), 1), 1e-3)
        spread = np.sum(score**2, axis=0) / rows / free
        triangles, count = white.triangles(np.ones(len(size))), problem.base.count
        bread = reduce(triangles, count, np.full(len(rows), np.sqrt(slope)))
        plain = sandwich(bread, reduce(triangles, count, np.sqrt(spread)))
        gains = np.tile(least_squares(bread).unscaled_covariance, (len(rows), 1, 1))
        influence = Influence(gains, plain, slope * np.linalg.inv(white.covariance))
        found = uncertainty_of(bands(passes), white.turned_back(score), influence)
        deviations = np.sqrt(np.diag(white.covariance))
        run = ReweightedRun(
            iterations=done,
            rejected=(passes.counting & ~keep).sum(axis=0).tolist(),
            down_weighted=(passes.counting & (~keep | (size < 0.5)[:, None])).sum(axis=0).tolist(),
            correlation=(white.covariance / deviations / deviations[:, None]).tolist(),
        )
        return Solution(beta, 1.0 / deviations, covariance=found.covariance, degrees=found.degrees, run=run)
