"""The noise of estimates that something pulls away from least squares."""

from __future__ import annotations

from dynident.arrays import Array
from dynident.identification.problem.estimator import Solution
from dynident.identification.residuals.bands import bands
from dynident.identification.residuals.coloured import Influence, Uncertainty, uncertainty_of
from dynident.identification.residuals.row_passes import RowPasses
from dynident.model.reduction import least_squares


def pulled_uncertainty(passes: RowPasses, start: Solution, inverse: Array, weights: Array) -> Uncertainty:
    """Return the covariance of inverse X'e by noise alone, from the residuals of a fit that nothing pulls.

    Args:
        passes: The rows.
        start: Least squares without a pull.
        inverse: (X'X + pull)^-1, shape (b, b).
        weights: Weight of each joint's rows in X, shape (n,).
    """
    residual = passes.residuals(start.beta)
    free = least_squares(passes.problem.reduced(start.weights)).unscaled_covariance
    influence = Influence.of_rows(passes.problem, residual, free, start.weights**2)
    return uncertainty_of(bands(passes), residual, influence, (weights**2)[:, None, None] * inverse)
