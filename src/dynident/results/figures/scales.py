"""From values to places in a drawing: scales with ticks at round numbers, and a parallel projection of space.

Labels stand where they cover nothing.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dynident.arrays import Array
from dynident.results.figures import svg


@dataclass(frozen=True)
class Tick:
    """A round value and how it is written."""

    value: float
    text: str


class AxisScale(ABC):
    """A range of values laid on a stretch of the drawing."""

    @abstractmethod
    def at(self, values: Array) -> Array:
        """Return the places of values, of the same shape; NaN where a value has none."""

    @abstractmethod
    def ticks(self, spacing: float) -> tuple[Tick, ...]:
        """Return ticks at round numbers, at least ``spacing`` apart where more than two are possible."""


@dataclass(frozen=True)
class Linear(AxisScale):
    """Equal steps of value are equal steps of place.

    Attributes:
        low: Value at ``start``.
        high: Value at ``end``.
        start: Place of the lowest value.
        end: Place of the highest one; below ``start`` for an axis that points up.
        step: Between two ticks; 0 where the spacing decides.
    """

    low: float
    high: float
    start: float
    end: float
    step: float = 0.0

    def at(self, values: Array) -> Array:
        share = (np.asarray(values, dtype=float) - self.low) / (self.high - self.low)
        return self.start + share * (self.end - self.start)

    def ticks(self, spacing: float) -> tuple[Tick, ...]:
        found: tuple[Tick, ...] = ()
        for share in (1.0, 0.7, 0.5, 0.35, 0.25, 0.15):
            room = max(abs(self.end - self.start) / (spacing * share), 1.0)
            step = self.step or round_step((self.high - self.low) / room)
            first, last = int(np.ceil(self.low / step - 1e-6)), int(np.floor(self.high / step + 1e-6))
            found = tuple(Tick(k * step, write_tick(k * step, step)) for k in range(first, last + 1))
            if len(found) > 1 or self.step:
                break
        return found


@dataclass(frozen=True)
class LogScale(AxisScale):
    """Equal ratios of value are equal steps of place; fields as those of :class:`Linear`, ``low`` above zero."""

    low: float
    high: float
    start: float
    end: float

    def at(self, values: Array) -> Array:
        given = np.asarray(values, dtype=float)
        share = np.log(np.where(given > 0, given, np.nan) / self.low) / np.log(self.high / self.low)
        return self.start + share * (self.end - self.start)

    def ticks(self, spacing: float) -> tuple[Tick, ...]:
        bottom, top = np.log10(self.low), np.log10(self.high)
        room = max(abs(self.end - self.start) / spacing, 1.0)
        powers = np.arange(np.floor(bottom), np.ceil(top) + 1)
        every = int(np.ceil((top - bottom) / room))
        lead = (1.0, 2.0, 5.0) if 3 * (top - bottom) <= room else (1.0,)
        values = [m * 10.0**p for p in powers[:: max(every, 1)] for m in lead]
        inside = [v for v in values if self.low * (1 - 1e-9) <= v <= self.high * (1 + 1e-9)]
        return tuple(Tick(v, write_tick(v, v)) for v in inside)


def round_step(least: float) -> float:
    """Return the smallest of 1, 2, 2.5, 5 times a power of ten that is not below ``least``."""
    power = 10.0 ** np.floor(np.log10(least))
    return float(next(m * power for m in (1.0, 2.0, 2.5, 5.0, 10.0) if m * power >= least * (1 - 1e-9)))


def write_tick(value: float, step: float) -> str:
    """Return a tick's value with the decimals that its step asks for; ``2e5`` where plain digits would be long."""
    if abs(value) < step * 1e-6:
        return "0"
    size = np.floor(np.log10(abs(value)) + 1e-9)
    unit = np.floor(np.log10(step) + 1e-9)
    if size >= 5 or unit < -4:
        mantissa, exponent = f"{value:.{max(0, int(size - unit) + (step / 10**unit == 2.5))}e}".split("e")
        return f"{mantissa.rstrip('0').rstrip('.') if '.' in mantissa else mantissa}e{int(exponent)}"
    decimals = max(0, -int(unit)) + (1 if abs(step / 10.0**unit - 2.5) < 1e-6 and unit <= 0 else 0)
    return f"{value:.{decimals}f}"


def finite_range(*arrays: Array) -> tuple[float, float]:
    """Return the lowest and highest finite value; (0, 1) where there is none, a little around one that stands alone."""
    finite = [part[np.isfinite(part)] for part in (np.asarray(a, dtype=float).ravel() for a in arrays)]
    values = np.concatenate(finite) if finite else np.zeros(0)
    if not len(values):
        return 0.0, 1.0
    low, high = float(values.min()), float(values.max())
    if high - low <= 1e-12 * max(abs(low), abs(high)):
        half = 0.5 * abs(low) or 0.5
        return low - half, high + half
    return low, high


def upright(low: float, high: float, bottom: float, top: float) -> Linear:
    """Return a vertical scale whose ends are ticks, so that the data stay between two labelled lines.

    Of a wide and a narrow step, the one that leaves less of the plot empty.
    """
    found = []
    for spacing in (36.0, 26.0):
        step = round_step((high - low) / max((bottom - top) / spacing, 1.0))
        ends = float(np.floor(low / step + 1e-6) * step), float(np.ceil(high / step - 1e-6) * step)
        found.append(Linear(*ends, bottom, top, step))
    return min(found, key=lambda scale: (round((scale.high - scale.low) / (high - low), 2), -scale.step))


def upright_log(low: float, high: float, bottom: float, top: float) -> LogScale:
    """Return a vertical logarithmic scale that ends at a round number: a power of ten, or 1, 2, 5 times one."""
    if high / low >= 10:
        return LogScale(10.0 ** np.floor(np.log10(low) + 1e-9), 10.0 ** np.ceil(np.log10(high) - 1e-9), bottom, top)
    rounds = [m * 10.0**p for p in range(int(np.floor(np.log10(low))) - 1, int(np.ceil(np.log10(high))) + 1)
              for m in (1.0, 2.0, 5.0)]  # fmt: skip
    below = max(v for v in rounds if v <= low * (1 + 1e-9))
    return LogScale(
        below, min(v for v in [*rounds, 10 * rounds[-1]] if v >= high * (1 - 1e-9) and v > below), bottom, top
    )


#: The eye: turned about the vertical and raised, in rad. x runs to the right, y away from the eye.
AZIMUTH, ELEVATION = np.deg2rad(-58.0), np.deg2rad(24.0)


@dataclass(frozen=True)
class View:
    """A parallel projection: x to the right of the drawing and y down it, from points in m.

    Attributes:
        matrix: From points to places, shape (2, 3).
        shift: Place of the origin, shape (2,).
        width: Of the drawing.
        height: Of the drawing.
    """

    matrix: Array
    shift: Array
    width: float
    height: float

    @classmethod
    def around(
        cls,
        points: Array,
        width: float,
        most: float,
        azimuth: float = AZIMUTH,
        elevation: float = ELEVATION,
        top: float = 48.0,
    ) -> View:
        """Return the view that fits points (N, 3) into a width and a height, with room for labels around them.

        Args:
            points: What must be seen, shape (N, 3), in m.
            width: Of the drawing.
            most: Height of the points at most.
            azimuth: The eye about the vertical, in rad.
            elevation: How far it is raised, in rad.
            top: Room above the points.
        """
        sine, cosine = np.sin(azimuth), np.cos(azimuth)
        right = np.array([-sine, cosine, 0.0])
        up = np.array([-cosine * np.sin(elevation), -sine * np.sin(elevation), np.cos(elevation)])
        flat = points @ np.array([right, -up]).T
        low, span = flat.min(axis=0), np.maximum(np.ptp(flat, axis=0), 1e-6)
        room = np.array([width - 124.0, most])
        scale = float(np.min(room / span))
        shift = np.array([62.0 + (room[0] - scale * span[0]) / 2, top]) - scale * low
        return cls(scale * np.array([right, -up]), shift, width, scale * float(span[1]) + top + 52.0)

    def at(self, points: Array) -> Array:
        """Return the places (N, 2) of points (N, 3)."""
        return np.atleast_2d(points) @ self.matrix.T + self.shift

    def line(self, points: Array) -> str:
        """Return path data through points (N, 3)."""
        places = self.at(points)
        return svg.track(places[:, 0], places[:, 1])

    def dot(self, point: Array, colour: int, radius: float) -> str:
        """Return a disc at a point (3,)."""
        ((x, y),) = self.at(point)
        turn = f"a{radius:g} {radius:g} 0 1 1"
        return svg.filled(
            f"M{svg.number(x - radius)} {svg.number(y)}{turn} {2 * radius:g} 0{turn} -{2 * radius:g} 0z", colour
        )


@dataclass(frozen=True)
class LabelPlace:
    """Where a label stands: the rectangle of its letters.

    Attributes:
        left: Left edge.
        right: Right edge.
        top: Upper edge.
        bottom: Lower edge.
    """

    left: float
    right: float
    top: float
    bottom: float

    @classmethod
    def of(cls, text: str, x: float, y: float, anchor: str = "start") -> LabelPlace:
        """Return the rectangle of a text that is anchored at (x, y), its base line."""
        wide = svg.breadth(text)
        left = {"start": x, "middle": x - wide / 2, "end": x - wide}[anchor]
        return cls(left - 2.0, left + wide + 2.0, y - svg.SIZE + 1.0, y + 3.0)

    def meets(self, other: LabelPlace) -> bool:
        """Whether two rectangles have a point in common."""
        across = self.left < other.right and other.left < self.right
        return across and self.top < other.bottom and other.top < self.bottom


def put_label(
    view: View, text: str, anchors: Sequence[tuple[float, float, str]], taken: list[LabelPlace], shade: str = "soft"
) -> str:
    """Return a label at the first of several anchors where it meets no other label and stays inside; else nothing.

    Args:
        view: The drawing.
        text: The label.
        anchors: x, y of the base line, and ``start``, ``middle`` or ``end``, the best one first.
        taken: Rectangles of the labels that are there; that of this one is added.
        shade: ``ink`` or ``soft``.
    """
    for x, y, anchor in anchors:
        place = LabelPlace.of(text, x, y, anchor)
        inside = place.left >= 0 and place.right <= view.width and place.top >= 18.0 and place.bottom <= view.height
        if inside and not any(place.meets(other) for other in taken):
            taken.append(place)
            return svg.words(text, x, y, shade, anchor, halo=True)
    return ""
