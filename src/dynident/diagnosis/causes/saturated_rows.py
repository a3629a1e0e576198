"""Samples of a torque that is cut off: at flat tops, and heaped at the limit of effort."""

from __future__ import annotations

import numpy as np

from dynident.arrays import Array, BoolArray
from dynident.data.log import Log
from dynident.diagnosis.causes.quick_fit import QuickFit
from dynident.model.robot import Robot

#: A flat top lasts this many times longer than values within the range do, and at least this many samples.
LONGER, SHORTEST = 6.0, 5

#: A torque counts as at its limit of effort within this share of it, from this share of the rows on. Where as many are
#: beyond the limit by more than the last share, the drive has another one than the robot model states.
NEAR, AT_LIMIT, BEYOND = 0.005, 0.002, 0.02

#: Times as many rows at the limit as in a band as wide just below it: a smooth peak that just gets there has 2.4 times.
HEAPED = 5.0


def saturated_rows(log: Log, robot: Robot) -> BoolArray:
    """Return where torques are cut off: at flat tops, at flat bottoms and at the limits of effort, shape (3, n, N)."""
    torques = zip(robot.active, np.asarray(log.torque).T, strict=True)
    own = [(flat_rows(one), flat_rows(-one), at_limit(one, joint.limits.effort)) for joint, one in torques]
    return np.stack(own, axis=1)


def without_saturation(fit: QuickFit, log: Log, cut: BoolArray) -> QuickFit:
    """Return the fit of a log without the rows in which a torque is cut off; the same where too few would be left.

    Args:
        fit: Of the log.
        log: The log as it was recorded, with torques.
        cut: These rows, shape (N,).
    """
    if not cut.any():
        return fit
    count = np.concatenate([[0], np.cumsum(cut)])
    time, step = np.asarray(fit.rows.prepared.kept.time), 1.0 / fit.log.rate
    first, last = np.searchsorted(log.time, [time - step, time + step])
    part = fit.part(count[last] == count[first])
    return part if part.has_rows_enough else fit


def at_limit(column: Array, limit: float) -> BoolArray:
    """Return the samples heaped at a limit of effort, shape (N,); none where they go beyond it or just reach it."""
    own = [np.abs(column) >= bound for bound in limit * np.array([1 - 2 * NEAR, 1 - NEAR, 1 + BEYOND])]
    below, near, beyond = (float(np.mean(each)) for each in own)
    heaped = near > HEAPED * (below - near)
    return own[1] & bool(near > AT_LIMIT and heaped and beyond <= AT_LIMIT)


def flat_rows(column: Array) -> BoolArray:
    """Return the samples in long runs at exactly the highest value, shape (N,)."""
    top = column == column.max()
    edges = np.diff(np.pad(top.astype(np.int8), 1))
    starts, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    changes, found = np.count_nonzero(np.diff(column)), np.zeros(len(column), bool)
    if not changes:
        return found
    usual = (len(column) - top.sum()) / max(changes, 1)  # mean length of a run of equal values below the top
    for start, end in zip(starts, ends, strict=True):
        found[start:end] = end - start >= max(SHORTEST, LONGER * usual)
    return found
