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

#: Rows of a reading from which on the joints rest, in terms of its usual rows.
REST = 4

#: Fewest readings that say how many rows each stands in.
FEWEST = 50


def first_of_each_reading(log: Log) -> tuple[Log, int]:
    """Return the log with one row of each reading, the first, and how many rows a reading stands in; 1 for one.

    Positions, velocities and torques of all joints are then the same for as many rows, again and again. What stays the
    same for longer, as at rest, keeps one row in as many. Where positions alone are held so, a straight line joins
    their readings.
    """
    signals = {name: values for name in ("q", "dq", "torque") if (values := getattr(log, name)) is not None}
    count, starts = _rows_of_reading(list(signals.values()))
    if count > 1:
        return log.rows(starts, f"each reading stands in {count} rows: the first of them kept"), count
    moved = {}
    for name in ("q", "dq"):
        count, starts = _rows_of_reading([signals[name]] if name in signals else [])
        if count > 1:
            columns = [np.interp(log.time, log.time[starts], column) for column in signals[name][starts].T]
            moved[name] = np.column_stack(columns)
            log = log.with_step(f"each reading of {name} stands in {count} rows: a straight line from one to the next")
    return replace(log, **moved) if moved else log, 1


def _rows_of_reading(signals: Sequence[Array]) -> tuple[int, IntArray]:
    """Return how many rows a reading stands in, 1 where each is of its own, and the first row of each reading."""
    none, counts = (1, np.zeros(0, int)), list[int]()
    changed = np.zeros(max(len(signals[0]) - 1, 0) if signals else 0, bool)
    for column in (column for values in signals for column in values.T):
        own = column[1:] != column[:-1]
        counts.append(int(np.count_nonzero(own)))
        changed |= own
        if np.count_nonzero(changed) > (1.0 - REPEATED) * len(changed):
            return none
    starts = np.concatenate([[0], np.flatnonzero(changed) + 1])
    gaps, each = np.diff(starts), np.array(counts)
    if len(gaps) < FEWEST or (count := int(np.median(gaps))) < 2:
        return none
    moved = each[each > 0.5 * each.max()]
    is_regular = np.mean(np.abs(gaps - count) <= max(1, count // 4)) >= REGULAR
    if moved.mean() < TOGETHER * len(gaps) or not (is_regular or len(moved) >= SEVERAL):
        return none
    ends = np.append(starts[1:], len(changed) + 1)
    long = ends - starts > REST * count
    ends = np.where(long, ends - count // 2, starts + 1)
    return count, np.concatenate([np.arange(*both, count) for both in zip(starts, ends, strict=True)])
