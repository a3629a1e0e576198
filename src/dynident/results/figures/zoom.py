"""The data of a chart over time that a page can zoom into, as text for an attribute of the drawing.

Without its script a page shows the drawing as it is. With it, the script (templates/zoom.js) draws the visible stretch
anew from these numbers: 16 bits for a value, of long signals the lowest and the highest of each stretch of rows.
"""

from __future__ import annotations

import base64
import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from dynident.arrays import Array, IntArray

#: The number that stands for a value that is missing.
MISSING = 65535

_STEPS = MISSING - 1


@dataclass(frozen=True)
class Live:
    """A mark that can be drawn anew.

    Attributes:
        colour: Number in the palette.
        values: Heights: one row (1, N) of a line, the lower and the upper edge (2, N) of a band.
        width: Of the stroke of a line.
        opacity: Of a band.
        dashed: Whether a line is broken.
    """

    colour: int
    values: Array
    width: float = 1.3
    opacity: float = 1.0
    dashed: bool = False


@dataclass(frozen=True)
class LivePlot:
    """A rectangle of a chart with its marks.

    Attributes:
        top: Where it begins.
        height: Of the rectangle.
        marks: What is drawn in it.
    """

    top: float
    height: float
    marks: tuple[Live, ...]


def zoom_text(
    plots: Sequence[LivePlot],
    places: Array,
    starts: Sequence[int],
    pieces: Sequence[tuple[float, float, float, float]],
    detail: int,
    parts: Sequence[tuple[str, bool]] = (),
) -> str:
    """Return geometry and data of a chart as JSON.

    Args:
        plots: Its rectangles.
        places: Where each row stands across the drawing, shape (N,), in units of it.
        starts: First row of each stretch of the axis.
        pieces: Of each stretch: first and last place, and the time at both, in s.
        detail: So many values of a mark are kept at most, about.
        parts: What each stretch is called, and whether it is shaded; none for no names.
    """
    rows = _groups(starts, len(places), detail)
    left, right = min(piece[0] for piece in pieces), max(piece[1] for piece in pieces)
    whole = len(rows) == len(places)
    shown = places[rows] if whole else np.stack([places[rows], places[_middles(rows, len(places))]], 1).ravel()
    cuts = np.searchsorted(rows, np.asarray(starts)) * (1 if whole else 2)
    data: dict[str, Any] = {
        "left": round(left, 1),
        "right": round(right, 1),
        "pieces": [[float(f"{value:.8g}") for value in piece] for piece in pieces],
        "cuts": cuts.tolist(),
        "parts": [[name, int(shaded)] for name, shaded in parts],
        "x": _packed((shown - left) / (right - left)),
        "plots": [
            {"top": plot.top, "height": plot.height, "marks": [_mark(mark, rows, whole) for mark in plot.marks]}
            for plot in plots
        ],
    }
    return json.dumps(data, separators=(",", ":"))


def _groups(starts: Sequence[int], count: int, detail: int) -> IntArray:
    """Return the first row of each group: every row where there are few, else groups of equal size in each stretch."""
    size = max(1, int(np.ceil(2 * count / max(detail, 2)))) if count > detail else 1
    ends = [*starts[1:], count]
    return np.concatenate([np.arange(a, b, size) for a, b in zip(starts, ends, strict=True)])


def _middles(rows: IntArray, count: int) -> IntArray:
    return (rows + np.append(rows[1:], count)) // 2


def _mark(mark: Live, rows: IntArray, whole: bool) -> dict[str, Any]:
    values = mark.values if whole else np.stack(_thinned(mark.values, rows))
    finite = values[np.isfinite(values)]
    low, high = (float(finite.min()), float(finite.max())) if len(finite) else (0.0, 1.0)
    span = high - low or 1.0
    found: dict[str, Any] = {"c": mark.colour, "low": low, "span": span}
    even = len(values) == 2 and np.array_equal(
        values[0], -values[1], equal_nan=True
    )  # a band about zero goes as its top
    found["v"] = [_packed((row - low) / span) for row in values[int(even) :]]
    return found | (
        {"o": mark.opacity, "e": int(even)} if len(values) == 2 else {"w": mark.width, "d": int(mark.dashed)}
    )


def _thinned(values: Array, rows: IntArray) -> list[Array]:
    """Return two values for each group: of a line the extremes in the order of the rows, of a band its widest place."""
    if len(values) == 2:
        return [np.repeat(np.fmin.reduceat(values[0], rows), 2), np.repeat(np.fmax.reduceat(values[1], rows), 2)]
    (line,) = values
    low, high = np.fmin.reduceat(line, rows), np.fmax.reduceat(line, rows)
    lengths = np.diff(np.append(rows, len(line)))
    at_low, at_high = (_first(line == np.repeat(extreme, lengths), rows) for extreme in (low, high))
    rising = at_low <= at_high
    return [np.stack([np.where(rising, low, high), np.where(rising, high, low)], 1).ravel()]


def _first(hits: Array, rows: IntArray) -> IntArray:
    """Return the first row of each group that is a hit; the end of all where none is."""
    numbers = np.where(hits, np.arange(len(hits)), len(hits))
    return np.minimum.reduceat(numbers, rows)


def _packed(shares: Array) -> str:
    """Return shares of a range, 0 to 1 or NaN, as base64 of unsigned 16-bit numbers, the low byte first."""
    known = np.isfinite(shares)
    numbers = np.where(known, np.rint(np.where(known, shares, 0.0) * _STEPS), MISSING)
    return base64.b64encode(numbers.astype("<u2").tobytes()).decode("ascii")
