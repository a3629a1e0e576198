"""Covariance of least squares from its scores alone: no assumption on how noise depends on motion.

A score g_t = sum_i w_i^2 x_ti e_ti is what one time sample adds to X'e. With the quadratic-spectral kernel and the
bandwidth of Andrews (1991), B = sum_k k(k / S) sum_t g_t g_t+k' is consistent for noise that is coloured and changes
with the motion (heteroscedastic). It knows less than the spectral covariance, which takes the noise of a log for
stationary, and needs longer logs to be as good: see docs/derivations.md.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from dynident.arrays import Array, IntArray
from dynident.estimation.problem import Problem
from dynident.estimation.residuals.row_passes import RowPasses
from dynident.estimation.residuals.stretches import Stretch, stretches
from dynident.estimation.uncertainty.covariance import FEWEST_FREE
from dynident.model.reduction import least_squares

#: Autocorrelation above which a score counts as this one: a bandwidth beyond all samples says nothing.
LONGEST_MEMORY = 0.97


def hac_covariance(problem: Problem, weights: Array, beta: Array, passes: RowPasses | None = None) -> Array:
    """Return A^-1 B A^-1 with B from the scores of the rows, shape (b, b).

    Args:
        problem: The problem.
        weights: Weight of each joint's rows in the fit, shape (n,).
        beta: The estimate, shape (b,).
        passes: The rows, where they are there already.
    """
    passes = passes or RowPasses(problem)
    inverse = least_squares(problem.reduced(weights)).unscaled_covariance
    return covariance_of_scores(stretches(passes), passes.columns, passes.residuals(beta), weights, inverse)


def covariance_of_scores(
    parts: Iterable[Stretch], columns: Sequence[IntArray], residual: Array, weights: Array, inverse: Array
) -> Array:
    """Return the same from rows in stretches of time, their columns, residuals (N, n) and (X'X)^-1."""
    found, rows = np.zeros_like(inverse), 0
    for stretch in parts:
        scores = np.zeros((len(stretch.samples), len(inverse)))
        for i, (own, block) in enumerate(zip(columns, stretch.blocks, strict=True)):
            scores[:, own] += (weights[i] ** 2 * stretch.step) * (block * residual[stretch.samples, i]).T
        found += long_run_covariance(scores @ inverse) * len(scores)
        rows += stretch.step * int(np.count_nonzero(stretch.counting))
    return found / max(1.0 - len(inverse) / max(rows, 1), FEWEST_FREE)


def long_run_covariance(scores: Array) -> Array:
    """Return the sum over all lags of the autocovariance of a series about zero, shape (b, b), >= 0.

    Args:
        scores: Shape (N, b).
    """
    count = len(scores)
    bandwidth = automatic_bandwidth(scores)
    size = 2 ** int(np.ceil(np.log2(2 * count)))
    lags = np.arange(size // 2 + 1)
    kernel = np.where(lags < count, quadratic_spectral(lags / bandwidth), 0.0)
    window = np.maximum(np.fft.rfft(np.concatenate([kernel, kernel[-2:0:-1]])).real, 0.0)
    spectrum = np.fft.rfft(scores, size, axis=0)
    twice = np.full(len(window), 2.0)
    twice[[0, -1]] = 1.0
    rows = spectrum * np.sqrt(window * twice / size / count)[:, None]
    return rows.real.T @ rows.real + rows.imag.T @ rows.imag


def quadratic_spectral(x: Array) -> Array:
    """Return the quadratic-spectral kernel 25 / (12 pi^2 x^2) (sin(z) / z - cos z), z = 6 pi x / 5; 1 at zero."""
    z = np.where(x == 0, 1.0, 6.0 * np.pi * np.asarray(x) / 5.0)
    return np.where(np.abs(z) < 1e-3, 1.0, np.where(x == 0, 1.0, 3.0 / z**2 * (np.sin(z) / z - np.cos(z))))


def automatic_bandwidth(scores: Array) -> float:
    """Return the bandwidth of Andrews (1991), (6.2) and (6.4), from first-order autoregressions of the columns (N, b).

    Each column counts the same, whatever its unit.
    """
    power = np.sum(scores**2, axis=0)
    used = power > 0
    memory = np.sum(scores[1:, used] * scores[:-1, used], axis=0) / power[used]
    memory = np.clip(memory, -LONGEST_MEMORY, LONGEST_MEMORY)
    noise = 1.0 - memory**2  # innovations over the power, so that units drop out
    above = np.sum(4 * memory**2 * noise**2 / (1 - memory) ** 8)
    alpha = above / max(float(np.sum(noise**2 / (1 - memory) ** 4)), 1e-300)
    return max(1.3221 * float(alpha * len(scores)) ** 0.2, 1.0)
