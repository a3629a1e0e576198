"""Rows and their time: the unit of the time by its median step, rows that repeat the row before, rows out of order."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence

import numpy as np

from dynident.arrays import Array, BoolArray
from dynident.data.formats._units import UNITS

#: Median steps in s between which robots are recorded: 50 kHz to 2 Hz. Beyond them the unit of the time is wrong.
POSSIBLE_STEPS = (2e-5, 0.5)

#: Median steps in s that are usual, 8 kHz to 4 Hz: a unit under which the step is one of them is likely.
USUAL_STEPS = (1.2e-4, 0.25)

#: Rows that are not finite or out of order are repaired up to this share; a log with more of them is not.
MOST_LOST = 0.05

#: Rows within so many usual steps of a row are looked at, and how many times as many as usual are two recordings.
NEAR, CROWDED = 2.5, 1.5

#: A sorted log whose rows were only out of order has no step shorter than this share of the median one.
SHORTEST_STEP = 0.2


def is_step(seconds: float, steps: tuple[float, float] = POSSIBLE_STEPS) -> bool:
    """Return whether a median step in s lies in a range."""
    return steps[0] <= seconds <= steps[1]


def time_units(step: float, steps: tuple[float, float] = USUAL_STEPS) -> tuple[str, ...]:
    """Return the units under which a median step of the file lies in a range, the longest unit first."""
    return tuple(word for word, ((one, per), _) in UNITS["time"].items() if is_step(step * one / per, steps))


def same_as_before(columns: Sequence[Array]) -> BoolArray:
    """Return which rows have in all columns, each (N,) or (N, n), the values of the row before, shape (N,)."""
    same = np.zeros(len(columns[0]), bool)
    same[1:] = True
    for values in columns:
        equal = values[1:] == values[:-1]
        same[1:] &= equal if equal.ndim == 1 else equal.all(axis=1)
    return same


def out_of_order(time: Array) -> BoolArray:
    """Return which rows are out of order, shape (N,): as few as leave the others in the order of their time.

    Args:
        time: Time of the rows, shape (N,), finite.
    """
    moved = np.zeros(len(time), bool)
    if len(time) < 2 or not (np.diff(time) < 0).any():
        return moved
    lasts: list[float] = []  # earliest last time of a run of each length, and its row (longest ordered subsequence)
    ends, before = list[int](), list[int]()
    for row, value in enumerate(time.tolist()):
        place = bisect_right(lasts, value)
        before.append(ends[place - 1] if place else -1)
        lasts[place : place + 1], ends[place : place + 1] = [value], [row]
    moved[:] = True
    row = ends[-1]
    while row >= 0:
        moved[row] = False
        row = before[row]
    return moved


def sortable(time: Array, signals: Sequence[Array] = ()) -> bool:
    """Return whether rows are merely out of order: sorted, they are one recording and not two laid together.

    A clock that was set back runs through the same time twice: there rows stand twice as close as elsewhere. Two rows
    of one time that were apart are one row only if their values are the same.

    Args:
        time: Time of the rows, shape (N,).
        signals: Their values, each (N,) or (N, n).
    """
    if not np.isfinite(time).all():
        return False
    moved = time[out_of_order(time)]
    order = np.argsort(time, kind="stable")
    kept = order[~same_as_before([time[order], *(values[order] for values in signals)])] if signals else order
    in_order, forward = time[kept], np.diff(time)
    steps = np.diff(in_order)
    if not (forward > 0).any() or len(moved) > MOST_LOST * len(time):
        return False
    if np.count_nonzero(steps == 0) > np.count_nonzero(forward == 0):
        return False
    usual = float(np.median(forward[forward > 0]))
    first, last = (np.searchsorted(in_order, moved + side * NEAR * usual) for side in (-1, 1))
    crowded = bool(len(moved)) and np.median(last - first) > CROWDED * 2 * NEAR
    return bool(steps[steps > 0].min() >= SHORTEST_STEP * usual) and not crowded
