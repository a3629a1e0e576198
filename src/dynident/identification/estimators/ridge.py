"""Ridge regression with unit columns."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from scipy.optimize import minimize_scalar

from dynident.arrays import Array
from dynident.errors import BadOption
from dynident.identification.estimators._pulled import pulled_uncertainty
from dynident.identification.estimators.wls import WLS
from dynident.identification.problem.estimator import Estimator, Solution
from dynident.identification.problem.method_run import MethodRun
from dynident.identification.problem.problem import Problem
from dynident.identification.residuals.coloured import Uncertainty
from dynident.identification.residuals.covariance import correlation_of
from dynident.identification.residuals.row_passes import RowPasses

#: Range in which generalised cross-validation looks for the strength, unit columns taken as 1, and its grid.
WEAKEST, STRONGEST, GRID = 1e-14, 1.0, 57


@dataclass(frozen=True, kw_only=True)
class RidgeRun(MethodRun):
    """``strength``: of the penalty; ``free_parameters``: trace of the hat matrix."""

    strength: float
    free_parameters: float


@dataclass(frozen=True)
class Ridge(Estimator):
    """Ridge regression (Tikhonov regularisation), |R beta - z|^2 + strength |D beta|^2 (Hoerl and Kennard 1970).

    D holds the column norms, so that no unit matters; the weights are those of ``wls``. Without a strength, generalised
    cross-validation chooses it on the triangle (Golub, Heath and Wahba 1979), counting rows that hang together only
    for what they are worth. The covariance is that of the noise, coloured as it is, and of the bias, the pull taken for
    a normal prior (Wahba 1983): the deviations cover the bias on average over the parameters, not for each.

    Attributes:
        strength: Pull as a share of the squared column norms; None: by generalised cross-validation.
    """

    strength: float | None = None

    from_triangles: ClassVar = True

    def __post_init__(self) -> None:
        if self.strength is not None and not 0 <= self.strength < np.inf:
            raise BadOption("strength", self.strength, "give a number, 0 or more, or leave it to cross-validation")

    def solve(self, problem: Problem) -> Solution:
        start = WLS().solve(problem)
        reduced = problem.reduced(start.weights)
        factors = correlation_of(problem, start.beta)
        norms = reduced.column_norms
        scale = np.where(norms > 0, norms, 1.0)
        u, values, directions = np.linalg.svd(reduced.r / scale)
        data = u.T @ reduced.z
        independent = float(np.sum(problem.counts / factors))
        strength = self.strength
        if strength is None:
            strength = cross_validated(values, data, reduced.rest, independent)
        kept = np.divide(values, values**2 + strength, out=np.zeros_like(values), where=values > 0)
        beta = (directions.T @ (kept * data)) / scale
        root = (directions.T / np.sqrt(np.maximum(values**2 + strength, np.finfo(float).tiny))) / scale[:, None]
        average = float(np.sum(problem.counts * factors) / np.sum(problem.counts))  # variance of an average direction
        inverse = root @ root.T
        found = _noise(problem, start, inverse).with_prior((inverse * (average * strength * norms**2)) @ inverse)
        run = RidgeRun(strength=float(strength), free_parameters=float(np.sum(kept * values)))
        return Solution(beta, start.weights, covariance=found.covariance, degrees=found.degrees, run=run)


def _noise(problem: Problem, start: Solution, inverse: Array) -> Uncertainty:
    """Return S^-1 B S^-1 with B the covariance of the weighted rows times their residuals."""
    if problem.left is not None:
        return Uncertainty(*problem.left.uncertainty(inverse, start.weights, start.beta))
    return pulled_uncertainty(RowPasses(problem), start, inverse, start.weights)


def cross_validated(values: Array, data: Array, rest: float, rows: float) -> float:
    """Return the strength with the smallest generalised cross-validation score; 0 where less is always better.

    V = (rest + sum (l / (s^2 + l))^2 d^2) / (rows - sum s^2 / (s^2 + l))^2.

    Args:
        values: Singular values s of the columns with unit norm, shape (b,).
        data: U'z, shape (b,).
        rest: Squared residual that no beta can remove.
        rows: Number of independent rows.
    """

    def score(power: float) -> float:
        pulled = values**2 / (values**2 + 10.0**power)
        return float(np.log(rest + np.sum(((1 - pulled) * data) ** 2)) - 2 * np.log(rows - np.sum(pulled)))

    rest = max(rest, float(np.finfo(float).tiny))
    rows = max(rows, len(values) + 1.0)
    powers = np.linspace(np.log10(WEAKEST), np.log10(STRONGEST), GRID)
    best = int(np.argmin([score(power) for power in powers]))
    if best == 0:
        return 0.0
    bracket = (powers[best - 1], powers[min(best + 1, GRID - 1)])
    found: Any = minimize_scalar(score, bounds=bracket, method="bounded")
    return 10.0 ** float(found.x)
