"""Positions whose counter starts again after a whole turn: where they jump, and the turns counted on."""

from __future__ import annotations

import numpy as np

from dynident.arrays import Array, IntArray

#: A jump within this share of a turn between two samples is one of the counter, not of the joint.
NEAR_TURN = 0.1


def jumps_of_a_turn(q: Array, turn: float = 2 * np.pi, time: Array | None = None) -> IntArray:
    """Return how often each column jumps by a whole turn between two samples, shape (n,).

    Joints that move by a tenth of a turn and more from sample to sample have none: there a jump tells nothing, nor does
    one over a gap in time.

    Args:
        q: Positions, shape (N, n); values that are not finite are no jumps.
        turn: A whole turn in their unit.
        time: Time of the samples, shape (N,); None where it says nothing.
    """
    if len(q) < 2:
        return np.zeros(q.shape[1], int)
    steps = np.abs(np.diff(q, axis=0))
    steps = np.where(np.isfinite(steps), steps, 0.0)
    usual = np.quantile(np.abs(steps - turn * np.round(steps / turn)), 0.99, axis=0)
    if time is not None:
        apart = np.diff(time)
        steps[apart > 2 * np.median(apart)] = 0.0
    return np.where(usual < NEAR_TURN * turn, (np.abs(steps - turn) < NEAR_TURN * turn).sum(axis=0), 0)


def turns_counted(q: Array, before: Array | None = None, turn: float = 2 * np.pi) -> Array:
    """Return positions with their turns counted on, shape (N, n): no step is longer than half a turn.

    Args:
        q: Positions, shape (N, n); values that are not finite stay as they are.
        before: Counted positions of the sample before, shape (n,); None where ``q`` begins the log, whose first sample
            is then taken within half a turn of zero.
        turn: A whole turn in their unit.
    """
    counted = np.array(q, dtype=float)
    for k, column in enumerate(counted.T):
        sound = np.isfinite(column)
        start = 0.0 if before is None else before[k]
        counted[sound, k] = np.unwrap(np.append(start, column[sound]), period=turn)[1:]
    return counted
