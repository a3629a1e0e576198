"""Ways to read a log, compared on samples that they were not fitted to.

What is found among many readings of the same samples says too much good of itself (Stone 1974). So readings are ranked
by their error under cross-validation: a log is cut into blocks, every other block is fitted and those between are
predicted, and the reverse. Two readings whose difference is within its standard error (jackknife over the blocks, Efron
1982, chapter 3) are not told apart. The search as such is held out as well: a reading is named only where the best one
that one half of the log finds predicts the other half better, both ways.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from dynident.arrays import Array, BoolArray
from dynident.diagnosis.causes.quick_fit import FEWEST_ROWS, FitRows, QuickFit
from dynident.diagnosis.causes.weighted_fit import Solved, TargetProducts

#: Blocks of a log of which every other one learns.
BLOCKS = 16


def halves(count: int) -> tuple[BoolArray, BoolArray]:
    """Return every other block of a log's rows and those between, shape (N,) each: one learns, the other judges."""
    first = (np.arange(count) * BLOCKS // max(count, 1)) % 2 == 0
    return first, ~first


def judged(masks: BoolArray) -> BoolArray:
    """Return which joints have rows enough in both halves, shape (n,); ``masks`` are those of all rows, (N, n)."""
    return np.all([masks[half].sum(axis=0) >= FEWEST_ROWS for half in halves(len(masks))], axis=0)


@dataclass(frozen=True)
class ReadRows:
    """The rows of a log read in some way.

    Attributes:
        rows: The rows; base parameters may be others than those of the quick fit.
        mixing: Torques at the joints = mixing @ (measured torques), shape (n, n).
    """

    rows: FitRows
    mixing: Array

    def fitted(self, masks: BoolArray) -> Solved:
        """Return the fit of the rows that ``masks`` (N, n) counts."""
        return self.products(masks).fitted()

    def products(self, masks: BoolArray) -> TargetProducts:
        """Return the products of the rows that ``masks`` (N, n) counts."""
        size = 1 + max(int(own.max()) for own in self.rows.columns)
        target = self.target
        joints = target.shape[1]
        grams, sides, squares = np.zeros((joints, size, size)), np.zeros((joints, size)), np.zeros(joints)
        for i, (block, own) in enumerate(zip(self.rows.blocks, self.rows.columns, strict=True)):
            kept, torque = block[masks[:, i]], target[masks[:, i], i]
            grams[i][np.ix_(own, own)], sides[i][own], squares[i] = kept.T @ kept, kept.T @ torque, torque @ torque
        return TargetProducts(grams, sides, squares, masks.sum(axis=0).astype(float))

    @property
    def target(self) -> Array:
        """Torques at the joints less what is known of them, shape (N, n)."""
        return self.rows.torque @ self.mixing.T - self.rows.known

    def residual(self, beta: Array) -> Array:
        """Return the residuals at the joints, shape (N, n)."""
        predicted = [block @ beta[own] for block, own in zip(self.rows.blocks, self.rows.columns, strict=True)]
        return self.target - np.stack(predicted, axis=1)

    def squared_errors(self, beta: Array) -> Array:
        """Return the squared residuals in the measured torques, shape (N, n)."""
        return (self.residual(beta) @ np.linalg.inv(self.mixing).T) ** 2

    def squared_errors_alone(self, beta: Array, masks: BoolArray, ridge: float) -> Array:
        """Return them with parameters of each joint's own, drawn to beta, from the rows that ``masks`` counts."""
        left = self.residual(beta)
        for i, block in enumerate(self.rows.blocks):
            kept = block[masks[:, i]]
            gram = kept.T @ kept
            scale = np.sqrt(np.diag(gram))
            scale[scale == 0.0] = 1.0
            pulled = gram / np.outer(scale, scale) + ridge * np.eye(len(gram))
            left[:, i] -= block @ (np.linalg.solve(pulled, kept.T @ left[masks[:, i], i] / scale) / scale)
        return (left @ np.linalg.inv(self.mixing).T) ** 2


class HeldOutErrors:
    """Errors of readings of one log, each block predicted by a fit of the other half."""

    def __init__(self, fit: QuickFit) -> None:
        self._fit, self._masks, self._half = fit, fit.rows.masks, halves(len(fit.rows.torque))[0]
        self._judged = judged(self._masks)
        self._blocks = np.arange(len(self._half)) * BLOCKS // max(len(self._half), 1)

    @cached_property
    def plain(self) -> Array:
        """Those of the log as stated, shape (blocks, n)."""
        return self.errors(as_stated(self._fit))

    def errors(self, reading: ReadRows, ridge: float | None = None) -> Array:
        """Return the sum of the squared errors of each block and measured torque, shape (blocks, n); 0 of few rows.

        Args:
            reading: How the rows are read.
            ridge: Draws parameters of each joint's own to those of all joints; None for those of all joints.
        """
        found = np.zeros(self._masks.shape)
        for half in (self._half, ~self._half):
            masks = self._masks & half[:, None]
            beta = reading.fitted(masks).beta
            alone = ridge is not None
            errors = reading.squared_errors_alone(beta, masks, ridge) if alone else reading.squared_errors(beta)
            found[~half] = errors[~half]
        kept = np.where(self._masks & self._judged, found, 0.0)
        return np.stack([kept[self._blocks == block].sum(axis=0) for block in range(BLOCKS)])

    def gain(self, errors: Array) -> float:
        """Return by how much errors (blocks, n) are below those of the log as stated, in log variance."""
        return _gain(self.plain, errors)

    @staticmethod
    def difference(one: Array, other: Array) -> tuple[float, float]:
        """Return by how much the errors ``one`` are below ``other``, in log variance, and the standard error of it."""
        left_out = [_gain(np.delete(other, k, 0), np.delete(one, k, 0)) for k in range(len(one))]
        spread = float(np.sqrt((len(one) - 1) * np.var(left_out)))
        return _gain(other, one), spread


def as_stated(fit: QuickFit) -> ReadRows:
    """Return the rows as the case reads them."""
    return ReadRows(fit.rows, np.eye(fit.model.robot.dof))


def predicts_unseen(fit: QuickFit, find: Callable[[QuickFit], ReadRows | None]) -> bool:
    """Return whether what ``find`` finds on one half of a log predicts the other half better, both ways.

    A cause that is none of the columns' can be taken in by the columns of another joint, where it lowers the sum by one
    joint alone. So each torque that is read at another joint must be predicted better there.
    """
    sums, moved = np.zeros((2, len(fit.counts))), np.zeros(len(fit.counts), bool)  # of the log as stated, and as read
    for half in halves(len(fit.rows.torque)):
        learned, unseen = fit.part(half), fit.part(~half).rows.masks
        reading = find(learned)
        if reading is None:
            return False
        for k, read in enumerate((as_stated(fit), reading)):
            beta = read.fitted(learned.rows.masks).beta
            sums[k] += np.where(unseen, read.squared_errors(beta), 0.0).sum(axis=0)
        moved |= np.diag(reading.mixing) == 0
    gains = np.where(judged(fit.rows.masks), np.log(np.maximum(sums[0], 1e-300) / np.maximum(sums[1], 1e-300)), 0.0)
    return bool(gains.sum() > 0 and (gains[moved] > 0).all())


def _gain(before: Array, after: Array) -> float:
    sums = [np.maximum(each.sum(axis=0), 1e-300) for each in (before, after)]
    return float(np.sum(np.log(sums[0] / sums[1])))
