"""Covariance of rows times residuals where residuals are coloured and joints depend on each other, by frequency.

A residual made of differentiated noise is strong at high frequencies, where instruments and filtered regressors have
nothing; a residual of a wrong model is strong where they are. One correlation factor per joint cannot tell the two
apart, the spectrum can. Source: Hannan 1970, chapter VII (regression with a stationary residual of several channels);
the spectra of the residuals are their periodograms averaged over neighbouring frequencies (Daniell 1946).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import scipy.ndimage

from dynident.arrays import Array, BoolArray, IntArray
from dynident.model.reduction import triangle_of

#: Rows that are transformed at a time.
BLOCK = 1 << 12


def score_triangle(
    parts: Iterator[tuple[Sequence[Array], Array, BoolArray]], columns: Sequence[IntArray], size: int, weights: Array
) -> Array:
    """Return S with S'S the covariance of X'e: X the weighted rows of all joints, e the weighted residuals.

    Args:
        parts: Per part, in order of time: the rows of each joint, transposed, (K_i, N); the residuals (N, n); which of
            them count (N, n).
        columns: Positions of the K_i entries of each joint's rows.
        size: Number of columns of X.
        weights: Weight of each joint's rows and residuals, shape (n,).

    Returns:
        Shape (s, size), s <= size.
    """
    found = np.zeros((0, size))
    waiting: list[tuple[Sequence[Array], Array, BoolArray]] = []
    rows = 0
    for part in parts:
        waiting.append(part)
        rows += len(part[1])
        if rows >= BLOCK:
            found = triangle_of(np.concatenate([found, _transformed(waiting, columns, size, weights)]))
            waiting, rows = [], 0
    if waiting:
        found = triangle_of(np.concatenate([found, _transformed(waiting, columns, size, weights)]))
    return found


def _transformed(
    parts: Sequence[tuple[Sequence[Array], Array, BoolArray]], columns: Sequence[IntArray], size: int, weights: Array
) -> Array:
    """Return the triangle of one stretch of time: the rows at each frequency times the root of the residuals' power."""
    mask = np.concatenate([part[2] for part in parts])
    residual = np.where(mask, np.concatenate([part[1] for part in parts]) * weights, 0.0)
    count, joints = residual.shape
    root = _power_root(residual, mask)
    scaled = np.zeros((len(root), joints, size), dtype=complex)  # frequency, part of the residual, column
    for i, own in enumerate(columns):
        block = np.concatenate([part[0][i] for part in parts], axis=1)
        spectrum = np.fft.rfft(np.where(mask[:, i], block, 0.0), axis=1).T * (weights[i] / np.sqrt(count))
        scaled[:, :, own] += spectrum[:, None, :].conj() * root[:, i, :, None]
    twice = np.full(len(root), np.sqrt(2.0))
    twice[0] = 1.0
    if count % 2 == 0:
        twice[-1] = 1.0
    flat = (scaled * twice[:, None, None]).reshape(-1, size)
    return triangle_of(np.concatenate([np.real(flat), np.imag(flat)]))


def _power_root(residual: Array, mask: BoolArray) -> Array:
    """Return L with L L* the smoothed cross-power of the joints' residuals at each frequency, shape (F, n, n)."""
    count, joints = residual.shape
    spectrum = np.fft.rfft(residual, axis=0)
    power = spectrum[:, :, None] * spectrum[:, None, :].conj() / count
    width = min(2 * round(0.5 * np.sqrt(count)) + 1, len(power))
    for part in (power.real, power.imag):
        part[:] = scipy.ndimage.uniform_filter1d(part, width, axis=0, mode="mirror")
    # Samples that do not count take power from the residual; the rest stands for all.
    live = np.sqrt(np.maximum(mask.mean(axis=0), 1.0 / count))
    values, vectors = np.linalg.eigh(power / np.outer(live, live))
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :]).reshape(-1, joints, joints)
