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
    found = np.zeros(q.shape[1], int)
    if len(q) < 2:
        return found
    for k, column in enumerate(q.T):  # one by one: of a long log even these steps take room
        steps = np.diff(column)
        np.abs(steps, out=steps)
        steps[~np.isfinite(steps)] = 0.0
        if steps.max() <= (1.0 - NEAR_TURN) * turn:
            continue
        usual = np.quantile(np.abs(steps - turn * np.round(steps / turn)), 0.99)
        if time is not None:
            apart = np.diff(time)
            steps[apart > 2 * np.median(apart)] = 0.0
        if usual < NEAR_TURN * turn:
            found[k] = np.count_nonzero(np.abs(steps - turn) < NEAR_TURN * turn)
    return found


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
