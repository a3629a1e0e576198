"""Held-out errors of a model with several values of a friction field, or several lists of parts.

Where the delay of the torque is free, each list has the delay that fits all rows best with it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from dynident.arrays import Array, BoolArray, IntArray
from dynident.identification.residuals.quantiles import student_quantile
from dynident.identification.selection.friction.column_pool import ColumnPool
from dynident.identification.selection.friction.nested_fits import beyond, entries, nested_fits, stays

#: Blocks of rows at least, and of logs too short for these.
BLOCKS, OF_SHORT_LOGS = 16, 8

#: Fewer blocks tell nothing about chance.
FEWEST = 3

#: Chance of a difference as large where there is none.
CHANCE = 0.05

#: A value that takes less than this share off the held-out error is not worth another one than the stated.
NOTHING = 5e-3

#: Likewise a part with fields of its own: 1 % of the error, as of the best of many values some is chance.
OF_A_PART = 2e-2

#: Least mean squared residual that is told from none, in units of its joint's own.
TINY = 1e-12


class WeighedRows:
    """Products of the columns, the joints weighted by their residuals in a model, and fits of them, made once.

    Args:
        pool: The columns.
        weights: Of the rows of each joint, shape (n,).
    """

    def __init__(self, pool: ColumnPool, weights: Array) -> None:
        self.pool, self.weights, self.rows = pool, weights, pool.rows.sum(axis=1)
        self._products = pool.weighted(weights)
        self.wholes = pool.by_delay(self._products.sum(axis=0))
        beside = np.full(self.wholes.shape[1] - len(pool.bodies), len(pool.bodies) - 1)
        self.bodies = np.insert(np.insert(pool.bodies, beside, 0.0, axis=0), beside, 0.0, axis=1)

    @cached_property
    def fast(self) -> Array:
        """Products of the fastest rows, for each delay."""
        return self.pool.by_delay(self.pool.weighted(self.weights, self.pool.fast)[0])

    def left_out(self, view: int, lists: BoolArray) -> tuple[Array, Array]:
        """Return what fits of lists (m, c) that leave out one block each leave of it, with one of the delays."""
        at, whole = self.pool.views[view], self.wholes[view]
        there = stays(np.diag(whole), np.einsum("bkk->bk", self._products)[:, at])

        def held(block: IntArray, rows: IntArray, columns: IntArray) -> Array:
            return self._products[block, at[rows], at[columns]]

        def rest(block: IntArray, rows: IntArray, columns: IntArray) -> Array:
            left = whole[rows, columns] - held(block, rows, columns)
            left = left if there.all() else left * (there[block, rows] & there[block, columns])
            return left + self.bodies[rows, columns]

        return nested_fits(rest, held, np.repeat(lists[None], len(self._products), axis=0))


@dataclass(frozen=True)
class HeldOut:
    """A model and others beside it, as products of the columns.

    Attributes:
        weighed: The columns.
        lists: Columns of the model, and of each value or list in place of its own, shape (m, c).
        always: Columns that stay whatever their sign, shape (c,); None where all do.
    """

    weighed: WeighedRows
    lists: BoolArray
    always: BoolArray | None = None

    @classmethod
    def of(
        cls,
        pool: ColumnPool,
        model: Sequence[Sequence[int]],
        sets: Sequence[Sequence[Sequence[int]]],
        weights: Array | None = None,
    ) -> HeldOut:
        """Return the models whose drives have the parts ``sets[k][drive]``.

        The rows of each joint are weighted by the fit of ``model``, or as stated, (n,).
        """
        weighed = WeighedRows(pool, pool.weights(model) if weights is None else weights)
        return cls(weighed, pool.lists(sets))

    def with_parts(self, sets: Sequence[Sequence[Sequence[int]]]) -> HeldOut:
        """Return lists of parts in place of its own, without coefficients of a wrong sign that the model has not."""
        return replace(self, lists=self.weighed.pool.lists(sets), always=self.lists[0])

    @property
    def tells(self) -> bool:
        """Whether there are rows enough to hold some out."""
        rows = self.weighed.rows
        return len(rows) >= FEWEST and bool(np.min(rows) >= 2 * np.sum(self.lists[0]))

    @cached_property
    def best(self) -> tuple[Array, IntArray, BoolArray, Array]:
        """The least loss of each list (m,), at which delay (m,), its columns there (m, c), and their fit (m, c + 1)."""
        weighed = self.weighed
        learned, judged = entries(weighed.wholes + weighed.bodies), entries(weighed.wholes)
        may_go = np.zeros_like(self.lists[0]) if self.always is None else weighed.pool.nonnegative & ~self.always
        lists = np.repeat(self.lists[None], len(weighed.wholes), axis=0)
        losses, mixed = nested_fits(learned, judged, lists)
        while (wrong := may_go & lists & (mixed[..., :-1] < 0)).any():
            lists &= ~wrong
            losses, mixed = nested_fits(learned, judged, lists)
        at = (views := np.argmin(losses, axis=0)), np.arange(len(views))
        return losses[at], views, lists[at], mixed[at]

    @cached_property
    def _held(self) -> list[tuple[int, IntArray, Array, Array]]:
        """Of the fits that leave out one block each: a delay, its lists (m,), losses (B, m), coefficients (B, m, c)."""
        _, views, lists, _ = self.best
        each = [(view, np.flatnonzero(views == view)) for view in np.unique(views).tolist()]
        return [(view, own, *self.weighed.left_out(view, lists[own])) for view, own in each]

    def errors(self) -> list[Array]:
        """Return the logarithms of the held-out errors of each: of the blocks, and of the fastest rows, (B + 1,)."""
        weighed, pool = self.weighed, self.weighed.pool
        rows, count = np.maximum(weighed.rows, 1), max(int(pool.fast_rows.sum()), 1)
        _, _, lists, mixed = self.best
        found = np.empty((len(rows) + 1, len(lists)))
        for view, own, losses, _ in self._held:
            found[:-1, own] = losses / rows[:, None]
            fast = beyond(mixed[own], weighed.wholes[view], weighed.fast[view], lists[own], pool.shared)
            found[-1, own] = fast / count
        return list(np.log(np.maximum(found, TINY)).T)

    def by_joint(self) -> list[Array]:
        """Return the held-out squared residuals of each, unweighted, of the blocks and joints, (B, n)."""
        pool = self.weighed.pool
        every = np.zeros((len(self.weighed.rows), len(self.lists), pool.size))
        for view, lists, _, mixed in self._held:
            every[:, lists[:, None], pool.views[view]] = mixed
        joints = [(every[:, :, own], each) for own, each in zip(pool.places, pool.products, strict=True)]
        return list(np.stack([np.sum((own @ each) * own, axis=2).T for own, each in joints], axis=2))


def share_of(gaps: Array) -> tuple[float, float]:
    """Return the share that is taken off an error and its standard error, from logarithms of its ratios (B,)."""
    return 1.0 - (left := float(np.exp(-np.mean(gaps)))), left * float(np.std(gaps, ddof=1) / np.sqrt(len(gaps)))


def evidence(gaps: Array) -> tuple[float, float, float | None]:
    """Return that of such logarithms (B + 1,), and the share by the last of them alone; None where nothing differs."""
    return *share_of(gaps), float(-np.expm1(-gaps[-1])) or None


def is_better(gaps: Array, chance: float | None = CHANCE, least: float = NOTHING) -> bool:
    """Return whether logarithms of ratios of errors (B,) are above nothing by more than chance; None: by an error."""
    gain, error = share_of(gaps)
    sizes = 1.0 if chance is None else float(student_quantile(1.0 - chance, len(gaps) - 1))
    return gain > max(least, error * sizes / (1.0 - gain))  # that of the logarithm


def shortest_list(
    parts: Sequence[int], errors_of: Callable[[Sequence[tuple[int, ...]]], list[Array]]
) -> tuple[int, ...]:
    """Return the shortest of the lists, the best part added to each, that the best one is not better than."""
    path, scores = list[tuple[int, ...]]([()]), errors_of([()])
    while left := [p for p in parts if p not in path[-1]]:
        errors = errors_of(longer := [(*path[-1], p) for p in left])
        k = int(np.argmin([np.mean(each) for each in errors]))
        path.append(longer[k])
        scores.append(errors[k])
    means = [np.mean(each) for each in scores]
    best = next(each for each, mean in zip(scores, means, strict=True) if mean <= min(means) + NOTHING)
    return next(own for own, each in zip(path, scores, strict=True) if not is_better(each - best, None))
