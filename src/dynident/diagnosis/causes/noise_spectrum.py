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

from dynident.arrays import Array, BoolArray
from dynident.identification.residuals.covariance import FEWEST_FREE


@dataclass(frozen=True)
class NoiseSpectrum:
    """Averages over the frequencies of some rows.

    Attributes:
        masks: Which rows count, shape (N, n).
        left: Share of the power of a residual that the fit leaves, averaged, at each of F frequencies, shape (F, n).
        half: Frequencies to each side that an average is over.
    """

    masks: BoolArray
    left: Array
    half: int

    @classmethod
    def of_fit(cls, roots: Sequence[Array], masks: BoolArray, oversampling: float) -> NoiseSpectrum:
        """Return the averages of a fit.

        Args:
            roots: Rows of each joint times a root of the covariance of beta, over the deviation of its residual, shape
                (N, K): the sum of their squares is the leverage of a row.
            masks: Which rows count, shape (N, n).
            oversampling: Rows for each that is independent where noise is white before the filter.
        """
        count = len(masks)
        size = 2 ** int(np.ceil(np.log2(2 * count)))
        passed = count / (2.0 * oversampling)
        half = max(1, round(0.5 * np.sqrt(passed) * size / count))
        power = [_power(root * mask[:, None], size).sum(axis=1) for root, mask in zip(roots, masks.T, strict=True)]
        taken = np.stack(power, axis=1) / np.maximum(masks.sum(axis=0), 1)
        return cls(masks, np.maximum(1.0 - _averaged(taken, half), FEWEST_FREE), half)

    def factors(self, residual: Array, columns: Array) -> tuple[Array, Array]:
        """Return rows for each that is independent as the columns see them, shape (n,), >= 1, and their power, (n,).

        Args:
            residual: Residual of the fit, shape (N, n).
            columns: What the other columns leave of each, shape (k, N, n).
        """
        size = len(self.left)
        noise = _averaged(_power(np.where(self.masks, residual, 0.0), size), self.half) / self.left
        power = _power(np.where(self.masks, columns, 0.0).transpose(1, 0, 2), size).sum(axis=1)
        mean = np.maximum(noise.mean(axis=0) * power.sum(axis=0), 1e-300)
        return np.maximum((noise * power).sum(axis=0) / mean, 1.0), power.sum(axis=0)


def _power(values: Array, size: int) -> Array:
    """Return the power of columns (N, ...) at ``size`` frequencies, their mean the sum of squares."""
    transform = np.fft.fft(values, size, axis=0)
    return transform.real**2 + transform.imag**2


def _averaged(values: Array, half: int) -> Array:
    """Return running means (F, n) over a circle of frequencies, ``half`` to each side."""
    wide = 2 * half + 1
    sums = np.cumsum(np.concatenate([np.zeros((1, values.shape[1])), values[-half:], values, values[:half]]), axis=0)
    return (sums[wide:] - sums[:-wide]) / wide
