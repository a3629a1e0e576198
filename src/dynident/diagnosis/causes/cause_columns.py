"""Columns of a fit and of causes at each joint, and their products, made once for all fits with some of the causes.

Columns that one joint alone has, as its friction, may be taken out of all others there by an orthogonal projection: the
residual of a fit is the same (Frisch and Waugh 1933). A column stands at the joints where it is not zero.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from dynident.arrays import Array, BoolArray, IntArray
from dynident.diagnosis.causes.weighted_fit import RIDGE


@dataclass(frozen=True)
class CauseRows:
    """Rows of a fit to which causes are added.

    Attributes:
        blocks: Observation matrix of each joint, shape (N, K_i).
        columns: Positions in beta of its columns, shape (K_i,) each.
        size: Length of beta.
        target: What is fitted, shape (N, n).
        measured: The torque that sizes are compared with, shape (N, n).
        masks: Which rows count, shape (N, n).
        oversampling: Rows for each that is independent where noise is white before the filter.
    """

    blocks: Sequence[Array]
    columns: Sequence[IntArray]
    size: int
    target: Array
    measured: Array
    masks: BoolArray
    oversampling: float = 1.0

    @cached_property
    def shared(self) -> BoolArray:
        """Which columns of beta more than one joint has, shape (size,)."""
        return np.bincount(np.concatenate(self.columns), minlength=self.size) > 1

    @cached_property
    def counted(self) -> tuple[Array, ...]:
        """The observation matrices, zero where rows do not count, shape (K_i, N) each."""
        return tuple(np.where(mask, block.T, 0.0) for mask, block in zip(self.masks.T, self.blocks, strict=True))

    @cached_property
    def counts(self) -> Array:
        """Rows of each joint that count, shape (n,), at least 1."""
        return np.maximum(self.masks.sum(axis=0), 1).astype(float)

    @property
    def worth(self) -> Array:
        """Independent rows of each joint where noise is white before the filter, shape (n,)."""
        return self.counts / self.oversampling


@dataclass(frozen=True)
class ColumnsAtJoint:
    """What stands at one joint.

    Attributes:
        places: Numbers of the S columns that are not zero here among those kept, those of causes and the target.
        columns: These, less what the joint's own explain, zero where rows do not count, shape (S, N).
        alone: Orthonormal, what the joint's own columns span, shape (o, N).
    """

    places: IntArray
    columns: Array
    alone: Array


@dataclass(frozen=True)
class SharedColumns:
    """Columns of all joints: those kept of a fit, in its order, those of causes, and the target.

    Attributes:
        size: Columns kept of the fit.
        joints: The columns of each joint.
        grams: Their products without the target, shape (n, k, k).
        sides: Those with the target, shape (n, k).
        squares: Sum of the squared target, shape (n,).
        whole: The same before the joint's own columns are taken out.
    """

    size: int
    joints: tuple[ColumnsAtJoint, ...]
    grams: Array
    sides: Array
    squares: Array
    whole: Array

    @classmethod
    def of_rows(cls, rows: CauseRows, causes: Sequence[Array], kept: BoolArray) -> SharedColumns:
        """Return the columns of some rows.

        Args:
            rows: The rows.
            causes: Columns of each cause, shape (k, N, n).
            kept: Which columns of beta are kept, shape (size,).
        """
        size, places = int(kept.sum()), np.cumsum(kept) - 1
        total, count = size + sum(map(len, causes)), rows.target.shape[1]
        products, whole, joints = np.zeros((count, total + 1, total + 1)), np.zeros(count), []
        standing = np.concatenate([np.zeros((0, count), bool), *(cause.any(axis=1) for cause in causes)])
        for i, (block, own) in enumerate(zip(rows.counted, rows.columns, strict=True)):
            mine, added = kept[own], [column for cause in causes for column in cause[:, :, i]]
            there = standing[:, i]
            beside = [column for column, is_there in zip(added, there, strict=True) if is_there]
            more = np.where(rows.masks[:, i], np.stack([*beside, rows.target[:, i]]), 0.0)
            columns = np.concatenate([block[mine], more])
            numbers = np.concatenate([places[own[mine]], size + np.flatnonzero(there), [total]])
            whole[i] = columns[-1] @ columns[-1]
            alone = _orthonormal(block[~mine])
            if len(alone):
                columns -= (columns @ alone.T) @ alone
            products[i][np.ix_(numbers, numbers)] = columns @ columns.T
            joints.append(ColumnsAtJoint(numbers, columns, alone))
        grams, sides, squares = products[:, :-1, :-1], products[:, :-1, -1], products[:, -1, -1]
        return cls(size, tuple(joints), grams, sides, squares, whole)


def _orthonormal(columns: Array) -> Array:
    """Return an orthonormal basis (o, N) of what columns (k, N) span, but for directions that are rounding."""
    norms = np.linalg.norm(columns, axis=1)
    _, sizes, basis = np.linalg.svd(columns[norms > 0] / norms[norms > 0, None], full_matrices=False)
    return basis[sizes**2 > RIDGE * sizes.max(initial=0.0) ** 2]
