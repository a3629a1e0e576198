"""Triangles: rows are reduced by QR as they come, merged, and never kept (TSQR).

A triangle T of the rows [W, tau] satisfies T'T = [W, tau]'[W, tau], so every quadratic question about the rows has
the same answer on T. Ranks are decided on T, never on the Gram matrix, whose singular values are squared.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from dynident.arrays import Array, IntArray, frozen
from dynident.model.lapack import cholesky, solve_upper, times_upper, tpqrt, upper_triangle
from dynident.model.threads import one_blas_thread

#: Columns factored at a time inside a panel; 8 is the fastest for panels of 20 to 60 columns.
_BLOCK = 8

#: What is left of a column beside others, as a share of it, that passes for rounding.
ROUNDING = 1e-10

#: Rows reduced at a time: the panel stays in the cache.
CHUNK = 1000

#: Rows from which making the code of the faster way pays; largest square of a column of W.
MANY, _LARGE = 50_000, 100.0


def triangle_of(rows: Array) -> Array:
    """Return the upper triangle of ``rows`` (N, k), shape (min(N, k), k), by Householder QR."""
    return upper_triangle(rows)


def absorb(factor: Array, rows: Array) -> Array:
    """Return the triangle of ``factor`` and new rows; both are overwritten. The interpreter's lock is not held.

    Args:
        factor: Upper triangle, shape (k, k), in Fortran order; what stands below its diagonal is left alone.
        rows: Shape (m, k), in Fortran order.
    """
    if len(rows):
        tpqrt(factor, rows, min(_BLOCK, len(factor)))
    return factor


def absorber(rows: int) -> Callable[[Array, Array], Array]:
    """Return the faster way to :func:`absorb` panels of ``rows`` rows altogether; one for each thread.

    Of many rows a panel A makes of the triangle R the triangle U R, where U'U = I + W'W and W = A R^-1: at more than
    twice the speed, and as accurate as QR because [I; W] is well-conditioned (Cholesky QR with a triangle for
    preconditioner: Fukaya and others 2020). A panel that is large beside all before it is absorbed by QR.
    """
    if rows < MANY:
        return absorb
    from dynident.model.kernels.preconditioned import Preconditioned  # long logs need it

    preconditioned = Preconditioned()

    def absorb_many(factor: Array, panel: Array) -> Array:
        if not preconditioned.takes(panel):
            return absorb(factor, panel)
        gram = preconditioned.gram(factor, panel)
        if not gram.diagonal().max() < _LARGE:  # or not a number
            return absorb(factor, panel)
        upper = cholesky(gram)
        assert upper is not None  # no eigenvalue is below 1
        times_upper(upper, factor)
        return factor

    return absorb_many


@dataclass(frozen=True)
class Triangle:
    """The unweighted rows of one joint, reduced.

    Attributes:
        columns: Positions in beta of the columns kept; all others are zero on this joint, shape (K,).
        factor: Upper triangle of [W, tau], shape (<= K + 1, K + 1).
        rows: Number of rows reduced.
    """

    columns: IntArray
    factor: Array
    rows: int

    def __post_init__(self) -> None:
        object.__setattr__(self, "factor", frozen(self.factor, (None, len(self.columns) + 1), "triangle"))

    @classmethod
    def empty(cls, columns: IntArray) -> Triangle:
        """Return a triangle of no rows."""
        return cls(columns, np.zeros((0, len(columns) + 1)), 0)

    def merged(self, others: Iterable[Triangle]) -> Triangle:
        """Return the triangle of all rows of this and the others, which have the same columns."""
        parts = [self, *others]
        with one_blas_thread():
            factor = triangle_of(np.concatenate([part.factor for part in parts]))
        return Triangle(self.columns, factor, sum(part.rows for part in parts))

    def shifted(self, change: Array) -> Triangle:
        """Return the triangle of torques less those of ``change``, shape (b,), by which a fit moves then."""
        factor = self.factor.copy()
        factor[:, -1] -= factor[:, :-1] @ change[self.columns]
        return Triangle(self.columns, factor, self.rows)

    def residual_square(self, beta: Array) -> float:
        """Return the sum of squared residuals of the rows at ``beta``, shape (b,)."""
        vector = np.append(beta[self.columns], -1.0)
        return float(np.sum((self.factor @ vector) ** 2))

    @property
    def torque_square(self) -> float:
        """Sum of the squared torques of the rows."""
        return float(np.sum(self.factor[:, -1] ** 2))


def merged_pairs(factors: Array) -> Array:
    """Return the triangle of each two that follow each other, shape (m, k, k) to (ceil(m / 2), k, k)."""
    size = factors.shape[-1]
    found = np.zeros(((len(factors) + 1) // 2, size, size))
    with one_blas_thread():
        for k, own in enumerate(found):
            factor = triangle_of(np.concatenate(list(factors[2 * k : 2 * k + 2])))
            own[: len(factor)] = factor
    return found


@dataclass(frozen=True)
class Reduced:
    """The weighted least-squares problem min |R beta - z|^2 + rest.

    Attributes:
        r: Upper triangle, shape (b, b).
        z: Right-hand side, shape (b,).
        rest: Part of the squared residual that no beta can remove.
        rows: Number of rows behind it.
    """

    r: Array
    z: Array
    rest: float
    rows: int

    @property
    def column_norms(self) -> Array:
        """Norm of each column of the weighted observation matrix, shape (b,)."""
        return np.linalg.norm(self.r, axis=0)

    def residual_square(self, beta: Array) -> float:
        """Return the weighted sum of squared residuals at ``beta``."""
        return float(np.sum((self.r @ beta - self.z) ** 2)) + self.rest


def reduce(triangles: Sequence[Triangle], size: int, weights: Sequence[float] | Array) -> Reduced:
    """Stack the joints' triangles, each times its weight, and reduce them to one of ``size`` columns."""
    stacked = np.zeros((sum(len(t.factor) for t in triangles) + size + 1, size + 1))
    row = 0
    for triangle, weight in zip(triangles, weights, strict=True):
        rows = slice(row, row + len(triangle.factor))
        stacked[rows, np.append(triangle.columns, size)] = weight * triangle.factor
        row = rows.stop
    with one_blas_thread():
        factor = triangle_of(stacked)
    return Reduced(factor[:size, :size], factor[:size, size], float(factor[size, size] ** 2), _rows(triangles))


def without_own(parts: Sequence[Sequence[Triangle]], size: int) -> tuple[list[Triangle], int, Callable[[Array], Array]]:
    """Return the triangle of each joint without the columns that it alone has, such as its friction.

    A fit of the others leaves the same residuals (Frisch and Waugh 1933). Own columns of a joint that depend on each
    other stay.

    Args:
        parts: Triangles of each joint, of one part of its rows or of several.
        size: Number of all columns.

    Returns:
        The triangles, their columns counted among the k that are left; k; and what makes all coefficients, (size,), of
        the k of a fit.
    """
    left, found = np.bincount(np.concatenate([own[0].columns for own in parts]), minlength=size) > 1, []
    for own in parts:
        order = np.argsort(left[own[0].columns], kind="stable")
        columns, factor = own[0].columns[order], np.concatenate([part.factor for part in own])
        factor = triangle_of(factor[:, np.append(order, len(order))])
        count, squares = int(np.sum(~left[columns])), factor[:, :-1] ** 2
        least = ROUNDING**2 * squares.sum(axis=0)
        if len(factor) < count or np.any(np.diag(squares)[:count] <= least[:count]):
            left[columns], count = True, 0
        factor[count:, :-1] *= squares[count:].sum(axis=0) > least
        found.append((columns, factor, count, _rows(own)))
    places = np.cumsum(left) - 1
    triangles = [Triangle(places[columns[k:]], factor[k:, k:], rows) for columns, factor, k, rows in found]

    def completed(beta: Array) -> Array:
        every = np.zeros(size)
        every[left] = beta
        for columns, factor, k, _ in found:
            every[columns[:k]] = solve_upper(factor[:k, :k], factor[:k, -1] - factor[:k, k:-1] @ every[columns[k:]])
        return every

    return triangles, int(left.sum()), completed


def _rows(triangles: Sequence[Triangle]) -> int:
    return sum(triangle.rows for triangle in triangles)


@dataclass(frozen=True)
class LeastSquares:
    """Solution of a reduced problem.

    Attributes:
        beta: Minimiser, shape (b,).
        root: R^-1, shape (b, b).
        scaled: R with unit columns.
    """

    beta: Array
    root: Array
    scaled: Array

    @cached_property
    def unscaled_covariance(self) -> Array:
        """(R'R)^-1, shape (b, b); times the residual variance it is the covariance."""
        return self.root @ self.root.T

    @cached_property
    def singular_values(self) -> Array:
        """Those of R with unit columns, largest first, shape (b,)."""
        return np.linalg.svd(self.scaled, compute_uv=False)

    @property
    def condition_number(self) -> float:
        """Their ratio."""
        s = self.singular_values
        return float(s[0] / s[-1]) if len(s) and s[-1] > 0 else np.inf


def least_squares(problem: Reduced, tolerance: float = 1e-10) -> LeastSquares:
    """Solve min |R beta - z|; directions whose singular values with unit columns are below tolerance stay zero."""
    norms = problem.column_norms
    scale = np.where(norms > 0, norms, 1.0)
    scaled = problem.r / scale
    inverse = _inverse(scaled, tolerance)
    if inverse is None:
        u, s, vt = np.linalg.svd(scaled)
        keep = s > tolerance * s[0] if len(s) and s[0] > 0 else np.zeros(len(s), bool)
        inverse = (vt.T * np.where(keep, 1.0 / np.where(keep, s, 1.0), 0.0)) @ u.T
    root = inverse / scale[:, None]
    return LeastSquares(root @ problem.z, root, scaled)


def _inverse(upper: Array, tolerance: float) -> Array | None:
    """Return the inverse of a triangle; None where its condition, <= b times that by sums of columns, may be high."""
    if len(upper) != upper.shape[1] or np.any(np.tril(upper, -1)) or not np.all(np.diag(upper)):
        return None
    inverse = solve_upper(upper, np.eye(len(upper)))
    bound = len(upper) * np.prod([np.abs(each).sum(axis=0).max(initial=0.0) for each in (upper, inverse)])
    return inverse if bound < 1.0 / tolerance else None
