"""How sure an estimate is where residuals are coloured, differ between logs and depend on each other between joints.

The covariance of least squares with weights w is A^-1 B A^-1, A = X'X, B the covariance of the weighted rows times
their residuals. In the frequency domain B = sum_f X(f)* S(f) X(f) (Hannan 1970, chapter VII), S the cross-power of the
joints' residuals, averaged over neighbouring frequencies (Daniell 1946). Two things make averages of a residual's
power too small or too large where logs are short, and both are known beforehand: the fit takes more from the residual
at frequencies where the regressor is strong (its leverage h(f), as in HC2 of MacKinnon and White 1985), and the power
falls with that of the torque's filter |H(f)|^2 within the average. So S(f) = |H|^2 avg(|e|^2) / avg(|H|^2 (1 - h)).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
import scipy.ndimage
import scipy.stats

from dynident.arrays import Array, BoolArray, IntArray
from dynident.estimation.problem import Problem
from dynident.estimation.residuals.row_passes import RowPasses
from dynident.estimation.residuals.stretches import stretches
from dynident.estimation.uncertainty.covariance import FEWEST_FREE
from dynident.experiment.preprocessing import Prepared
from dynident.model.reduction import least_squares

#: Frequencies to either side of an average, over the root of the number of those that the filter passes.
WIDTH = 0.5

#: How often the power found takes the place of the filter's as the shape within an average.
SHARPENED = 2


@dataclass(frozen=True)
class Uncertainty:
    """Covariance of an estimate and how well it is known itself.

    Attributes:
        covariance: Of the base parameters, shape (b, b).
        degrees: Degrees of freedom of each variance (Satterthwaite 1946), for quantiles of Student's t, shape (b,).
    """

    covariance: Array
    degrees: Array

    @property
    def deviations(self) -> Array:
        """Standard deviation of each base parameter, shape (b,)."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))

    def half_widths(self, level: float = 0.95) -> Array:
        """Return half the width of the interval that holds each parameter at a level of confidence, shape (b,)."""
        return self.deviations * scipy.stats.t.ppf(0.5 + 0.5 * level, self.degrees)


@dataclass(frozen=True)
class Band:
    """Unweighted rows of a stretch of time, by frequency.

    Attributes:
        samples: Where its rows stand in the samples of all logs, shape (M,).
        counting: Which of them count, shape (M, n).
        rows: Their transform, zero where they do not count, shape (F, n, b).
        shape: Power that the filter passes, between 0 and 1, shape (F,).
        step: One row in how many is here.
    """

    samples: IntArray
    counting: BoolArray
    rows: Array
    shape: Array
    step: int

    @property
    def twice(self) -> Array:
        """How many frequencies of the two-sided transform each one stands for, shape (F,)."""
        count = np.full(len(self.shape), 2.0)
        count[0] = 1.0
        if len(self.samples) % 2 == 0:
            count[-1] = 1.0
        return count

    @property
    def width(self) -> int:
        """Number of neighbouring frequencies to average over, odd."""
        wide = float(np.sum(self.shape) ** 2 / np.sum(self.shape**2))
        return min(2 * round(WIDTH * wide**0.5) + 1, 2 * ((len(self.shape) - 1) // 2) + 1)

    def transformed(self, values: Array) -> Array:
        """Return the transform of values over the samples of all logs (N, n), shape (F, n)."""
        own = np.where(self.counting, values[self.samples], 0.0)
        return np.fft.rfft(own, axis=0) * np.sqrt(self.step / len(own))

    def averaged(self, values: Array) -> Array:
        """Return the mean over neighbouring frequencies, along the first axis; the spectrum goes on symmetrically."""
        return scipy.ndimage.uniform_filter1d(values, self.width, axis=0, mode="mirror")


def bands(passes: RowPasses) -> Iterator[Band]:
    """Yield the rows of a problem by frequency, stretch by stretch."""
    for stretch in stretches(passes):
        count = len(stretch.samples)
        rows = np.zeros((count // 2 + 1, len(passes.columns), passes.problem.base.count), dtype=complex)
        for i, (own, block) in enumerate(zip(passes.columns, stretch.blocks, strict=True)):
            rows[:, i, own] = np.fft.rfft(block, axis=1).T * np.sqrt(stretch.step / count)
        shape = filter_power(stretch.log, count, stretch.step * stretch.log.every)
        yield Band(stretch.samples, stretch.counting, rows, shape, stretch.step)


def filter_power(log: Prepared, count: int, every: int) -> Array:
    """Return the share of the power of white torque noise that the filter of a log passes, shape (count // 2 + 1,).

    Args:
        log: The log.
        count: Number of rows of a transform.
        every: One sample in how many is such a row; what is beyond their frequencies comes back among them.
    """
    reach = log.how.filter.reach(log.log.rate)
    if not reach:
        return np.ones(count // 2 + 1)
    times = -(-(2 * reach + 1) // (count * every))
    impulse = np.zeros((1, count * every * times))
    impulse[0, impulse.shape[1] // 2] = 1.0
    power = np.abs(np.fft.fft(log.smooth(impulse)[0]))[::times] ** 2
    return power.reshape(every, count).mean(axis=0)[: count // 2 + 1]


def covariance_of(found: Iterable[Band], residual: Array, weights: Array, inverse: Array) -> Uncertainty:
    """Return the covariance of weighted least squares from its rows by frequency.

    Args:
        found: The rows, from :func:`bands`.
        residual: Residuals over the samples of all logs, shape (N, n).
        weights: Weight of each joint's rows, shape (n,).
        inverse: (X'X)^-1 of the weighted rows, shape (b, b).
    """
    root = np.linalg.cholesky(inverse)
    size = len(inverse)
    covariance, total, doubt = np.zeros((size, size)), np.zeros(size), np.zeros(size)
    for band in found:
        flat = band.rows.reshape(-1, size)
        lever = weights**2 * _square(flat @ root).sum(axis=1).reshape(len(band.shape), -1)
        power = cross_power(band, residual, lever)
        values, vectors = np.linalg.eigh(power * np.outer(weights, weights) ** 2)
        roots = vectors * np.sqrt(np.maximum(values, 0.0) * band.twice[:, None])[:, None, :]
        spread = (flat @ inverse).reshape(band.rows.shape)
        parts = (np.conj(np.swapaxes(roots, 1, 2)) @ spread).reshape(-1, size)
        covariance += parts.real.T @ parts.real + parts.imag.T @ parts.imag
        # Frequencies within one average rise and fall together, so each average counts once.
        groups = np.arange(0, len(band.shape), band.width)
        own = band.twice[:, None] * np.real(np.einsum("fii->fi", power)) * weights**4
        share = np.add.reduceat(_square(spread) * own[:, :, None], groups, axis=0)
        freedom = np.add.reduceat(band.twice[:, None] * _free(band, lever, band.shape[:, None]), groups, axis=0)
        total += share.sum(axis=(0, 1))
        doubt += np.sum(share**2 / freedom[:, :, None], axis=(0, 1))
    degrees = total**2 / np.where(doubt > 0, doubt, np.inf)
    return Uncertainty(covariance, np.where(doubt > 0, np.maximum(degrees, 1.0), np.inf))


def _square(values: Array) -> Array:
    return values.real**2 + values.imag**2


def cross_power(band: Band, residual: Array, lever: Array) -> Array:
    """Return the cross-power of the joints' residuals at each frequency, shape (F, n, n), Hermitian, >= 0.

    Args:
        band: The stretch.
        residual: Shape (N, n).
        lever: Leverage of the rows of each joint at each frequency, shape (F, n).
    """
    transform = band.transformed(residual)
    power = transform[:, :, None] * np.conj(transform)[:, None, :]
    power = band.averaged(power.real) + 1j * band.averaged(power.imag)
    own = np.real(np.einsum("fii->fi", power))
    live = np.maximum(band.counting.mean(axis=0), 1.0 / len(band.samples))
    most = own * band.width / (FEWEST_FREE * live)  # all power of an average at one frequency
    shape = np.repeat(band.shape[:, None], own.shape[1], axis=1)
    for _ in range(SHARPENED):
        left = band.averaged(shape) * _free(band, lever, shape) * live
        shape = np.minimum(shape * own / np.maximum(left, 1e-300), most)
    ratio = np.sqrt(shape / np.maximum(own, 1e-300))
    return power * ratio[:, :, None] * ratio[:, None, :]


def _free(band: Band, lever: Array, shape: Array) -> Array:
    """Return the share of the residual's power that the fit leaves, about each frequency, shape (F, n)."""
    left = band.averaged(shape * np.maximum(1.0 - lever, 0.0))
    return np.maximum(left / np.maximum(band.averaged(shape), 1e-300), FEWEST_FREE)


def spectral_uncertainty(problem: Problem, weights: Array, beta: Array, passes: RowPasses | None = None) -> Uncertainty:
    """Return the covariance of least squares with one weight a joint, residuals coloured as they are.

    Args:
        problem: The problem.
        weights: Weight of each joint's rows in the fit, shape (n,).
        beta: The estimate, shape (b,).
        passes: The rows, where they are there already.
    """
    passes = passes or RowPasses(problem)
    inverse = least_squares(problem.reduced(weights)).unscaled_covariance
    return covariance_of(bands(passes), passes.residuals(beta), weights, inverse)
