"""Logged velocities beside the derivative of the positions: the same motion, its sign, and the ratio of the two."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import ceil

import numpy as np

from dynident.arrays import Array, BoolArray, IntArray
from dynident.data.preprocessing._zero_phase import low_passed

#: Both are compared below this frequency, in Hz, where arms move.
BAND_HZ = 5.0

#: Fewest samples of a comparison; median steps, and share of the log, of a gap across which no motion is drawn.
FEWEST, GAP, GAP_SHARE = 50, 100.0, 0.01

#: Lags that are tried, in s, and the steps by which.
EARLIEST, LATEST, COARSE, FINE = -0.1, 0.4, 1e-2, 1e-3

#: A lag leaves at most this share of the squares that the velocity as logged leaves, and is at least so many samples.
LAG_LEAVES, LAG_SAMPLES = 0.5, 0.7

#: A unit explains a ratio within this share of its factor; a filter or a poor encoder explains less.
NEAR = 0.1


@dataclass(frozen=True)
class VelocityPair:
    """Velocities and the derivative of the positions on equal steps, low-passed alike, less their means.

    Attributes:
        stated: The logged velocities, shape (M, n).
        slope: The derivative of the positions, shape (M, n).
        rate: In Hz.
    """

    stated: Array
    slope: Array
    rate: float

    @cached_property
    def moving(self) -> BoolArray:
        """Which joints move enough for a comparison, shape (n,)."""
        stated, slope = self._sizes
        return (stated > 1e-9) & (slope > 1e-3 * max(float(slope.max()), 1e-12))

    @cached_property
    def correlations(self) -> Array:
        """Correlation of the velocity of each joint with the derivative of each position, shape (n, n)."""
        return self.stated.T @ self.slope / np.maximum(np.outer(*self._sizes), 1e-300)

    @cached_property
    def ratios(self) -> Array:
        """Velocity over derivative of each joint, shape (n,)."""
        return np.sum(self.stated * self.slope, axis=0) / np.maximum(np.sum(self.slope**2, axis=0), 1e-300)

    @cached_property
    def lags(self) -> Array:
        """Lag of each velocity behind the derivative in s, shape (n,): the least-squares shift; 0 for none."""
        found, moving = np.zeros(self.slope.shape[1]), np.flatnonzero(self.moving)
        first, last = ceil(LATEST * self.rate), len(self.slope) - ceil(-EARLIEST * self.rate)
        every, pad = max(1, int(self.rate / (20.0 * BAND_HZ))), ceil(2.0 * COARSE * self.rate) + 1
        if last - first < FEWEST:
            return found
        stated, slope = self.stated[first:last:every], np.pad(self.slope, ((pad, pad), (0, 0)), mode="edge")

        def left(lags: Array, joints: IntArray) -> Array:
            """Return what lags (m,) leave of the squares of some joints, shape (m, k)."""
            own, before, squares = stated[:, joints], slope[:, joints], np.zeros((len(lags), len(joints)))
            for k, steps in enumerate((lags * self.rate).tolist()):
                at = first + pad - ceil(steps)
                early, late = (before[at + one : at + one + last - first : every] for one in (0, 1))
                squares[k] = np.sum((own - early - (ceil(steps) - steps) * (late - early)) ** 2, axis=0)
            return squares

        coarse = np.arange(EARLIEST, LATEST, COARSE)
        logged, best = left(np.zeros(1), moving)[0], coarse[np.argmin(left(coarse, moving), axis=0)]
        for joint, start, plain in zip(moving.tolist(), best.tolist(), logged.tolist(), strict=True):
            near = start + np.arange(-COARSE, COARSE, FINE)
            squares = left(near, np.array([joint]))[:, 0]
            lag = float(near[int(np.argmin(squares))])
            if abs(lag) >= LAG_SAMPLES / self.rate and squares.min() < LAG_LEAVES * plain:
                found[joint] = lag
        return found

    @property
    def _sizes(self) -> tuple[Array, Array]:
        return np.linalg.norm(self.stated, axis=0), np.linalg.norm(self.slope, axis=0)


def velocity_pair(time: Array, q: Array, dq: Array) -> VelocityPair | None:
    """Return velocities beside the derivative of positions, shape (N, n) each, in the longest part without a gap.

    None where that is too short.
    """
    if len(time) < FEWEST or not np.ptp(time):
        return None
    steps = np.diff(time)
    gap = max(GAP * float(np.median(steps)), GAP_SHARE * float(np.ptp(time)))
    part = max(np.split(np.arange(len(time)), np.flatnonzero(steps > gap) + 1), key=len)
    time, q, dq = time[part], q[part], dq[part]
    if len(time) < FEWEST:
        return None
    rate = 1.0 / float(np.median(np.diff(time)))
    band = min(BAND_HZ, 0.2 * rate)
    count = int(float(time[-1] - time[0]) * rate) + 1
    if count < 6 * rate / band:
        return None
    even = time[0] + np.arange(count) / rate
    columns = [np.interp(even, time, column) for column in np.concatenate([q, dq], axis=1).T]
    smooth = low_passed(np.column_stack(columns), 3, band, rate)
    joints = q.shape[1]
    edge = int(rate / band)
    near, far = (np.roll(smooth[:, :joints], -k, axis=0) - np.roll(smooth[:, :joints], k, axis=0) for k in (1, 2))
    slope = (8.0 * near - far) * rate / 12.0  # exact to the fourth power; ends are cut off
    stated = smooth[edge:-edge, joints:] - smooth[edge:-edge, joints:].mean(axis=0)
    return VelocityPair(stated, slope[edge:-edge] - slope[edge:-edge].mean(axis=0), rate)


def is_near(ratio: float, factor: float = 1.0) -> bool:
    """Return whether a unit of this factor explains a ratio."""
    return abs(ratio / factor - 1) < NEAR
