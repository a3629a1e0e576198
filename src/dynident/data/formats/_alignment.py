"""Signals that were logged at other times than each other become rows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dynident.arrays import Array, BoolArray, IntArray

#: Column of the time, in s since the first row.
TIME = "t"

#: Steps of a signal, in its median step, over which it is not interpolated.
_LONGEST_STEP = 5.0


@dataclass(frozen=True)
class Series:
    """Messages that carry the same columns, in the order of their stamps.

    Attributes:
        columns: Names of the columns, k.
        stamps: Shape (N,), in ns.
        values: Shape (N, k).
    """

    columns: tuple[str, ...]
    stamps: IntArray
    values: Array


def chosen(collected: Sequence[Series], names: Sequence[str]) -> tuple[Series, list[Series]]:
    """Return the series with most columns, and those with the columns that it lacks."""
    ranked = sorted(collected, key=lambda series: (-len(series.columns), -len(series.stamps)))
    if not ranked:
        return Series(tuple(n for n in names if n != TIME), np.empty(0, np.int64), np.empty((0, len(names)))), []
    covered = set(ranked[0].columns)
    others = []
    for series in ranked[1:]:
        if not covered.issuperset(series.columns):
            others.append(series)
            covered |= set(series.columns)
    return ranked[0], others


def unused(collected: Sequence[Series], used: Sequence[Series]) -> list[str]:
    """Return notes of messages whose columns all came from others."""
    return [
        f"{len(series.stamps)} messages with {len(series.columns)} of the columns only left out"
        for series in collected
        if not any(series is one for one in used)
    ]


def aligned(base: Series, others: Sequence[Series]) -> tuple[IntArray, list[tuple[tuple[str, ...], Array]], list[str]]:
    """Return the stamps at which all series are known, their columns and values there, and what was done."""
    keep = np.ones(len(base.stamps), dtype=bool)
    blocks, notes = [], []
    for series in others:
        values, known, exact = _at(series, base.stamps)
        keep &= known
        blocks.append((series.columns, values))
        if not exact:
            some = ", ".join(series.columns[:3]) + (", ..." if len(series.columns) > 3 else "")
            notes.append(f"{some} interpolated linearly at the stamps of {base.columns[0]}")
    if not np.all(keep):
        notes.append(f"{np.sum(~keep)} rows left out at which not all columns are known")
    # The first series wins where two carry a column.
    blocks = [(columns, values[keep]) for columns, values in reversed(blocks)]
    return base.stamps[keep], [*blocks, (base.columns, base.values[keep])], notes


def _at(series: Series, stamps: IntArray) -> tuple[Array, BoolArray, bool]:
    """Return the values of a series at stamps, where they are known, and whether none was interpolated."""
    stood = series.stamps
    if np.any(np.diff(stood) <= 0) or len(stood) < 2:  # repeats and jumps cannot be interpolated
        first = np.r_[True, np.diff(stood) > 0] if len(stood) else np.empty(0, dtype=bool)
        series = Series(series.columns, stood[first], series.values[first])
        stood = series.stamps
    if len(stood) < 2:
        return np.full((len(stamps), len(series.columns)), np.nan), np.zeros(len(stamps), dtype=bool), True
    right = np.clip(np.searchsorted(stood, stamps), 1, len(stood) - 1)
    step = (stood[right] - stood[right - 1]).astype(np.float64)
    share = (stamps - stood[right - 1]) / step
    low, high = series.values[right - 1], series.values[right]
    values = np.where((share == 1.0)[:, None], high, low + share[:, None] * (high - low))
    exact = (share == 0.0) | (share == 1.0)
    median = np.median(np.diff(stood))
    known = exact | ((share > 0) & (share < 1) & (step <= _LONGEST_STEP * median))
    return values, known, bool(np.all(exact[known]))
