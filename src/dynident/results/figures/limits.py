"""Figure of a designed motion: position, speed, acceleration and torque of a joint with their limits as lines."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dynident.arrays import Array
from dynident.results.figures.chart import Across, Level, Line, Plot, chart
from dynident.results.text import format_given, format_number, label, pretty_unit

#: A limit is drawn where the motion comes this near to it, as a share; else it is only stated.
SHOWN = 0.3


@dataclass(frozen=True)
class Bounded:
    """A signal and what it must keep.

    Attributes:
        name: Such as ``position``.
        unit: Its unit.
        values: Shape (N,).
        lower: Lowest value; minus infinity for none.
        upper: Highest value; infinite for none.
    """

    name: str
    unit: str
    values: Array
    lower: float
    upper: float

    @property
    def used(self) -> float:
        """Share of the way from the middle to its bounds that the signal takes; 0 without bounds."""
        if not (np.isfinite(self.lower) and np.isfinite(self.upper)):
            return 0.0
        centre, reach = 0.5 * (self.lower + self.upper), 0.5 * (self.upper - self.lower)
        return float(np.nanmax(np.abs(self.values - centre))) / reach


def limit_chart(joint: str, time: Array, signals: Sequence[Bounded]) -> str:
    """Return signals of a joint over time, one plot each, with their limits as lines (Figure 4 of the article).

    A limit that the signal stays far away from is stated beside the unit, so that the signal can be seen.

    Args:
        joint: Name of the joint.
        time: Shape (N,), in s.
        signals: What is drawn, from top to bottom.
    """
    plots = [_plot(time, signal, colour) for colour, signal in enumerate(signals, start=1)]
    told = [
        f"{signal.name} from {format_number(float(signal.values.min()), 3)} to "
        f"{format_number(float(signal.values.max()), 3)} {pretty_unit(signal.unit)}"
        + (f", {100 * signal.used:.0f} % of its limit" if signal.used else "")
        for signal in signals
    ]
    said = f"Motion of {label(joint)} over {format_number(float(time[-1]), 3)} s: {'; '.join(told)}."
    return chart(label(joint), said, Across("time [s]"), plots)


def _plot(time: Array, signal: Bounded, colour: int) -> Plot:
    unit = pretty_unit(signal.unit)
    marks = (Line("", time, signal.values, colour, 1.3),)
    if not signal.used:
        return Plot(f"{signal.name} [{unit}], no limit stated", marks, 92.0)
    ends = format_given(signal.lower), format_given(signal.upper)
    stated = f"±{ends[1]}" if signal.lower == -signal.upper else f"{ends[0]} to {ends[1]}"
    if signal.used < SHOWN:
        return Plot(f"{signal.name} [{unit}], limit {stated} is off the plot", marks, 92.0)
    levels = (Level(signal.upper, ""), Level(signal.lower, ""))
    return Plot(f"{signal.name} [{unit}], limit {stated}", marks, 92.0, levels=levels)
