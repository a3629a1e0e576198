"""Residuals of different joints at the same sample: their covariance, and rows whitened by it.

With the covariance L of the n residuals of a sample, Cov(e) = L x I over all samples, and the generalised least squares
fit is that of rows multiplied by a U with U'U = L^-1 (Aitken 1936; for robots Han, Wu, Liu and Xiong 2020). U is upper
triangular, so that row i mixes the joints i to n: on a serial arm its columns are those of joint i.
"""

from __future__ import annotations

import numpy as np

from dynident.arrays import Array, BoolArray, IntArray
from dynident.identification.residuals.row_passes import RowPasses
from dynident.model.reduction import CHUNK, Triangle, absorb

#: Smallest eigenvalue of the correlations: below it two joints would be one.
SMALLEST = 1e-6

#: Fewest shared samples from which a correlation of two joints is taken.
FEWEST = 10


def joint_covariance(residual: Array, counting: BoolArray, weights: Array, floor: Array, free: float = 1.0) -> Array:
    """Return the covariance of the joints' residuals about zero, shape (n, n), positive definite.

    Correlations come from the samples that a pair of joints shares; where the pairs contradict each other the
    eigenvalues are lifted (Rousseeuw and Molenberghs 1993).

    Args:
        residual: Shape (N, n).
        counting: Which rows count, shape (N, n).
        weights: Weight of each sample, shape (N,).
        floor: Smallest standard deviation of each joint, shape (n,).
        free: Share of the degrees of freedom that the parameters leave.
    """
    used = np.where(counting, residual, 0.0)
    shared = counting.astype(float)
    sums = (used * weights[:, None]).T @ used
    counts = shared.T @ shared
    square = np.diag(sums) / np.maximum(np.diag(counts), 1.0) / free
    deviations = np.maximum(np.sqrt(square), floor)
    both = (used**2 * weights[:, None]).T @ shared  # sum of squares of i where j counts too
    size = np.sqrt(both * both.T)
    known = (counts >= FEWEST) & (size > 0)
    correlation = np.divide(sums, size, out=np.zeros_like(sums), where=known)
    np.fill_diagonal(correlation, 1.0)
    values, vectors = np.linalg.eigh(correlation)
    if values[0] < SMALLEST:
        lifted = (vectors * np.maximum(values, SMALLEST)) @ vectors.T
        root = np.sqrt(np.diag(lifted))
        correlation = lifted / root / root[:, None]
    return correlation * deviations * deviations[:, None]


def whitener(covariance: Array) -> Array:
    """Return the upper triangular U with U'U = covariance^-1, shape (n, n)."""
    size = np.sqrt(np.diag(covariance))
    lower = np.linalg.cholesky(np.linalg.inv(covariance / size / size[:, None]))
    return lower.T / size


class JointWhitening:
    """Rows of all joints of a sample, whitened by their covariance; where some do not count, by that of the others.

    Attributes:
        passes: The rows.
        covariance: L, shape (n, n).
        counting: Which rows are used, shape (N, n).
        columns: Positions in beta of the columns of each whitened row, those of the joints that it mixes.
    """

    def __init__(self, passes: RowPasses, covariance: Array, counting: BoolArray) -> None:
        self.passes, self.covariance, self.counting = passes, covariance, counting
        count = len(passes.columns)
        mixed = [np.concatenate(passes.columns[i:]) for i in range(count)]
        self.columns: tuple[IntArray, ...] = tuple(np.unique(columns).astype(np.int64) for columns in mixed)
        patterns, which = np.unique(counting, axis=0, return_inverse=True)
        self._which: IntArray = which.reshape(-1)
        self._whiteners = [_embedded(covariance, pattern) for pattern in patterns]

    def residuals(self, residual: Array) -> Array:
        """Return U times the residuals of each sample, shape (N, n); zero where a row is not used."""
        white = np.zeros_like(residual)
        for k, matrix in enumerate(self._whiteners):
            rows = self._which == k
            white[rows] = residual[rows] @ matrix.T
        return white

    def turned_back(self, values: Array) -> Array:
        """Return U' times values at each sample, shape (N, n): what they count in the rows as they were."""
        found = np.zeros_like(values)
        for k, matrix in enumerate(self._whiteners):
            rows = self._which == k
            found[rows] = values[rows] @ matrix
        return found

    def triangles(self, weights: Array) -> tuple[Triangle, ...]:
        """Return the triangles of the whitened rows, each sample times its weight (N,); their sum is the whole fit."""
        factors: list[Array] = [np.zeros((len(columns) + 1,) * 2, order="F") for columns in self.columns]
        with self.passes.one_thread():
            for segment in self.passes:
                for first in range(segment.samples.start, segment.samples.stop, CHUNK):
                    part = slice(first, min(first + CHUNK, segment.samples.stop))
                    inside = slice(part.start - segment.samples.start, part.stop - segment.samples.start)
                    self._absorb(factors, [block[:, inside] for block in segment.blocks], part, weights[part])
        return tuple(
            Triangle(columns, np.triu(factor), int(self.counting[:, i].sum()))
            for i, (columns, factor) in enumerate(zip(self.columns, factors, strict=True))
        )

    def _absorb(self, factors: list[Array], blocks: list[Array], part: slice, weights: Array) -> None:
        """Add the whitened rows of a few samples to the factors."""
        size = self.passes.problem.base.count + 1
        mixing = np.stack([matrix for matrix in self._whiteners])[self._which[part]] * weights[:, None, None]
        for i, columns in enumerate(self.columns):
            rows = np.zeros((size, len(weights)))
            for j in range(i, len(blocks)):
                factor = mixing[:, i, j]
                if not factor.any():
                    continue
                rows[self.passes.columns[j]] += factor * blocks[j][:-1]
                rows[-1] += factor * blocks[j][-1]
            chosen = rows[np.append(columns, size - 1)][:, mixing[:, i, i] != 0]
            factors[i] = absorb(factors[i], np.ascontiguousarray(chosen).T)


def _embedded(covariance: Array, pattern: BoolArray) -> Array:
    """Return the whitener of the joints in a pattern, zero for the others, shape (n, n)."""
    matrix = np.zeros_like(covariance)
    used = np.flatnonzero(pattern)
    if len(used):
        matrix[np.ix_(used, used)] = whitener(covariance[np.ix_(used, used)])
    return matrix
