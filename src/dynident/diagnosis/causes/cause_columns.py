"""Columns of a fit and of causes at each joint, and their products, made once for all fits with some of the causes.

Columns that one joint alone has, as its friction, may be taken out of all others there by an orthogonal projection: the
residual of a fit is the same (Frisch and Waugh 1933). A column stands at the joints where it is not zero.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
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
        made: What :meth:`own` has made, which rows with the same observation matrices and masks share.
    """

    blocks: Sequence[Array]
    columns: Sequence[IntArray]
    size: int
    target: Array
    measured: Array
    masks: BoolArray
    oversampling: float = 1.0
    made: dict[bytes, tuple[ColumnsAtJoint, ...]] = field(default_factory=dict, repr=False, compare=False)

    @cached_property
    def shared(self) -> BoolArray:
        """Which columns of beta more than one joint has, shape (size,)."""
        return np.bincount(np.concatenate(self.columns), minlength=self.size) > 1

    def own(self, kept: BoolArray) -> tuple[ColumnsAtJoint, ...]:
        """Return the columns of each joint that are ``kept``, shape (size,), less what its others explain, once."""
        key = kept.tobytes()
        if key not in self.made:
            places, found = np.cumsum(kept) - 1, list[ColumnsAtJoint]()
            for mask, block, own in zip(self.masks.T, self.blocks, self.columns, strict=True):
                counted, mine = np.where(mask, block.T, 0.0), kept[own]
                alone = _orthonormal(counted[~mine])
                columns = counted if mine.all() else _beyond(counted[mine], alone)
                found.append(ColumnsAtJoint(places[own[mine]], (columns,), alone, columns @ columns.T))
            self.made[key] = tuple(found)
        return self.made[key]

    @cached_property
    def counts(self) -> Array:
        """Rows of each joint that count, shape (n,), at least 1."""
        return np.maximum(self.masks.sum(axis=0), 1).astype(float)

    @cached_property
    def measured_size(self) -> Array:
        """Root mean square of the measured torque, shape (n,)."""
        return self.mean_size(self.measured)

    def mean_size(self, torque: Array) -> Array:
        """Return the root mean square of a torque (N, n) over the rows that count, shape (n,)."""
        return np.sqrt(np.sum(np.where(self.masks, torque, 0.0) ** 2, axis=0) / self.counts)

    @property
    def worth(self) -> Array:
        """Independent rows of each joint where noise is white before the filter, shape (n,)."""
        return self.counts / self.oversampling


@dataclass(frozen=True)
class ColumnsAtJoint:
    """What stands at one joint.

    Attributes:
        places: Numbers of the S columns that are not zero here among those kept, those of causes and the target.
        parts: These one after another, less what the joint's own explain, zero where rows do not count, (k, N) each.
        alone: Orthonormal, what the joint's own columns span, shape (o, N).
        gram: Products of the columns, shape (S, S).
    """

    places: IntArray
    parts: tuple[Array, ...]
    alone: Array
    gram: Array

    @cached_property
    def columns(self) -> Array:
        """The columns, shape (S, N)."""
        return np.concatenate(self.parts)

    def beside(self, more: Array, numbers: IntArray) -> ColumnsAtJoint:
        """Return the same with more columns (k, N), zero where rows do not count, and their numbers (k,)."""
        more = _beyond(more, self.alone)
        across = np.concatenate([part @ more.T for part in self.parts])
        gram = np.block([[self.gram, across], [across.T, more @ more.T]])
        return ColumnsAtJoint(np.concatenate([self.places, numbers]), (*self.parts, more), self.alone, gram)


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
        size = int(kept.sum())
        total, count = size + sum(map(len, causes)), rows.target.shape[1]
        products, whole, joints = np.zeros((count, total + 1, total + 1)), np.zeros(count), []
        standing = np.concatenate([np.zeros((0, count), bool), *map(joints_of, causes)])
        for i, own in enumerate(rows.own(kept)):
            added, there = (column for cause in causes for column in cause[:, :, i]), standing[:, i]
            beside = [column for column, is_there in zip(added, there, strict=True) if is_there]
            more = np.where(rows.masks[:, i], np.stack([*beside, rows.target[:, i]]), 0.0)
            whole[i] = more[-1] @ more[-1]
            joint = own.beside(more, np.append(size + np.flatnonzero(there), total))
            products[i][np.ix_(joint.places, joint.places)] = joint.gram
            joints.append(joint)
        grams, sides, squares = np.ascontiguousarray(products[:, :-1, :-1]), products[:, :-1, -1], products[:, -1, -1]
        return cls(size, tuple(joints), grams, sides, squares, whole)


def joints_of(columns: Array) -> BoolArray:
    """Return at which joints columns (k, N, n) are not zero, shape (k, n), in less than half the time of ``any``."""
    found = [own.any() for column in columns for own in column.T]
    return np.array(found, dtype=bool).reshape(len(columns), columns.shape[2])


def _beyond(columns: Array, basis: Array) -> Array:
    """Return columns (k, N) less what an orthonormal basis (o, N) explains of them."""
    return columns - (columns @ basis.T) @ basis if len(basis) else columns


def _orthonormal(columns: Array) -> Array:
    """Return an orthonormal basis (o, N) of what columns (k, N) span, but for directions that are rounding."""
    norms = np.linalg.norm(columns, axis=1)
    _, sizes, basis = np.linalg.svd(columns[norms > 0] / norms[norms > 0, None], full_matrices=False)
    return basis[sizes**2 > RIDGE * sizes.max(initial=0.0) ** 2]
