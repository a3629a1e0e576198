"""Rows and their time: the unit of the time by its median step, and rows that repeat the row before."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dynident.arrays import Array, BoolArray
from dynident.data.formats.base import UNITS

#: Median steps in s between which robots are recorded: 50 kHz to 2 Hz. Beyond them the unit of the time is wrong.
POSSIBLE_STEPS = (2e-5, 0.5)

#: Median steps in s that are usual, 8 kHz to 4 Hz: a unit under which the step is one of them is likely.
USUAL_STEPS = (1.2e-4, 0.25)


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
