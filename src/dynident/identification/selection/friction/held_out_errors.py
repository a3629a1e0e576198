"""Held-out errors of a model with several values of a friction field, or several lists of parts.

Where the delay of the torque is free, each list has the delay that fits all rows best with it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from dynident.arrays import Array, IntArray
from dynident.identification.residuals.quantiles import student_quantile
from dynident.identification.selection.friction.column_pool import ColumnPool
from dynident.identification.selection.friction.nested_fits import NestedFits, beyond, without

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
        known = np.append(np.arange(len(pool.bodies) - 1), -1)
        self.bodies = np.zeros_like(self.wholes[0])
        self.bodies[known[:, None], known] = pool.bodies

    @cached_property
    def all(self) -> list[NestedFits]:
        """The fits of all rows, for each delay."""
        return [NestedFits((whole + self.bodies)[None], whole[None], self.pool.shared) for whole in self.wholes]

    @cached_property
    def fast(self) -> list[tuple[Array, Array]]:
        """Products of all rows but the fastest, and of these, for each delay."""
        fast = self.pool.by_delay(self.pool.weighted(self.weights, self.pool.fast)[0])
        return [(without(whole, each), each) for whole, each in zip(self.wholes, fast, strict=True)]

    def blocks(self, view: int, columns: IntArray) -> NestedFits:
        """Return the fits of some columns that leave out one block each, judged on it, with one of the delays."""
        own = np.append(columns, -1)
        at, pick = self.pool.views[view][own], (own[:, None], own)
        held = self._products[:, at[:, None], at]
        return NestedFits(without(self.wholes[view][pick], held) + self.bodies[pick], held, self.pool.shared)


@dataclass(frozen=True)
class HeldOut:
    """A model and others beside it, as products of the columns.

    Attributes:
        weighed: The columns.
        keeps: Columns of the model, and of each value or list in place of its own.
        always: Columns that stay whatever their sign; None where all do.
    """

    weighed: WeighedRows
    keeps: tuple[IntArray, ...]
    always: IntArray | None = None

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
        return cls(weighed, tuple(np.sort(pool.chosen(own)) for own in sets))

    def with_parts(self, sets: Sequence[Sequence[Sequence[int]]]) -> HeldOut:
        """Return lists of parts in place of its own, without coefficients of a wrong sign that the model has not."""
        keeps = tuple(np.sort(self.weighed.pool.chosen(own)) for own in sets)
        return replace(self, keeps=keeps, always=self.keeps[0])

    @property
    def tells(self) -> bool:
        """Whether there are rows enough to hold some out."""
        rows = self.weighed.rows
        return len(rows) >= FEWEST and bool(np.min(rows) >= 2 * len(self.keeps[0]))

    @cached_property
    def best(self) -> list[tuple[float, int, IntArray]]:
        """The least loss of each list, at which delay, and its columns there."""
        found = []
        for keep in self.keeps:
            each = []
            for view, whole in enumerate(self.weighed.all):
                own = keep if self.always is None else self.weighed.pool.possible(whole, keep, self.always)
                each.append((float(whole.losses(own)[0]), view, own))
            found.append(min(each, key=lambda one: one[0]))
        return found

    @cached_property
    def _held(self) -> list[tuple[NestedFits, IntArray]]:
        """Of each list the fits that leave out one block each, and its places among their columns."""
        views = {view for _, view, _ in self.best}
        own = {v: np.unique(np.concatenate([keep for _, view, keep in self.best if view == v])) for v in views}
        fits = {view: self.weighed.blocks(view, columns) for view, columns in own.items()}
        return [(fits[view], np.searchsorted(own[view], keep)) for _, view, keep in self.best]

    def errors(self) -> list[Array]:
        """Return the logarithms of the held-out errors of each: of the blocks, and of the fastest rows, (B + 1,)."""
        weighed = self.weighed
        rows, count = np.maximum(weighed.rows, 1), max(int(weighed.pool.fast_rows.sum()), 1)
        found = [fits.losses(places) / rows for fits, places in self._held]
        for k, (_, view, keep) in enumerate(self.best):
            beta = weighed.all[view].residual(keep)[0, :-1]
            found[k] = np.append(found[k], beyond(beta, *weighed.fast[view], keep, weighed.pool.shared) / count)
        return [np.log(np.maximum(each, TINY)) for each in found]

    def by_joint(self) -> list[Array]:
        """Return the held-out squared residuals of each, unweighted, of the blocks and joints, (B, n)."""
        pool, found = self.weighed.pool, []
        for (_, view, keep), (fits, places) in zip(self.best, self._held, strict=True):
            mixed = fits.residual(places)
            every = np.zeros((len(mixed), pool.size))
            every[:, pool.views[view][np.append(keep, -1)]] = mixed
            pairs = [(every[:, own], each) for own, each in zip(pool.places, pool.products, strict=True)]
            found.append(np.stack([np.einsum("bi,bij,bj->b", own, each, own) for own, each in pairs], axis=1))
        return found


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
