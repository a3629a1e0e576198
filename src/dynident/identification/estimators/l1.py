"""Least absolute residuals, proven optimal."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import norm

from dynident.arrays import Array, IntArray
from dynident.errors import SolverFailed
from dynident.identification.problem.estimator import Estimator, Solution
from dynident.identification.problem.method_run import MethodRun
from dynident.identification.problem.problem import Problem, check_rank
from dynident.identification.residuals.bands import bands
from dynident.identification.residuals.coloured import Influence, Uncertainty, uncertainty_of
from dynident.identification.residuals.covariance import FEWEST_FREE, residual_factors
from dynident.identification.residuals.robust import FINEST
from dynident.identification.residuals.row_passes import RowPasses
from dynident.identification.search.landscape import absolute_landscape
from dynident.identification.search.least_absolute import LeastAbsolute, least_absolute
from dynident.model.reduction import least_squares
from dynident.plugins import bounded

#: Width of the first box, in the size that is proven to hold the optimum; wider ones follow only where it is touched.
WIDTHS = (1e-2, 1.0)


@dataclass(frozen=True)
class L1(Estimator):
    """Least absolute deviations (median regression), sum_i |residual_i| / s of the joint (Laplace 1799).

    Maximum likelihood for noise of Laplace's density, with s the mean absolute residual of each joint, renewed until
    it settles. Every solution is certified: no other is smaller by more than a millionth (see ``gap``). On normal data
    its variance is pi / 2 times that of least squares (Koenker and Bassett 1978). All rows are held in memory, 8 bytes
    times rows times base parameters.

    Attributes:
        iterations: How often the scales of the joints are renewed at most.
        tolerance: Relative change of the scales that ends the iteration.
    """

    iterations: int = bounded(20, most=10_000)
    tolerance: float = 3e-2

    def __post_init__(self) -> None:
        self.check_steps(self.iterations, self.tolerance, 0.03)

    def solve(self, problem: Problem) -> Solution:
        """Return the estimate.

        Raises:
            PoorExcitation: The rows do not determine all base parameters.
            SolverFailed: The optimum could not be certified.
        """
        land = absolute_landscape(problem, np.ones(len(problem.triangles)))
        rows: IntArray = np.repeat(np.arange(len(problem.triangles)), np.diff(land.edges))
        start = least_squares(problem.reduced()).beta
        scale = _scales(problem, np.sqrt(problem.residual_squares(start) * problem.counts))
        found, done, settled = None, 0, False
        while found is None or (not settled and done < self.iterations):
            done += 1
            found = _optimum(problem, land.columns, land.target, rows, scale)
            renewed = _scales(problem, land.sums(land.target - found.beta @ land.columns))
            settled = bool(np.all(np.abs(renewed - scale) <= self.tolerance * scale)) or len(scale) == 1
            scale = renewed
        run = MethodRun(
            iterations=done,
            objective=found.objective / len(rows),
            lower_bound=found.lower_bound / len(rows),
            gap=found.gap,
            scale=scale.tolist(),
        )
        beta = np.array(found.beta)
        sure = _uncertainty(problem, beta, 1.0 / scale)
        return Solution(beta, 1.0 / scale, covariance=sure.covariance, degrees=sure.degrees, run=run)


def _scales(problem: Problem, sums: Array) -> Array:
    """Return the mean absolute residual of each joint from the sums, shape (n,), never zero."""
    torque = np.array([np.sqrt(t.torque_square / max(t.rows, 1)) for t in problem.triangles])
    free = max(1.0 - problem.base.count / max(int(problem.counts.sum()), 1), 1e-3)
    return np.maximum(sums / np.maximum(problem.counts, 1) / np.sqrt(free), np.maximum(FINEST * torque, 1e-300))


def _optimum(problem: Problem, columns: Array, target: Array, rows: IntArray, scale: Array) -> LeastAbsolute:
    """Return the certified minimum over all beta.

    A minimiser is no worse than the least squares fit, so W (beta - fit) is at most twice the sum F of its absolute
    residuals long: every minimiser lies within 2 F sqrt((W'W)^-1_jj) of the fit. A much narrower box nearly always
    holds it; an optimum inside that box is one outside too, since the criterion is convex.
    """
    reduced = problem.reduced(1.0 / scale)
    check_rank(reduced, problem.base)
    fit, weights = least_squares(reduced), (1.0 / scale)[rows]
    total = float(weights @ np.abs(target - fit.beta @ columns))
    proven = 2.0 * total * np.sqrt(np.diag(fit.unscaled_covariance))
    proven = np.maximum(proven, 1e-9 * np.linalg.norm(fit.beta * reduced.column_norms) / reduced.column_norms)
    for width in WIDTHS:
        half = width * proven
        found = least_absolute(columns.T, target, weights, fit.beta - half, fit.beta + half)
        if np.all(np.abs(found.beta - fit.beta) < 0.99 * half):
            return found
    raise SolverFailed(
        "the least absolute residual fit",
        "the optimum lies on the bound of a box that is proven to hold it",
        "check the units of the log, or use huber",
    )


def _uncertainty(problem: Problem, beta: Array, weights: Array) -> Uncertainty:
    """Return the covariance: curvature 2 f(0) w of each joint's rows, scores w times signs, taken by frequency.

    f(0) is the density of the residuals at zero (Koenker and Bassett 1978), from the quantiles around the median at
    the distance of Hall and Sheather 1988; the fit makes residuals smaller by what it takes of the independent rows.
    """
    passes = RowPasses(problem)
    residual, keep = passes.residuals(beta), passes.counting
    independent = problem.counts / residual_factors(passes, beta)
    free = np.sqrt(max(1.0 - problem.base.count / float(np.sum(independent)), FEWEST_FREE))
    pairs = zip(weights, independent, strict=True)
    density = free * np.array([_density(residual[keep[:, i], i], 1.0 / w, rows) for i, (w, rows) in enumerate(pairs)])
    signs = np.where(keep, np.sign(residual), 0.0)
    inverse = least_squares(problem.reduced(np.sqrt(2.0 * density * weights))).unscaled_covariance
    influence = Influence.of_rows(problem, signs, inverse, weights, 2.0 * density)
    return uncertainty_of(bands(passes), signs, influence)


def _density(residual: Array, scale: float, count: float) -> float:
    """Return the density at zero of residuals; that of Laplace's law of the given scale where there are too few.

    Args:
        residual: Shape (N,).
        scale: Mean absolute residual.
        count: How many independent ones they are worth.
    """
    if count < 20:
        return 0.5 / scale
    z = float(norm.ppf(0.975))
    reach = count ** (-1 / 3) * z ** (2 / 3) * (1.5 * float(norm.pdf(0.0)) ** 2) ** (1 / 3)
    reach = min(reach, 0.4)
    low, high = np.quantile(residual, [0.5 - reach, 0.5 + reach])
    return 2.0 * reach / max(float(high - low), 1e-6 * scale)
