"""Errors of blocks of rows, and of rows beyond the range of a fit, by fits that have not seen them.

Errors are compared by their ratios, joint by joint: a block or a drive of large torques has no more say than others.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from dynident.arrays import Array, IntArray
from dynident.identification.residuals.quantiles import student_quantile
from dynident.identification.selection.friction.column_pool import ColumnPool, fit, fit_inside, loss, losses
from dynident.identification.selection.friction.variable_projection import minimum

#: Blocks of rows at least: fewer tell nothing about chance.
FEWEST = 3

#: Chance of a difference as large where there is none.
CHANCE = 0.05

#: What takes less than this share off the held-out error is not worth it.
NOTHING = 5e-3

#: Least mean squared residual that is told from none, in units of its joint's own.
TINY = 1e-12


@dataclass(frozen=True)
class FoldErrors:
    """A model with several values of a field, or several lists of parts, as products of the columns.

    Attributes:
        held: Products of each block and joint, weighted by its residuals in the model, shape (B, n, c + 1, c + 1).
        rows: Rows of them, shape (B, n).
        outer: Products of the outer rows of each kind and joint, shape (3, n, c + 1, c + 1), and their rows.
        shared: Number of columns that every fit has.
        families: Columns of the model, and of each value or list in place of its own; of several sets that is meant
            which fits the rows of a fit best.
    """

    held: Array
    rows: IntArray
    outer: tuple[Array, IntArray]
    shared: int
    families: tuple[Sequence[IntArray], ...]

    @classmethod
    def of(cls, pool: ColumnPool, weights: Array, sets: Sequence[Sequence[Sequence[int]]]) -> FoldErrors:
        """Return the models whose drives have the parts ``sets[k][drive]``."""
        own = (weights**2)[:, None, None]
        families = tuple([np.sort(pool.chosen(each))] for each in sets)
        return cls(pool.products * own, pool.rows, (pool.outer * own, pool.outer_rows), pool.shared, families)

    @cached_property
    def whole(self) -> Array:
        """Products of all rows, shape (c + 1, c + 1)."""
        return self.held.sum(axis=(0, 1))

    @property
    def blocks(self) -> int:
        """Number of blocks."""
        return len(self.held)

    @property
    def tells(self) -> bool:
        """Whether there are rows enough to hold some out."""
        return len(self.held) >= FEWEST and bool(np.min(self.rows.sum(axis=1)) >= 2 * len(self.families[0][0]))

    def errors(self, outer: bool = True) -> list[Array]:
        """Return the logarithms of the held-out errors of each, the mean of the joints: of blocks and outer rows."""
        found = [
            [self._fold(family, *fold) for fold in zip(self.held, self.rows, strict=True)] for family in self.families
        ]
        for family, errors in zip(self.families, found, strict=True) if outer else ():
            errors += [self._fold(family, *fold, is_outer=True) for fold in zip(*self.outer, strict=True)]
        return [np.array(errors) for errors in found]

    def _fold(self, family: Sequence[IntArray], own: Array, rows: IntArray, is_outer: bool = False) -> float:
        """Return the logarithm of the error of some rows, by a fit of the others with the columns that suit it best."""
        left = own.sum(axis=0)
        seen = self.whole - left
        fits = [
            fit_inside(self.whole, left, keep, self.shared)
            if is_outer
            else (beta := fit(seen, keep), loss(seen, keep, beta))
            for keep in family
        ]
        best = int(np.argmin([value for _, value in fits]))
        return _mean_log(losses(own, family[best], fits[best][0]), rows)

    def losses(self) -> Array:
        """Return the sum of squared residuals of all rows for each but the model itself."""
        return np.array([loss(self.whole, keep, fit(self.whole, keep)) for (keep,) in self.families[1:]])

    def finest(self, grid: Array) -> float:
        """Return the value between those of a grid that fits all rows best."""
        return minimum(np.log(grid), self.losses(), float(np.sum(self.rows)))[0]


def _mean_log(squares: Array, rows: IntArray) -> float:
    """Return the mean of the logarithms of the joints' mean squares, from sums (n,): each joint has the same say."""
    some = rows > 0
    return float(np.mean(np.log(np.maximum(squares[some] / rows[some], TINY)))) if some.any() else 0.0


def share_of(gaps: Array) -> tuple[float, float]:
    """Return the share that is taken off an error and its standard error, from logarithms of its ratios (B,)."""
    return float(-np.expm1(-np.mean(gaps))), float(np.std(gaps, ddof=1) / np.sqrt(len(gaps)))


def goes_on(gaps: Array, blocks: int) -> bool:
    """Return whether errors of outer rows, those after the blocks, grow by no more than that of a block does by chance.

    ``gaps`` are logarithms of ratios of errors of the blocks and of the outer rows (B + 3,), above 0 where they fall.
    """
    chance = float(np.std(gaps[:blocks], ddof=1) * student_quantile(1.0 - CHANCE, blocks - 1))
    return bool(np.min(gaps[blocks:]) >= -(NOTHING + chance))


def is_better(gaps: Array) -> bool:
    """Return whether logarithms of ratios of errors (B,) are above nothing by more than chance."""
    gain, error = share_of(gaps)
    return gain > max(NOTHING, error * float(student_quantile(1.0 - CHANCE, len(gaps) - 1)))
