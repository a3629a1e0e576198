"""Fits of many sets of columns that have most in common, from inner products: the common columns are taken out once.

The coefficients of the others are those of the Schur complement of the common ones (Frisch and Waugh 1933), and the
squares that a fit leaves are a quadratic form of them: 20 columns in place of 60, for all blocks of rows side by side.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import numpy as np

from dynident.arrays import Array, BoolArray, IntArray

#: Entries of products [W, tau]' [W, tau] of the rows of each fit, by fit, row and column.
Products: TypeAlias = Callable[[IntArray, IntArray, IntArray], Array]

#: Ridge in units of a column's square: far above rounding of the products, far below what data say.
RIDGE = 1e-11


def nested_fits(learned: Products, judged: Products, lists: BoolArray) -> tuple[Array, Array]:
    """Return the sum of squared residuals of each fit of a list of columns (B, m), and the fits, shape (B, m, c + 1).

    These have the coefficients of all columns, 0 of those that are not there, and -1 of the torque.

    Args:
        learned: Products of the rows of each of B fits.
        judged: Those of the rows whose residuals are asked for.
        lists: Columns of each list, shape (B, m, c).
    """
    always, size = lists.all(axis=(0, 1)), lists.shape[2] + 1
    common, others = np.flatnonzero(always), np.flatnonzero(lists.any(axis=(0, 1)) & ~always)
    block, many = np.arange(len(lists))[:, None, None], len(common)
    pick = block, common[:, None], np.concatenate([common, others, [-1]])
    strip, other = learned(*pick), judged(*pick)
    along = _solved(strip[:, :, :many], strip[:, :, many:], np.sqrt(np.einsum("bkk->bk", strip[:, :, :many])))
    taken = other[:, :, :many] @ along - 2.0 * other[:, :, many:]
    along, *each = (np.ascontiguousarray(own.swapaxes(1, 2)) for own in (along, -strip[:, :, many:], taken))
    at, there = _padded(lists[:, :, others])
    at, there = np.insert(at, at.shape[2], len(others), axis=2), np.insert(there, at.shape[2], True, axis=2)
    every, along = pick[2][many:][at], along[block, at]
    entry = block[..., None], every[..., :, None], every[..., None, :]
    left, judge = (
        own(*entry) + along @ take[block, at].swapaxes(2, 3) for own, take in zip((learned, judged), each, strict=True)
    )
    left *= there[..., :, None] & there[..., None, :]
    square = learned(block, every, every) * there
    found = np.full(there.shape, -1.0)
    found[..., :-1] = _solved(left[..., :-1, :-1], left[..., :-1, -1:], np.sqrt(square[..., :-1]))[..., 0]
    mixed = np.zeros((*lists.shape[:2], size))
    np.put_along_axis(mixed, every, found, axis=2)
    mixed[..., common], mixed[..., -1] = -(found[..., None, :] @ along)[..., 0, :], -1.0
    return np.sum((found[..., None, :] @ judge)[..., 0, :] * found, axis=2), mixed


def _padded(lists: BoolArray) -> tuple[IntArray, BoolArray]:
    """Return the places of what is in each list (..., c), shape (..., k), and which of them are: others are behind."""
    at = np.argsort(~lists, axis=-1, kind="stable")[..., : int(np.max(lists.sum(axis=-1), initial=0))]
    return at, np.take_along_axis(lists, at, axis=-1)


def entries(products: Array) -> Products:
    """Return the entries of products of several fits, shape (B, c + 1, c + 1)."""
    return lambda fit, rows, columns: products[fit, rows, columns]


def _solved(normal: Array, right: Array, size: Array) -> Array:
    """Return the solutions (..., k, r) of normal equations whose columns have these lengths (..., k)."""
    scale = np.where(size > 0, size, 1.0)[..., None]
    normal = normal / (scale * scale.swapaxes(-1, -2))
    np.einsum("...kk->...k", normal)[:] += RIDGE + (size == 0)
    return np.linalg.solve(normal, right / scale) / scale


def stays(whole: Array, part: Array) -> BoolArray:
    """Return which columns have rows that are not in a part, from the squares of all rows and of those, (..., c)."""
    return whole - part > RIDGE * whole  # where all rows are in the part, the difference is rounding, of any sign


def fit(products: Array, keep: IntArray) -> Array:
    """Return the least-squares coefficients of the columns ``keep`` from inner products (c + 1, c + 1)."""
    return _solved(products[keep[:, None], keep], products[keep, -1:], np.sqrt(products[keep, keep]))[:, 0]


def beyond(mixed: Array, whole: Array, fast: Array, lists: BoolArray, shared: int) -> Array:
    """Return the sum of squared residuals of the fastest rows, by friction that is fitted to all the others, (m,).

    The ``shared`` first columns stay at their fits of all rows, ``mixed`` (m, c + 1): what is asked is how friction
    goes on beyond the speeds it is fitted to. ``whole`` and ``fast`` are products of all and of the fastest rows,
    (c + 1, c + 1), ``lists`` the columns of each list, (m, c).
    """
    has = stays(np.diag(whole), np.diag(fast))
    slow = (whole - fast) * (has[:, None] & has)
    own, there = _padded(lists[:, shared:])
    own += shared
    normal = slow[own[:, :, None], own[:, None, :]] * (there[:, :, None] & there[:, None, :])
    left = np.take_along_axis(slow[-1] - mixed[:, :shared] @ slow[:shared], own, axis=1) * there
    found = mixed * (np.arange(mixed.shape[1]) < shared)
    fitted = _solved(normal, left[..., None], np.sqrt(np.einsum("mkk->mk", normal)))[..., 0]
    np.put_along_axis(found, own, fitted, axis=1)
    found[:, -1] = -1.0
    return np.sum((found @ fast) * found, axis=1)
