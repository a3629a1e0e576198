"""How sure an estimate is: sandwich covariances, and what rows that hang together are worth."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dynident.arrays import Array, BoolArray
from dynident.identification.problem.problem import Problem
from dynident.identification.residuals.row_passes import RowPasses
from dynident.model.reduction import Reduced, least_squares

#: Least share of the residual's power, or of independent rows, that a fit is taken to leave over.
FEWEST_FREE = 0.1


def correlation_factors(residuals: Sequence[Array], masks: Sequence[BoolArray] | None = None) -> Array:
    """Return how much the rows of each joint hang together: the integrated autocorrelation of its residual, >= 1.

    The sum 1 + 2 sum rho_k is cut at the first negative pair (Geyer 1992); filtered or modelled badly, residuals are
    far from independent, and covariances that ignore it are too small.

    Args:
        residuals: Residuals of each log over the rows used, shape (N, n) each.
        masks: Which of them count in the fit, shape (N, n) each; None: all. Those that do not are taken as zero.

    Returns:
        Shape (n,).
    """
    counting = [np.ones(r.shape, bool) for r in residuals] if masks is None else masks
    total, rows = np.zeros(residuals[0].shape[1]), np.zeros(residuals[0].shape[1])
    for residual, mask in zip(residuals, counting, strict=True):
        count = mask.sum(axis=0)
        pairs = zip(residual.T, mask.T, strict=True)
        total += count * np.array([_integrated(column, keep) for column, keep in pairs])
        rows += count
    return np.where(rows > 0, total / np.maximum(rows, 1), 1.0)


def _integrated(residual: Array, keep: BoolArray) -> float:
    if np.count_nonzero(keep) < 2:
        return 1.0
    centred = np.where(keep, residual - residual[keep].mean(), 0.0)
    lags = max(2, len(centred) // 4)  # as far as the sum may reach
    size = 2 ** int(np.ceil(np.log2(len(centred) + lags)))  # so that none of these lags comes round
    spectrum = np.abs(np.fft.rfft(centred, size)) ** 2
    covariance = np.fft.irfft(spectrum, size)[:lags]
    if covariance[0] <= 0:
        return 1.0
    rho = covariance / covariance[0]
    pairs = rho[: len(rho) // 2 * 2].reshape(-1, 2).sum(axis=1)
    negative = np.flatnonzero(pairs <= 0)
    return max(1.0, float(2 * pairs[: negative[0] if len(negative) else len(pairs)].sum() - 1))


def sandwich(bread: Reduced, meat: Reduced) -> Array:
    """Return A^-1 B A^-1 with A = R'R of the bread and B = R'R of the meat, shape (b, b) (Huber 1967; White 1980).

    The bread has the curvature of the fit's criterion, the meat what the rows are worth: a joint's weights squared
    times its residual deviation and the root of its correlation factor.
    """
    spread = meat.r @ least_squares(bread).unscaled_covariance
    return spread.T @ spread


def residual_factors(passes: RowPasses, beta: Array) -> Array:
    """Return the correlation factor of each joint's residual at ``beta``, shape (n,)."""
    return correlation_factors(passes.by_log(passes.residuals(beta)), passes.problem.masks)


def correlation_of(problem: Problem, beta: Array) -> Array:
    """Return the same of a problem whose rows may be gone."""
    return residual_factors(RowPasses(problem), beta) if problem.left is None else problem.left.factors(beta)
