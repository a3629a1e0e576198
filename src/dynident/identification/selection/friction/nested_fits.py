"""Fits of many sets of columns that have most in common, from inner products: the common columns are taken out once.

The coefficients of the others are those of the Schur complement of the common ones (Frisch and Waugh 1933), and the
squares that a fit leaves are a quadratic form of them: 20 columns in place of 60, for all blocks of rows side by side.
"""

from __future__ import annotations

import numpy as np

from dynident.arrays import Array, IntArray

#: Ridge in units of a column's square: far above rounding of the products, far below what data say.
RIDGE = 1e-11


class NestedFits:
    """Least squares of blocks of rows, judged on other rows, for any set of columns that has the shared ones.

    Args:
        learned: Products [W, tau]' [W, tau] of the rows of each fit, shape (B, c + 1, c + 1).
        judged: Those of the rows whose residuals are asked for, of the same shape.
        shared: Number of columns that every set has, the first ones.
    """

    def __init__(self, learned: Array, judged: Array, shared: int) -> None:
        size = np.sqrt(np.diagonal(learned, axis1=1, axis2=2)[:, :-1])
        scale, ridge = np.where(size > 0, size, 1.0), RIDGE + (size == 0)
        first, cross = scale[:, :shared, None], learned[:, :shared, shared:]
        normal = learned[:, :shared, :shared] / (first * first.transpose(0, 2, 1))
        np.einsum("bkk->bk", normal)[:] += ridge[:, :shared]
        self.shared, self._scale, self._ridge = shared, scale[:, shared:], ridge[:, shared:]
        self._along = along = np.linalg.solve(normal, cross / first) / first
        taken = judged[:, :shared, :shared] @ along - 2.0 * judged[:, :shared, shared:]
        self._learned, self._judged = (learned[:, shared:, shared:], -cross), (judged[:, shared:, shared:], taken)

    def coefficients(self, keep: IntArray) -> Array:
        """Return the coefficients of the columns ``keep`` (k,) behind the shared ones, shape (B, k - shared)."""
        return self._mixed(keep)[0][:, :-1]

    def residual(self, keep: IntArray) -> Array:
        """Return the coefficients of all columns ``keep`` (k,), and -1 for the torque, shape (B, k + 1)."""
        mixed, every = self._mixed(keep)
        return np.append(-(self._along[:, :, every] @ mixed[:, :, None])[:, :, 0], mixed, axis=1)

    def losses(self, keep: IntArray) -> Array:
        """Return the sum of squared residuals of each block by the columns ``keep`` (k,), shape (B,)."""
        mixed, every = self._mixed(keep)
        return np.sum(mixed * (self._reduced(*self._judged, every) @ mixed[:, :, None])[:, :, 0], axis=1)

    def _reduced(self, products: Array, cross: Array, every: IntArray) -> Array:
        """Return the products of columns behind the shared ones with these taken out, by what that takes (B, s, c)."""
        return products[:, every[:, None], every] + self._along[:, :, every].transpose(0, 2, 1) @ cross[:, :, every]

    def _mixed(self, keep: IntArray) -> tuple[Array, IntArray]:
        """Return coefficients and -1 for the torque, (B, k - shared + 1), and their columns behind the shared ones."""
        own = keep[self.shared :] - self.shared
        scale, every = self._scale[:, own], np.append(own, -1)
        left = self._reduced(*self._learned, every)
        normal = left[:, :-1, :-1] / (scale[:, :, None] * scale[:, None])
        np.einsum("bkk->bk", normal)[:] += self._ridge[:, own]
        found = np.linalg.solve(normal, (left[:, :-1, -1] / scale)[:, :, None])[:, :, 0] / scale
        return np.append(found, np.full((len(found), 1), -1.0), axis=1), every


def without(whole: Array, part: Array) -> Array:
    """Return the products of the rows that are not in a part, both shape (..., c + 1, c + 1).

    A column all of whose rows are in the part has none left; what the difference leaves of it is rounding, of any sign.
    """
    left = whole - part
    size, all_rows = (np.diagonal(each, axis1=-2, axis2=-1) for each in (left, whole))
    stays = size > RIDGE * all_rows
    return left * (stays[..., :, None] & stays[..., None, :])


def fit(products: Array, keep: IntArray) -> Array:
    """Return the least-squares coefficients of the columns ``keep`` from inner products (c + 1, c + 1)."""
    normal, size = products[keep[:, None], keep], np.sqrt(products[keep, keep])
    scale = np.where(size > 0, size, 1.0)
    normal /= np.outer(scale, scale)
    np.einsum("kk->k", normal)[:] += RIDGE + (size == 0)
    return np.linalg.solve(normal, products[keep, -1] / scale) / scale


def beyond(beta: Array, slow: Array, fast: Array, keep: IntArray, shared: int) -> float:
    """Return the sum of squared residuals of the fastest rows, by friction that is fitted to all the others.

    The ``shared`` first columns of ``keep`` stay at their fit of all rows, ``beta`` (k,): what is asked is how friction
    goes on beyond the speeds it is fitted to. ``slow`` and ``fast`` are products of all other and of the fastest rows,
    (c + 1, c + 1).
    """
    own, every = np.append(keep[shared:], -1), np.append(keep, -1)
    left = slow[own[:, None], own]
    left[:, -1] -= slow[own[:, None], keep[:shared]] @ beta[:shared]
    mixed = np.concatenate([beta[:shared], fit(left, np.arange(len(own) - 1)), [-1.0]])
    return float(mixed @ fast[every[:, None], every] @ mixed)
