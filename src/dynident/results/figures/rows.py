"""Figures with a row for each name: bars of errors by joint, values with their intervals by parameter."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dynident.arrays import Array
from dynident.results.figures import svg
from dynident.results.figures.chart import WIDTH, Line, heading
from dynident.results.figures.scales import Linear, finite_range
from dynident.results.text import format_number, format_percent, format_value, label, shorten

_NAMES = 0.36  # share of the width that names may take
_BAR = 14.0  # height of a bar with its number
_STEP = 19.0  # height of a row with one value
_VALUES = 138.0  # width of the column of values with their intervals


def error_chart(title: str, joints: Sequence[str], sets: Sequence[tuple[str, Array]]) -> str:
    """Return bars of relative errors from zero, a group for each joint and a bar for each set.

    Args:
        title: What it shows.
        joints: Names, K of them.
        sets: Name of a set and its errors as fractions, shape (K,); NaN has no bar.
    """
    nothing = np.zeros(0)
    legend = [Line(name, nothing, nothing, _colour(k, len(sets))) for k, (name, _) in enumerate(sets)]
    head, top = heading(title, legend, WIDTH)
    names = [shorten(label(name), int(_NAMES * WIDTH / svg.LETTER)) for name in joints]
    left = 10 + max((svg.breadth(text) for text in names), default=0.0)
    most = finite_range(np.zeros(1), *(100.0 * errors for _, errors in sets))[1]
    scale = Linear(0.0, most, left, WIDTH - 62.0)
    step = _BAR * len(sets) + 8.0
    top += 12.0
    bottom = top + step * len(names)
    body = [head, *_axis(scale, top, bottom), svg.words("relative error [%]", WIDTH - 12, bottom + 35, anchor="end")]
    for row, (name, text) in enumerate(zip(joints, names, strict=True)):
        middle = top + step * (row + 0.5)
        body.append(svg.words(text, left - 8, middle + 4.5, anchor="end", full=name if text != name else ""))
        for k, (_, errors) in enumerate(sets):
            y = top + step * row + 4.0 + _BAR * (k + 0.5)
            end = float(scale.at(np.array(100.0 * errors[row]))) if np.isfinite(errors[row]) else left
            bar = f"M{svg.number(left)} {svg.number(y - 5)}H{svg.number(end)}v10H{svg.number(left)}z"
            body.append(svg.filled(bar, _colour(k, len(sets)), 0.85))
            body.append(svg.words(format_percent(float(errors[row])), end + 6, y + 4.5, "ink", halo=True))
    said = "; ".join(
        f"{label(name)} " + ", ".join(f"{called} {format_percent(float(errors[row]))}" for called, errors in sets)
        for row, name in enumerate(joints)
    )
    return svg.drawing(WIDTH, bottom + 42, "".join(body), title, f"Relative errors of the torque: {said}.")


def _colour(place: int, count: int) -> int:
    """Return the colour of a set: the last one that of a prediction, those before it grey and blue."""
    return 2 if place == count - 1 else place


@dataclass(frozen=True)
class Intervals:
    """Values of one unit with their intervals.

    Attributes:
        names: Of the parameters, K of them.
        values: Shape (K,).
        half_widths: Half the widths of the intervals, shape (K,); NaN or infinite where none is known.
    """

    names: tuple[str, ...]
    values: Array
    half_widths: Array

    @property
    def clear(self) -> NDArray[np.bool_]:
        """Whether each interval leaves out zero, shape (K,)."""
        return np.isfinite(self.half_widths) & (np.abs(self.values) > self.half_widths)


def interval_chart(title: str, unit: str, found: Intervals) -> str:
    """Return values with their intervals in the order given, those whose interval holds zero as hollow rings.

    The axis holds zero and all values; an interval that reaches further is cut there and ends in an arrow.

    Args:
        title: What it shows.
        unit: Of the values, as it is printed.
        found: The values.
    """
    names = [shorten(label(name), int(_NAMES * WIDTH / svg.LETTER)) for name in found.names]
    left = 10 + max((svg.breadth(text) for text in names), default=0.0)
    values = [_written(float(v), float(half)) for v, half in zip(found.values, found.half_widths, strict=True)]
    scale = Linear(*_reach(found), left + 8, WIDTH - _VALUES)
    head, top = heading(title, (), WIDTH)
    top += 8.0
    bottom = top + _STEP * len(names)
    body = [
        head,
        *_axis(scale, top, bottom),
        svg.words("value" if unit == "1" else f"value [{unit}]", scale.end, bottom + 35, anchor="end"),
    ]
    body.append(svg.words("value ± 95 %", WIDTH - 2, bottom + 35, anchor="end"))
    clear = found.clear
    for row, (name, text, value) in enumerate(zip(found.names, names, values, strict=True)):
        y = top + _STEP * (row + 0.5)
        body.append(svg.words(text, left - 8, y + 4.5, anchor="end", full=name if text != name else ""))
        body.append(_interval(scale, y, float(found.values[row]), float(found.half_widths[row]), bool(clear[row])))
        body.append(svg.words(value, WIDTH - 2, y + 4.5, "ink" if clear[row] else "soft", "end"))
    most = "; ".join(f"{label(name)} {value}" for name, value in list(zip(found.names, values, strict=True))[:5])
    said = f"{len(names)} values in {unit}, {int(np.sum(clear))} significant at 95 %; the largest: {most}."
    return svg.drawing(WIDTH, bottom + 42, "".join(body), title, said)


def _written(value: float, half: float) -> str:
    """Return a value with half the width of its interval, or alone where that is not known or too long to print."""
    if np.isfinite(half) and half > 0:
        text = " ± ".join(format_value(value, half))
        if svg.breadth(text) <= _VALUES - 14:
            return text
    return format_number(value, 3)


def _reach(found: Intervals) -> tuple[float, float]:
    """Return the ends of the axis: zero, all values, and intervals as far as the values reach."""
    low, high = finite_range(found.values, np.zeros(1))
    room = 0.08 * (high - low)
    spread = np.where(np.isfinite(found.half_widths), found.half_widths, 0.0)
    least, most = finite_range(found.values - spread, found.values + spread, np.zeros(1))
    return max(low - 3 * room, least - 0.2 * room), min(high + 3 * room, most + 0.2 * room)


def _interval(scale: Linear, y: float, value: float, half: float, clear: bool) -> str:
    """Return a dot or a ring with its interval, cut at the ends of the axis."""
    colour = 1 if clear else 0
    ends = [scale.low, scale.high] if not np.isfinite(half) else [value - half, value + half]
    inside = np.clip(ends, scale.low, scale.high)
    a, b = (float(place) for place in scale.at(inside))
    line = [svg.stroke(svg.track(np.array([a, b]), np.array([y, y])), colour, 1.6)]
    for place, end, kept, side in zip((a, b), ends, inside, (1, -1), strict=True):
        step = 4 * side if end != kept or not np.isfinite(half) else 0
        tip = svg.track(np.array([place + step, place, place + step]), np.array([y - 3.5, y, y + 3.5]))
        line.append(svg.stroke(tip, colour, 1.6))
    x = svg.number(float(scale.at(np.array(value))) - 3.5)
    dot = f"M{x} {svg.number(y)}a3.5 3.5 0 1 1 7 0a3.5 3.5 0 1 1 -7 0z"
    return "".join(line) + (svg.filled(dot, 1) if clear else svg.stroke(dot, 0, 1.4))


def _axis(scale: Linear, top: float, bottom: float) -> list[str]:
    """Return the lines of the grid with their numbers."""
    body = []
    for tick in scale.ticks(56.0):
        x = float(scale.at(np.array(tick.value)))
        body += [svg.rule(x, top, x, bottom, strong=tick.value == 0)]
        body.append(svg.words(tick.text, x, bottom + 16, anchor="middle"))
    return body
