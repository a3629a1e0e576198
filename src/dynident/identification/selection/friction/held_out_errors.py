"""Held-out errors of a model with several values of a friction field, or several lists of parts.

Where the delay of the torque is free, each list has the delay that fits all rows best with it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from dynident.arrays import Array, IntArray
from dynident.identification.selection.friction.column_pool import ColumnPool, beyond, fit, held_out, loss, without
from dynident.identification.selection.friction.variable_projection import minimum

#: Fewer blocks tell nothing about chance.
FEWEST = 3

#: Least mean squared residual that is told from none, in units of its joint's own.
TINY = 1e-12


@dataclass(frozen=True)
class HeldOut:
    """A model and others beside it, as products of the columns.

    Attributes:
        pool: The columns.
        held: For each delay, products of each block, the joints weighted by their residuals in the model, shape
            (B, c + 1, c + 1).
        fast: For each delay, products of the fastest rows, shape (c + 1, c + 1).
        keeps: Columns of the model, and of each value or list in place of its own.
        always: Columns that stay whatever their sign; None where all do.
    """

    pool: ColumnPool
    held: tuple[Array, ...]
    fast: tuple[Array, ...]
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
        weights = pool.weights(model) if weights is None else weights
        fast = np.einsum("i,ikl->kl", weights**2, pool.fast)
        keeps = tuple(np.sort(pool.chosen(own)) for own in sets)
        return cls(pool, pool.by_delay(pool.weighted(weights)), pool.by_delay(fast), keeps)

    def with_parts(self, sets: Sequence[Sequence[Sequence[int]]]) -> HeldOut:
        """Return lists of parts in place of its own, without coefficients of a wrong sign that the model has not."""
        keeps = tuple(np.sort(self.pool.chosen(own)) for own in sets)
        return replace(self, keeps=keeps, always=self.keeps[0])

    @cached_property
    def rows(self) -> IntArray:
        """Rows of each block, shape (B,)."""
        return self.pool.rows.sum(axis=1)

    @property
    def tells(self) -> bool:
        """Whether there are rows enough to hold some out."""
        return len(self.rows) >= FEWEST and bool(np.min(self.rows) >= 2 * len(self.keeps[0]))

    @cached_property
    def _wholes(self) -> list[Array]:
        return [held.sum(axis=0) for held in self.held]

    @cached_property
    def _rests(self) -> list[Array]:
        return [without(whole, held) for whole, held in zip(self._wholes, self.held, strict=True)]

    @cached_property
    def _best(self) -> list[tuple[float, int, IntArray]]:
        """The least loss of each list, at which delay, and its columns there."""
        found = []
        for keep in self.keeps:
            each = []
            for view, whole in enumerate(self._wholes):
                own = keep if self.always is None else self.pool.possible(whole, keep, self.always)
                each.append((loss(whole, own, fit(whole, own)), view, own))
            found.append(min(each, key=lambda one: one[0]))
        return found

    def errors(self, fastest: bool = True) -> list[Array]:
        """Return the logarithms of the held-out errors of each: of the blocks, and of the fastest rows, (B + 1,)."""
        found = [held_out(self.held[view], self._rests[view], self.rows, keep) for _, view, keep in self._best]
        if fastest:
            count, shared = max(int(self.pool.fast_rows.sum()), 1), self.pool.shared
            last = [beyond(self._wholes[view], self.fast[view], keep, shared) / count for _, view, keep in self._best]
            found = [np.append(each, own) for each, own in zip(found, last, strict=True)]
        return [np.log(np.maximum(each, TINY)) for each in found]

    def finest(self, grid: Array) -> float:
        """Return the value between those of a grid that fits all rows best."""
        losses = np.array([each for each, _, _ in self._best[1:]])
        return minimum(np.log(grid), losses, float(np.sum(self.rows)))[0]
