"""How much rows hang together as a column of a fit sees them, by frequency.

The variance of a coefficient is that of independent rows times sum_f |X(f)|^2 S(f) / sum_f |X(f)|^2, X the column
less what the others explain of it, S the power of the noise over its mean (Hannan 1970, chapter VII). Slow noise counts
for slow columns, and little for the sign of a velocity. S is the periodogram of the residual averaged over neighbouring
frequencies (Daniell 1946), less what the fit has taken of it there, as the covariance of an estimate has it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dynident.arrays import Array, IntArray
from dynident.identification.residuals.covariance import FEWEST_FREE

#: Highest frequency over the cut-off: rows have next to no power above it.
BAND = 2.0


@dataclass(frozen=True)
class NoiseSpectrum:
    """Averages over the frequencies of some rows, F of them, up to ``BAND`` times what the filter lets through.

    Attributes:
        left: Share of the power of a residual that the fit leaves, averaged, at each frequency, shape (n, F).
        half: Frequencies to each side that an average is over.
        size: Frequencies of the whole circle.
    """

    left: Array
    half: int
    size: int

    @classmethod
    def of_fit(cls, roots: Sequence[Array], counts: Array, oversampling: float) -> NoiseSpectrum:
        """Return the averages of a fit.

        Args:
            roots: Rows of each joint times a root of the covariance of beta, over the deviation of its residual, zero
                where they do not count, shape (K_i, N): the sum of their squares is the leverage of a row.
            counts: Rows of each joint that count, shape (n,).
            oversampling: Rows for each that is independent where noise is white before the filter.
        """
        count = roots[0].shape[1]
        size = min(fast * 2 ** int(np.ceil(np.log2(count / fast))) for fast in (4, 5, 6))
        passed = count / (2.0 * oversampling)
        half = max(1, round(0.5 * np.sqrt(passed) * size / count))
        kept = min(size // 2 + 1, int(np.ceil(BAND * size / (2.0 * oversampling))))
        taken = np.stack([_power(_transformed(root, size, kept)).sum(axis=0) for root in roots]) / counts[:, None]
        return cls(np.maximum(1.0 - _averaged(taken, half), FEWEST_FREE), half, size)

    def transformed(self, series: Array) -> Array:
        """Return the Fourier transforms of series (k, N), real parts and then imaginary ones, shape (k, 2 F)."""
        return _transformed(series, self.size, self.left.shape[1])

    def sums(self, joint: int, residuals: Array, columns: Array, ends: IntArray) -> tuple[Array, Array]:
        """Return the squares of columns of a joint, shape (k,), and the same weighed by the power of the noise.

        Args:
            joint: Its number.
            residuals: Transforms of the residuals of m fits, zero where rows do not count, shape (m, 2 F).
            columns: Those of what the other columns of their fits leave of each, shape (k, 2 F).
            ends: Where the columns of each fit begin, and the last of them end, shape (m + 1,).
        """
        times = np.full(self.left.shape[1], 2.0 / self.size)  # the other half of the circle is the same
        times[0] = 1.0 / self.size
        times[self.size // 2 :] = 1.0 / self.size
        noise = _averaged(_power(residuals), self.half) / self.left[joint]
        noise /= np.maximum(noise @ times, 1e-300)[:, None]
        power, noisy = _power(columns), np.zeros(len(columns))
        for own, begin, end in zip(noise * times, ends[:-1], ends[1:], strict=True):
            noisy[begin:end] = power[begin:end] @ own
        return power @ times, noisy


def _transformed(series: Array, size: int, count: int) -> Array:
    """Return the transforms of series (k, N) at the first ``count`` of ``size`` frequencies, shape (k, 2 F)."""
    found = np.fft.rfft(series, size)[:, :count]
    return np.concatenate([found.real, found.imag], axis=1)


def _power(transforms: Array) -> Array:
    """Return the power at each frequency, whose mean over the circle is the sum of squares, shape (k, F)."""
    real, imaginary = np.hsplit(transforms, 2)
    power = real**2
    power += imaginary**2
    return power


def _averaged(values: Array, half: int) -> Array:
    """Return running means (k, F) over a circle of frequencies, ``half`` to each side, of which half is given."""
    wide = 2 * half + 1
    circle = np.concatenate(
        [np.zeros((len(values), 1)), values[:, half:0:-1], values, values[:, -2 : -half - 2 : -1]], 1
    )
    sums = np.cumsum(circle, axis=1)
    return (sums[:, wide:] - sums[:, :-wide]) / wide
