"""Maximum likelihood with coloured residuals of each joint."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from dynident.arrays import Array, IntArray
from dynident.errors import BadOption, SolverFailed
from dynident.identification.estimators.wls import WLS
from dynident.identification.problem.estimator import Estimator, Solution
from dynident.identification.problem.method_run import MethodRun
from dynident.identification.problem.problem import Problem, check_rank
from dynident.identification.residuals.bands import bands_of
from dynident.identification.residuals.colour import Colour, best_order, colour_of, unbroken_runs, with_white_part
from dynident.identification.residuals.coloured import Influence, uncertainty_of
from dynident.identification.residuals.covariance import correlation_factors
from dynident.identification.residuals.robust import FINEST
from dynident.identification.residuals.row_passes import RowPasses, Segment
from dynident.identification.residuals.stretches import stretches_of
from dynident.model.reduction import CHUNK, Triangle, absorb, least_squares, reduce
from dynident.plugins import bounded

#: Rows of a joint for each order that is tried: of fewer, a long autoregression is fitted to the noise itself.
ROWS_AN_ORDER = 20


@dataclass(frozen=True, kw_only=True)
class MaximumLikelihoodRun(MethodRun):
    """Of each joint: order, std of the white noise, correlation factor of the whitened residual."""

    orders: Sequence[int]
    innovation: Sequence[float]
    whitened_correlation: Sequence[float]


@dataclass(frozen=True)
class ML(Estimator):
    """Maximum likelihood with a variance and an autoregressive noise model of each joint.

    Both sides of the equation are whitened, fitted, and the autoregression renewed from the residuals until the fit
    settles: the iterated transformation of Cochrane and Orcutt 1949 with the exact beginning of each stretch (Beach and
    MacKinnon 1978), for order p. It is more precise than ``wls`` where noise is coloured, as filtered noise is. What
    the model leaves unexplained is coloured too; whitening then trusts the fast part of the motion more, and without a
    floor it undoes the filter. The covariance is that of the whitened rows, whose residual need not be
    white. Memory: the rows of the longest log.

    Attributes:
        floor: White part that is added to each colour, as a share of the residual's variance: no frequency is amplified
            by more than 1 / sqrt(floor).
        order: p; None: chosen for each joint by the Bayesian information criterion.
        longest: Highest order that is tried, one for every twenty rows of a joint at most.
        iterations: Fits at most.
        tolerance: Change of the fit, in its standard deviations, that ends the iteration.
    """

    floor: float = 0.1
    order: int | None = bounded(None, most=1_000)
    longest: int = bounded(20, most=1_000)
    iterations: int = bounded(50, most=10_000)
    tolerance: float = 1e-2

    def __post_init__(self) -> None:
        if not 0 <= self.floor < np.inf:
            raise BadOption("floor", self.floor, "give a share of the residual's variance, 0 or more, such as 0.1")
        if self.order is not None and self.order < 0:
            raise BadOption("order", self.order, "give 0 or more, or leave it to the criterion")
        if self.longest < 0:
            raise BadOption("longest", self.longest, "give 0 or more")
        self.check_steps(self.iterations, self.tolerance, 0.01)

    def solve(self, problem: Problem) -> Solution:
        """Return the estimate.

        Raises:
            PoorExcitation: The rows do not determine all base parameters.
            SolverFailed: Not settled after so many fits.
        """
        passes = RowPasses(problem)
        beta, orders = WLS().solve(problem).beta, None
        for done in range(1, self.iterations + 1):
            colours, orders = self._colours(passes, beta, orders)
            triangles = whitened_triangles(passes, colours)
            reduced = reduce(triangles, problem.base.count, np.ones(len(orders)))
            check_rank(reduced, problem.base)
            step = least_squares(reduced).beta - beta
            beta = beta + step
            if float(np.linalg.norm(reduced.r @ step) / np.sqrt(len(beta))) <= self.tolerance:
                return self._solution(passes, beta, self._colours(passes, beta, orders)[0], orders, done)
        raise SolverFailed(
            "the maximum likelihood fit",
            f"the fit did not settle in {self.iterations} rounds",
            "allow more iterations, or state a lower order",
        )

    def _colours(self, passes: RowPasses, beta: Array, orders: list[int] | None) -> tuple[list[Colour], list[int]]:
        """Return the colour of each joint's residual, of the given orders or, at first, of the best ones."""
        problem = passes.problem
        residual = passes.residuals(beta)
        free = max(1.0 - problem.base.count / max(int(problem.counts.sum()), 1), 1e-3)
        colours: list[Colour] = []
        found: list[int] = []
        for i, triangle in enumerate(problem.triangles):
            runs = [residual[run, i] / np.sqrt(free) for run in joint_runs(passes, i)]
            finest = FINEST * np.sqrt(triangle.torque_square / max(triangle.rows, 1))
            highest = min(self.longest, triangle.rows // ROWS_AN_ORDER) if self.order is None else self.order
            colour = colour_of(runs, highest if orders is None else orders[i], finest)
            if orders is None and self.order is None:
                colour = colour.cut(best_order(colour, triangle.rows))
            found.append(colour.order)
            colour = with_white_part(colour, self.floor, max(colour.order, self.longest))
            power = sum(float(np.sum(colour.whitened(run[None]) ** 2)) for run in runs)
            colours.append(colour.scaled(max(power / max(triangle.rows, 1), 1e-6)))
        return colours, found

    def _solution(
        self, passes: RowPasses, beta: Array, colours: list[Colour], orders: list[int], done: int
    ) -> Solution:
        problem = passes.problem
        residual = passes.residuals(beta)
        white = np.zeros_like(residual)
        for i, colour in enumerate(colours):
            for run in joint_runs(passes, i):
                white[run, i] = colour.whitened(residual[None, run, i])[0]
        size, joints = problem.base.count, len(colours)
        inverse = least_squares(reduce(whitened_triangles(passes, colours), size, np.ones(joints))).unscaled_covariance
        parts = bands_of(stretches_of(problem.logs, _whitened(passes, colours), passes.counting), passes.columns, size)
        found = uncertainty_of(parts, white, Influence(np.tile(inverse, (joints, 1, 1)), inverse, np.eye(joints)))
        innovation = np.array([np.sqrt(colour.variances[-1]) for colour in colours])
        run = MaximumLikelihoodRun(
            iterations=done,
            orders=orders,
            innovation=innovation.tolist(),
            whitened_correlation=correlation_factors(passes.by_log(white), problem.masks).tolist(),
        )
        return Solution(beta, 1.0 / innovation, covariance=found.covariance, degrees=found.degrees, run=run)


def _whitened(passes: RowPasses, colours: list[Colour]) -> Iterator[Segment]:
    """Yield the rows of each log, each joint's whitened by its colour, zero where they do not count."""
    runs = [joint_runs(passes, i) for i in range(len(colours))]
    for log in passes.logs():
        blocks = tuple(np.zeros_like(block) for block in log.blocks)
        for white, block, colour, own in zip(blocks, log.blocks, colours, runs, strict=True):
            for run in own:
                if log.samples.start <= run.start < log.samples.stop:
                    part = slice(run.start - log.samples.start, run.stop - log.samples.start)
                    white[:, part] = colour.whitened(block[:, part])
        yield Segment(log.samples, blocks)


def joint_runs(passes: RowPasses, joint: int) -> list[slice]:
    """Return the unbroken stretches of a joint's rows, over the samples of all logs."""
    found: list[slice] = []
    start = 0
    for log, mask in zip(passes.problem.logs, passes.problem.masks, strict=True):
        runs = unbroken_runs(log.keep, log.every, mask[:, joint])
        found += [slice(start + run.start, start + run.stop) for run in runs]
        start += len(log.keep)
    return found


def whitened_triangles(passes: RowPasses, colours: list[Colour]) -> tuple[Triangle, ...]:
    """Return the triangle of each joint's rows, whitened by its colour."""
    factors: list[Array] = [np.zeros((len(own) + 1,) * 2, order="F") for own in passes.columns]
    for log in _whitened(passes, colours):
        for i, white in enumerate(log.blocks):
            for first in range(0, white.shape[1], CHUNK):
                panel = np.ascontiguousarray(white[:, first : first + CHUNK])
                factors[i] = absorb(factors[i], panel.T)
    counts: IntArray = passes.problem.counts
    return tuple(
        Triangle(own, np.triu(factor), int(rows))
        for own, factor, rows in zip(passes.columns, factors, counts, strict=True)
    )
