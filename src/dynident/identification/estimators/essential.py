"""Essential parameters: those that the data need."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import f as fisher

from dynident.arrays import Array, BoolArray, IntArray
from dynident.errors import BadOption
from dynident.identification.problem.estimator import Estimator, Solution
from dynident.identification.problem.method_run import MethodRun
from dynident.identification.problem.problem import Problem
from dynident.identification.residuals.coloured import Uncertainty, spectral_uncertainty
from dynident.identification.residuals.covariance import residual_factors, sandwich
from dynident.identification.residuals.row_passes import RowPasses
from dynident.model.reduction import Triangle


@dataclass(frozen=True)
class Dropped:
    """A base parameter that went, with the value and standard deviation that it had then."""

    name: str
    unit: str
    value: float
    std: float


@dataclass(frozen=True, kw_only=True)
class EssentialRun(MethodRun):
    """What was dropped, number kept, p-value of the Wald test of the dropped, std of the kept without them."""

    dropped: Sequence[Dropped]
    kept: int
    significance: float | None
    conditional_std: Sequence[float]


@dataclass(frozen=True)
class Essential(Estimator):
    """Essential parameters: backward elimination of base parameters that are not significant, the worst first.

    After Pham and Gautier 1991: the parameter with the largest relative standard deviation goes while that is above
    the limit, and the others are found anew. It goes only while the data do not object: the Wald test that all dropped
    parameters are zero, which for least squares is the F-test of the rise of the error, must not reject at the stated
    level, with rows that hang together counted for what they are worth, and the weighted residual must not have risen
    by more than the stated share. A dropped parameter has the value zero. The covariance
    is that of the fit of all parameters plus the square of what the choice has moved each by, so that it covers what
    the choice has biased; ``conditional_std`` are the deviations that would hold were the dropped parameters zero.

    Attributes:
        of: Estimator of base parameters that is asked, with its default options.
        limit: Relative standard deviation above which a parameter may go.
        level: Level of the test; 0.05 objects to one true zero in twenty.
        rise: Share by which the weighted residual norm may rise at most.
    """

    of: str = "wls"
    limit: float = 0.3
    level: float = 0.05
    rise: float = 0.01

    def __post_init__(self) -> None:
        from dynident.identification.estimators import ESTIMATORS

        if self.of not in ESTIMATORS.names() or self.of == "essential":
            raise BadOption("of", self.of, "give the name of another estimator, such as wls or huber")
        if not 0 < self.limit < np.inf:
            raise BadOption("limit", self.limit, "give a relative standard deviation above 0, such as 0.3")
        if not 0 < self.level < 1:
            raise BadOption("level", self.level, "give a level between 0 and 1, such as 0.05")
        if not 0 < self.rise < np.inf:
            raise BadOption("rise", self.rise, "give a share above 0, such as 0.01")

    def solve(self, problem: Problem) -> Solution:
        """Return the estimate.

        Raises:
            BadOption: The other estimator finds standard parameters, which cannot be dropped.
        """
        from dynident.identification.estimators import ESTIMATORS

        part = ESTIMATORS.make(self.of)
        full = self._asked(part, problem)
        passes = RowPasses(problem)
        factors = residual_factors(passes, full.beta)
        keep = np.ones(problem.base.count, bool)
        covariance = spread = _spread(problem, full, factors)
        rest = max(float(np.sum(problem.counts / factors)) - problem.base.count, 1.0)
        least = _residual(problem, full.beta, full.weights)
        current = full
        gone: dict[int, tuple[float, float]] = {}
        significance: float | None = None
        while keep.sum() > 1:
            positions = np.flatnonzero(keep)
            deviations = np.sqrt(np.diag(covariance))
            ratio = deviations / np.maximum(np.abs(current.beta), np.finfo(float).tiny)
            worst = int(np.argmax(ratio))
            index = int(positions[worst])
            tested = np.array([*gone, index])
            chance = float(fisher.sf(wald(full.beta, spread, tested) / len(tested), len(tested), rest))
            if ratio[worst] <= self.limit or chance <= self.level:
                break
            fewer = keep & (np.arange(len(keep)) != index)
            smaller = restricted(problem, fewer)
            less = self._asked(part, smaller)
            if _residual(smaller, less.beta, full.weights) > (1.0 + self.rise) * least:
                break
            gone[index] = (float(current.beta[worst]), float(deviations[worst]))
            keep, significance = fewer, chance
            current, covariance = less, _spread(smaller, less, factors)
        beta = np.zeros(len(keep))
        beta[keep] = current.beta
        moved = beta - full.beta
        stated = _uncertainty(passes, full).with_prior(np.outer(moved, moved))
        names, units = problem.base.names, problem.base.units
        dropped = [Dropped(names[k], units[k], value, std) for k, (value, std) in gone.items()]
        run = EssentialRun(
            dropped=dropped,
            kept=int(keep.sum()),
            significance=significance,
            conditional_std=np.sqrt(np.diag(covariance)).tolist(),
        )
        return Solution(beta, current.weights, covariance=stated.covariance, degrees=stated.degrees, run=run)

    def _asked(self, part: Estimator, problem: Problem) -> Solution:
        """Return the solution of the other estimator."""
        solution = part.solve(problem)
        if solution.theta is not None:
            raise BadOption("of", self.of, "it finds standard parameters of whole bodies; give wls or huber")
        return solution


def _spread(problem: Problem, solution: Solution, factors: Array) -> Array:
    """Return what decides: the method's own covariance, or one that hardly depends on where logs are cut.

    Each joint has its residual deviation and one factor for rows that hang together.
    """
    if solution.covariance is not None:
        return solution.covariance
    weights, deviations = solution.weights, problem.joint_deviations(solution.beta)
    return sandwich(problem.reduced(weights), problem.reduced(weights**2 * deviations * np.sqrt(factors)))


def _uncertainty(passes: RowPasses, solution: Solution) -> Uncertainty:
    """Return the covariance of the fit of all parameters."""
    if solution.covariance is None:
        return spectral_uncertainty(passes.problem, solution.weights, solution.beta, passes)
    degrees = np.full(len(solution.beta), np.inf) if solution.degrees is None else solution.degrees
    return Uncertainty(solution.covariance, degrees)


def _residual(problem: Problem, beta: Array, weights: Array) -> float:
    """Return the weighted residual norm."""
    return float(np.sqrt(weights**2 @ problem.residual_squares(beta)))


def wald(beta: Array, covariance: Array, chosen: IntArray) -> float:
    """Return beta_c' C_cc^-1 beta_c, the statistic of the test that the chosen parameters are zero (Wald 1943)."""
    block = covariance[np.ix_(chosen, chosen)]
    scale = np.sqrt(np.diag(block))
    return float((beta[chosen] / scale) @ np.linalg.solve(block / scale / scale[:, None], beta[chosen] / scale))


def restricted(problem: Problem, keep: BoolArray) -> Problem:
    """Return the problem of some of the base parameters, the others being zero.

    Args:
        problem: The problem.
        keep: Which base parameters stay, shape (b,).
    """
    base = problem.base
    fewer = replace(
        base,
        independent=base.independent[keep],
        matrix=base.matrix[keep],
        matters=base.matters[keep],
        shares=base.shares[keep],
    )
    place = np.cumsum(keep) - 1
    triangles = []
    for triangle in problem.triangles:
        mine = keep[triangle.columns]
        factor = triangle.factor[:, np.append(mine, True)]
        triangles.append(Triangle(place[triangle.columns[mine]], factor, triangle.rows))
    load = None if problem.load is None else problem.load[keep]
    return replace(problem, base=fewer, triangles=tuple(triangles), load=load)
