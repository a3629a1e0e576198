"""Digest: what is left of the samples of logs that were reduced as a stream; digests merge.

Of each joint: one triangle for each stretch of time, from which the triangle over all rows, its covariance under
coloured residuals and the correlation of residuals follow; the triangle of the samples at rest; and sums of products
with the constant, the measured torque and what the filter took from it, for the figures of the fit.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from dynident.arrays import Array, IntArray
from dynident.data.formats import ColumnMap
from dynident.data.preprocessing import Preprocessing
from dynident.model.base_parameters import BaseParameters
from dynident.model.dynamic_model import DynamicModel
from dynident.model.reduction import Triangle, merged_pairs, triangle_of
from dynident.model.threads import one_blas_thread

#: Stretches that are kept at most; beyond them neighbours are merged in pairs.
MOST = 256

#: Rows that are kept as they are, for the report, and states that are kept because they are far out.
SAMPLED, FAR = 2000, 512


@dataclass(frozen=True)
class JointRows:
    """The rows of one joint.

    Attributes:
        columns: Positions in beta of its K columns.
        factors: Triangle of [W, tau] of each stretch over the rows that count, shape (m, K + 1, K + 1).
        sums: Sum of the same rows, shape (m, K + 1).
        counts: How many they are, shape (m,).
        resting: Triangle of the samples at rest, shape (K + 1, K + 1).
        rested: How many they are.
        products: Of [1, measured, unfiltered - measured] with [W, tau, 1, measured, unfiltered - measured], for rows
            that count and samples at rest, shape (2, 3, K + 4).
    """

    columns: IntArray
    factors: Array
    sums: Array
    counts: IntArray
    resting: Array
    rested: int
    products: Array

    @cached_property
    def triangle(self) -> Triangle:
        """The triangle over all rows that count."""
        with one_blas_thread():
            return Triangle(self.columns, triangle_of(np.concatenate(list(self.factors))), int(self.counts.sum()))

    @cached_property
    def every(self) -> Triangle:
        """The triangle over all rows, those at rest too."""
        return self.triangle.merged([Triangle(self.columns, self.resting, self.rested)])

    def merged(self, other: JointRows) -> JointRows:
        """Return the rows of both."""
        resting = triangle_of(np.concatenate([self.resting, other.resting]))
        found = replace(
            self,
            factors=np.concatenate([self.factors, other.factors]),
            sums=np.concatenate([self.sums, other.sums]),
            counts=np.concatenate([self.counts, other.counts]),
            resting=resting,
            rested=self.rested + other.rested,
            products=self.products + other.products,
        )
        return found.thinned()

    def thinned(self) -> JointRows:
        """Return the same with at most :data:`MOST` stretches."""
        factors, sums, counts = self.factors, self.sums, self.counts
        while len(counts) > MOST:
            factors = merged_pairs(factors)
            starts = np.arange(0, len(counts), 2)
            sums, counts = np.add.reduceat(sums, starts, axis=0), np.add.reduceat(counts, starts)
        return replace(self, factors=factors, sums=sums, counts=counts)


@dataclass(frozen=True)
class States:
    """Where the rows lie: states [q, dq, ddq], shape (3 n,).

    Attributes:
        count: Rows used.
        low: Smallest of each, shape (3 n,).
        high: Largest.
        mean: Mean.
        spread: Sum of the products of their deviations from the mean, shape (3 n, 3 n).
        far: The states found furthest out on the way, shape (f, 3 n).
        samples: Samples of the logs, also those that are not used.
        accelerations: Sum of the squared accelerations over them, shape (n,).
        positions: Smallest and largest position over them, shape (2, n).
        torques: Smallest and largest torque before the filter over them, shape (2, n).
    """

    count: int
    low: Array
    high: Array
    mean: Array
    spread: Array
    far: Array
    samples: int
    accelerations: Array
    positions: Array
    torques: Array

    def merged(self, other: States) -> States:
        """Return those of both (Chan, Golub and LeVeque 1979)."""
        count = self.count + other.count
        apart = other.mean - self.mean
        share = other.count / max(count, 1)
        spread = self.spread + other.spread + np.outer(apart, apart) * self.count * share
        found = States(
            count=count,
            low=np.minimum(self.low, other.low),
            high=np.maximum(self.high, other.high),
            mean=self.mean + share * apart,
            spread=spread,
            far=np.concatenate([self.far, other.far]),
            samples=self.samples + other.samples,
            accelerations=self.accelerations + other.accelerations,
            positions=_range(self.positions, other.positions),
            torques=_range(self.torques, other.torques),
        )
        return replace(found, far=found.furthest(found.far))

    def furthest(self, states: Array) -> Array:
        """Return those of some states (m, 3 n) that lie furthest out, at most :data:`FAR`."""
        if len(states) <= FAR:
            return states
        distance = self.distances(states)
        return states[np.sort(np.argpartition(distance, -FAR)[-FAR:])]

    def distances(self, states: Array) -> Array:
        """Return the Mahalanobis distance of states (m, 3 n) from the mean, shape (m,)."""
        return np.linalg.norm((states - self.mean) @ self.whitener, axis=1)

    @property
    def whitener(self) -> Array:
        """What turns a state less the mean into one of unit covariance, shape (3 n, 3 n)."""
        covariance = self.spread / max(self.count, 1)
        size = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
        values, vectors = np.linalg.eigh(covariance / np.outer(size, size))
        kept = values > 1e-6 * values[-1]
        return (vectors * np.where(kept, 1.0 / np.sqrt(np.where(kept, values, 1.0)), 0.0)) / size[:, None]


def _range(a: Array, b: Array) -> Array:
    return np.stack([np.minimum(a[0], b[0]), np.maximum(a[1], b[1])])


@dataclass(frozen=True)
class Sampled:
    """Some rows as they are, in the order of time, for figures and the report.

    Attributes:
        time: Shape (s,), in s.
        q: Shape (s, n).
        dq: Shape (s, n).
        measured: Filtered torque, shape (s, n).
        unfiltered: Torque before the filter, shape (s, n).
        rows: [W, tau] of each joint, shape (s, K + 1) each.
        starts: First sample of each log.
    """

    time: Array
    q: Array
    dq: Array
    measured: Array
    unfiltered: Array
    rows: tuple[Array, ...]
    starts: tuple[int, ...]

    def merged(self, other: Sampled) -> Sampled:
        """Return the rows of both, thinned to :data:`SAMPLED` or so."""
        signals = {
            name: np.concatenate([getattr(self, name), getattr(other, name)])
            for name in ("time", "q", "dq", "measured", "unfiltered")
        }
        rows = tuple(np.concatenate(pair) for pair in zip(self.rows, other.rows, strict=True))
        starts = (*self.starts, *(start + len(self.time) for start in other.starts))
        return Sampled(**signals, rows=rows, starts=starts).thinned()

    def thinned(self) -> Sampled:
        """Return one row in two as long as there are more than twice as many as wanted."""
        step = 1
        while len(self.time) // step > 2 * SAMPLED:
            step *= 2
        starts = tuple(-(-start // step) for start in self.starts)
        signals = {name: getattr(self, name)[::step] for name in ("time", "q", "dq", "measured", "unfiltered")}
        return Sampled(**signals, rows=tuple(rows[::step] for rows in self.rows), starts=starts)


@dataclass(frozen=True)
class Chunk:
    """A log that is in a digest.

    Attributes:
        path: The file as it was given.
        sha256: Hash of its bytes.
        rows: Rows of the file.
        samples: Time samples used.
        rate: Samples a second that are used, in Hz.
        steps: What was done to its rows, in words.
        split: How ``--split`` takes the training part from the file; empty for all.
    """

    path: str
    sha256: str
    rows: int
    samples: int
    rate: float
    steps: tuple[str, ...]
    split: str = ""


@dataclass(frozen=True)
class Digest:
    """What is left of the rows of some logs.

    Attributes:
        model: Robot, drives and friction.
        base: Its base parameters.
        how: How logs became rows.
        columns: How the first of them was read.
        joints: The rows of each joint.
        states: Where they lie.
        sampled: Some of them as they are.
        chunks: The logs.
        options: Options of the command line that changed the case they were reduced with, by name.
    """

    model: DynamicModel
    base: BaseParameters
    how: Preprocessing
    columns: ColumnMap
    joints: tuple[JointRows, ...]
    states: States
    sampled: Sampled
    chunks: tuple[Chunk, ...]
    options: Mapping[str, str | list[str]] = field(default_factory=dict)

    @property
    def samples(self) -> int:
        """Number of time samples used."""
        return sum(chunk.samples for chunk in self.chunks)

    def __post_init__(self) -> None:
        """Refuse rows that are lost or count twice: what a merge must never do."""
        seen: set[str] = set()
        for chunk in self.chunks:
            if chunk.sha256 in seen:
                raise ValueError(f"the log {chunk.path} counts twice")
            seen.add(chunk.sha256)
        for name, joint in zip(self.model.robot.joint_names, self.joints, strict=True):
            rows = int(joint.counts.sum()) + joint.rested
            if rows != self.samples:
                raise ValueError(f"the QR factors of {name} have {rows} rows, its logs {self.samples}")

    def merged(self, other: Digest) -> Digest:
        """Return the digest of both, which are of the same model; see :class:`MergeTree` for more of them.

        Raises:
            ValueError: A log is in both.
        """
        return replace(
            self,
            joints=tuple(a.merged(b) for a, b in zip(self.joints, other.joints, strict=True)),
            states=self.states.merged(other.states),
            sampled=self.sampled.merged(other.sampled),
            chunks=(*self.chunks, *other.chunks),
            options={**other.options, **self.options},
        )


class MergeTree:
    """Digests that have come so far, merged as far as they can be, to the same bits in whatever order they come.

    Positions 0 to n - 1 are cut after the largest power of two below n, and so are both parts: the tree of Merkle's
    hashes (RFC 6962, section 2.1). A block of 2^k positions from a multiple of 2^k on is a node of it, even the last
    and shorter one. A position may be empty (None): then its neighbour takes the place of both.
    """

    def __init__(self) -> None:
        self._nodes: dict[tuple[int, int], Digest | None] = {}

    def add(self, first: int, size: int, digest: Digest | None) -> None:
        """Take the digest of a block.

        Args:
            first: Its first position, a multiple of ``size``.
            size: Positions of a block, a power of two; the last block may have fewer.
            digest: What is at these positions; None for nothing.

        Raises:
            ValueError: These positions have been taken, or begin at no multiple of the size.
        """
        level = size.bit_length() - 1
        index, beyond = divmod(first, size)
        if beyond or size != 1 << level:
            raise ValueError(f"positions {first} to {first + size - 1} are no block of the tree")
        if any((up, index >> (up - level)) in self._nodes for up in range(level, level + 64)):
            raise ValueError(f"position {first} has been taken")
        while (other := (level, index ^ 1)) in self._nodes:
            neighbour = self._nodes.pop(other)
            digest = _pair(neighbour, digest) if index % 2 else _pair(digest, neighbour)
            level, index = level + 1, index // 2
        self._nodes[level, index] = digest

    def merged(self) -> Digest | None:
        """Return all that has come as one; None where all positions are empty."""
        found: Digest | None = None
        for level, index in sorted(self._nodes, key=lambda node: node[1] << node[0], reverse=True):
            found = _pair(self._nodes[level, index], found)
        return found


def _pair(first: Digest | None, second: Digest | None) -> Digest | None:
    if first is None or second is None:
        return first or second
    return first.merged(second)
