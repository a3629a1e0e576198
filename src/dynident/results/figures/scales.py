"""Scales: from values to places in a drawing, with ticks at round numbers."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from dynident.arrays import Array


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
