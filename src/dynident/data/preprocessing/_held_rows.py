"""Logs that are written at a higher rate than their readings change: each reading stands in several rows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dynident.arrays import Array, IntArray
from dynident.data.log import Log

#: Share of the rows that repeat the one before at least; of the columns that change with a reading, which those of a
#: coarse encoder do one by one; and of the readings that stand in about as many rows, where few columns change.
REPEATED, TOGETHER, REGULAR, SEVERAL = 1 / 3, 0.7, 0.9, 4

#: Usual rows of a reading from which on the joints rest, and fewest readings that say how many it stands in.
REST, FEWEST = 4, 50


def first_of_each_reading(log: Log) -> Log:
    """Return the log with the first row of each reading of positions, velocities and torques.

    What stays the same for longer, as at rest, keeps one row in as many as a reading usually stands in. Where positions
    or velocities alone stand in several rows, or in more than the others, a straight line joins their readings.
    """
    count, starts = _rows_of_reading([values for values in (log.q, log.dq, log.torque) if values is not None])
    if count > 1:
        log = log.rows(starts, f"each reading stands in {count} rows: the first of them kept")
    for name in ("q", "dq"):
        values: Array | None = getattr(log, name)
        if values is None:
            continue
        count, starts = _rows_of_reading([values])
        if count > 1:
            moved = np.column_stack([np.interp(log.time, log.time[starts], column) for column in values[starts].T])
            log = log.with_step(f"each reading of {name} stands in {count} rows: a straight line from one to the next")
            log = replace(log, q=moved) if name == "q" else replace(log, dq=moved)
    return log


def _rows_of_reading(signals: Sequence[Array]) -> tuple[int, IntArray]:
    """Return how many rows a reading stands in, 1 where each is of its own, and the first row of each reading."""
    none, each = (1, np.zeros(0, int)), list[int]()
    changed = np.zeros(max(len(signals[0]) - 1, 0), bool)
    for column in (column for values in signals for column in values.T):
        own = column[1:] != column[:-1]
        each.append(int(np.count_nonzero(own)))
        changed |= own
        if np.count_nonzero(changed) > (1.0 - REPEATED) * len(changed):
            return none
    starts = np.concatenate([[0], np.flatnonzero(changed) + 1])
    gaps = np.diff(starts)
    if len(gaps) < FEWEST or (count := int(np.median(gaps))) < 2:
        return none
    moved = [own for own in each if own > 0.5 * max(each)]
    regular = np.mean(np.abs(gaps - count) <= max(1, count // 4))
    if np.mean(moved) < TOGETHER * len(gaps) or (regular < REGULAR and len(moved) < SEVERAL):
        return none
    rows = np.diff(np.append(starts, len(changed) + 1))
    kept = np.where(rows > REST * count, -(-(rows - count // 2) // count), 1)
    within = np.arange(kept.sum()) - np.repeat(np.cumsum(kept) - kept, kept)
    return count, np.repeat(starts, kept) + count * within
