"""Weighted least squares of rows that are reduced already: triangles, their products, and the fit.

The rows of each joint are reduced to a triangle that keeps the torques of all joints as columns, so that a torque with
another sign, scale or joint costs no new rows. Each joint's rows weigh by their own residual variance.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np

from dynident.arrays import Array, IntArray
from dynident.model.lapack import solve_positive
from dynident.model.reduction import triangle_of

#: Passes of weighting.
PASSES = 6

#: Pull to zero, as a share of the weighted squares of each column: directions that no row tells stay at zero.
RIDGE = 1e-11

#: Least weighting variance, as a share of the largest of all joints: products of rows that weigh more drown the others.
LIGHTEST = 1e-9

#: A residual below this share of the joint's torque is none.
EXACT = 1e-4


@dataclass(frozen=True)
class Products:
    """What a fit needs of the rows of each joint, T all measured torques and the known one.

    Attributes:
        grams: W_i' W_i, shape (n, size, size).
        sides: W_i' T, shape (n, size, n + 1).
        squares: T' T, shape (n, n + 1, n + 1).
        whole: The same where columns have been taken out of T; None where ``squares`` are these.
    """

    grams: Array
    sides: Array
    squares: Array
    whole: Array | None = None


@dataclass(frozen=True)
class Triangles:
    """The rows of each joint, reduced; torques of any mixing need no others.

    Attributes:
        columns: Positions in beta of the columns of W_i, shape (K_i,) each.
        factors: Triangle of [W_i, all torques, known torque] of each joint.
        size: Length of beta.
    """

    columns: tuple[IntArray, ...]
    factors: tuple[Array, ...]
    size: int

    def __iter__(self) -> Iterator[tuple[IntArray, Array]]:
        return zip(self.columns, self.factors, strict=True)

    @cached_property
    def shared(self) -> Triangles:
        """The same rows with the columns that one joint alone has taken out: the residual of a fit is the same."""
        owners = np.bincount(np.concatenate(self.columns), minlength=self.size)
        places = np.cumsum(owners > 1) - 1
        columns, factors = [], []
        for own, factor in self:
            alone = owners[own] == 1
            targets = np.arange(len(own), factor.shape[1])
            order = np.concatenate([np.flatnonzero(alone), np.flatnonzero(~alone), targets])
            columns.append(places[own[~alone]])
            factors.append(triangle_of(factor[:, order])[alone.sum() :, alone.sum() :])
        return Triangles(tuple(columns), tuple(factors), int(np.sum(owners > 1)))

    @cached_property
    def products(self) -> Products:
        """Products of the columns and of all torques.

        Products of the triangles cost half the digits: enough for a comparison, not for a rank.
        """
        joints = len(self.columns)
        grams = np.zeros((joints, self.size, self.size))
        sides, squares = np.zeros((joints, self.size, joints + 1)), np.zeros((joints, joints + 1, joints + 1))
        for i, (own, factor) in enumerate(self):
            columns, torques = factor[:, : len(own)], factor[:, len(own) :]
            grams[i][np.ix_(own, own)] = columns.T @ columns
            sides[i][own], squares[i] = columns.T @ torques, torques.T @ torques
        return Products(grams, sides, squares)


@dataclass(frozen=True)
class Solved:
    """A weighted fit.

    Attributes:
        beta: Shape (b,); further columns follow the base parameters where there are any.
        variances: Residual variance of each joint, shape (n,).
        score: Sum of their logarithms; lower is likelier.
        information: Weighted products of the columns, the inverse of the covariance for independent rows.
        surprise: Squared distance from what was known of beta before, in its deviations; 0 where nothing was.
        freedom: Errors of the bodies from which the deviations of known bodies were found; infinite where these are
            stated, or none are known.
    """

    beta: Array
    variances: Array
    score: float
    information: Array
    surprise: float = 0.0
    freedom: float = np.inf

    @cached_property
    def covariance(self) -> Array:
        """Covariance of beta for independent rows, shape (b, b); large of a column that rounding leaves nothing of."""
        squares = np.diag(self.information)
        sizes, lost = np.sqrt(np.where(squares > 0.0, squares, 1.0)), squares <= 0.0
        scales = np.outer(sizes, sizes)
        scaled = np.where(lost | lost[:, None], RIDGE * np.eye(len(sizes)), self.information / scales)
        return np.linalg.inv(scaled) / scales

    def last_of_others(self, count: int) -> Array:
        """Return the ``count`` last columns by least squares of the others, negative, shape (count, b - count)."""
        others = len(self.information) - count
        found = solve_positive(self.information[:others, :others], self.information[:others, others:])
        if found is None:
            found = np.linalg.solve(self.information[:others, :others], self.information[:others, others:])
        return -found.T


@dataclass(frozen=True)
class TargetProducts:
    """What a fit needs of the rows of each joint with one torque tau_i.

    Attributes:
        grams: W_i' W_i, shape (n, size, size).
        sides: W_i' tau_i, shape (n, size).
        squares: tau_i' tau_i, shape (n,).
        counts: Rows, shape (n,).
    """

    grams: Array
    sides: Array
    squares: Array
    counts: Array

    @classmethod
    def summed(cls, parts: Sequence[TargetProducts]) -> TargetProducts:
        """Return those of all rows together."""
        return cls(*(np.sum([getattr(part, one.name) for part in parts], axis=0) for one in fields(cls)))

    def fitted(self) -> Solved:
        """Return the weighted fit."""
        return weighted_products(self.grams, self.sides, self.squares, *self._counts_and_floors)

    def variances(self, beta: Array) -> Array:
        """Return the residual variance of each joint with parameters (size,), shape (n,)."""
        left = self.squares - 2.0 * self.sides @ beta + (self.grams @ beta) @ beta
        counts, floors = self._counts_and_floors
        return np.maximum(left / counts, floors)

    @property
    def _counts_and_floors(self) -> tuple[Array, Array]:
        counts = np.maximum(self.counts, 1.0)
        return counts, np.maximum(EXACT**2 * self.squares / counts, 1e-300)


def weighted_products(
    grams: Array, sides: Array, squares: Array, counts: Array, floors: Array, start: Array | None = None
) -> Solved:
    """Return the fit in which each joint's rows weigh by their own residual variance.

    Args:
        grams: Products of the columns of each joint's rows, shape (n, k, k).
        sides: Products of columns and target, shape (n, k).
        squares: Sum of the squared target, shape (n,).
        counts: Rows of each joint, shape (n,).
        floors: Residual variance of each joint at least, shape (n,).
        start: Where the variances begin, shape (n,); None for those of the target.
    """
    first = None if start is None else start[None]
    (beta,), (variances,), (gram,) = _weighted(grams, sides[None], squares[None], counts, floors[None], first)
    return Solved(beta, variances, float(np.sum(np.log(variances))), gram)


def weighted_variances(grams: Array, sides: Array, squares: Array, counts: Array, floors: Array) -> Array:
    """Return the residual variances of m such fits, made side by side, shape (m, n).

    Args:
        grams: Products of the columns, shape (m, n, k, k), or those of all fits, shape (n, k, k).
        sides: Shape (m, n, k).
        squares: Shape (m, n).
        counts: Rows of each joint, shape (n,).
        floors: Shape (m, n).
    """
    return _weighted(grams, sides, squares, counts, floors)[1]


def _weighted(
    grams: Array, sides: Array, squares: Array, counts: Array, floors: Array, start: Array | None = None
) -> tuple[Array, Array, Array]:
    """Return beta (m, k), residual variances (m, n) and weighted products (m, k, k) of fits side by side."""
    many, _, size = sides.shape
    norms = np.sqrt(np.einsum("...ikk->...k", grams))
    scale = np.where(norms > 0, norms, 1.0)
    square = scale[..., :, None] * scale[..., None, :]
    grams, sides = grams / square[..., None, :, :], sides / scale[..., None, :]
    flat = grams.reshape(*grams.shape[:-2], -1)
    variances = squares / counts + floors if start is None else start
    beta, gram = np.zeros((many, size)), np.zeros((many, size, size))
    for _ in range(PASSES):
        weights = 1.0 / np.maximum(variances, LIGHTEST * variances.max(axis=1, keepdims=True))
        sums = weights @ flat if flat.ndim == 2 else (weights[:, None] @ flat)[:, 0]
        gram, diagonal = sums.reshape(many, size, size), sums[:, :: size + 1]  # views
        strongest = 1e-300 + diagonal.max(axis=1, initial=0.0, keepdims=True)
        diagonal += RIDGE * np.where(diagonal > 0.0, diagonal, strongest)
        beta = _solved(gram, (weights[:, None] @ sides)[:, 0])
        turned = grams @ beta.T if flat.ndim == 2 else (grams @ beta[:, None, :, None])[..., 0].transpose(1, 2, 0)
        left = squares - 2 * (sides @ beta[:, :, None])[..., 0] + (turned * beta.T).sum(axis=1).T
        variances = np.maximum(left, 0.0) / counts + floors
    return beta / scale, variances, gram * square


def _solved(grams: Array, sides: Array) -> Array:
    """Return the solutions (m, k) of positive systems (m, k, k); one alone by Cholesky, in half the arithmetic."""
    found = solve_positive(grams[0], sides[0]) if len(grams) == 1 else None
    return np.linalg.solve(grams, sides[:, :, None])[:, :, 0] if found is None else found[None]
