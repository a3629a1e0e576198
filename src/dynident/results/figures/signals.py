"""Figures over time: lines, measured and predicted torque, trajectories, designed motions with their limits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dynident.arrays import Array
from dynident.results.figures.chart import WIDTH, Across, Level, Line, Mark, Plot, ShadedBand, chart
from dynident.results.figures.svg import COLOURS
from dynident.results.text import format_given, format_number, format_percent, label, pretty_unit

#: Width of one of a grid of small figures: four stand side by side on a page.
SMALL = 236.0

#: Colour, width, dashes, detail: the prediction stands on the measurement, and both show where they agree.
MEASURED, PREDICTED, RESIDUAL = (1, 1.8, False, 1.0), (2, 1.4, True, 1.0), (3, 1.2, False, 1.0)

#: Seconds from which on time is a clock's and not that of a run; it is then counted from the start.
_CLOCK = 1e5


def line_chart(
    title: str,
    lines: Sequence[tuple[str, Array, Array]],
    across: str,
    upwards: str,
    description: str = "",
    log: tuple[bool, bool] = (False, False),
    levels: Sequence[Level] = (),
    size: tuple[float, float] = (WIDTH, 210.0),
) -> str:
    """Return a figure of lines over a common axis.

    Args:
        title: What it shows.
        lines: Name, x (N,) and y (N,) of each line; names and lengths may differ.
        across: Heading of the horizontal axis, with its unit.
        upwards: Heading of the vertical axis, with its unit.
        description: What can be seen, in words; by default the names of the lines.
        log: Whether the horizontal and the vertical axis are logarithmic.
        levels: Horizontal lines with a word each.
        size: Width of the figure and height of its rectangle.
    """
    marks = coloured([(label(name), np.asarray(x, dtype=float), np.asarray(y, dtype=float)) for name, x, y in lines])
    said = description or f"{upwards} over {across}: {', '.join(mark.label for mark in marks)}."
    plot = Plot(upwards, marks, size[1], log[1], tuple(levels))
    return chart(title, said, Across(across, log=log[0]), [plot], size[0])


def coloured(lines: Sequence[tuple[str, Array, Array]]) -> tuple[Line, ...]:
    """Return lines in the colours of the palette, ink last; a second round through it is dashed."""
    count = len(COLOURS)
    return tuple(Line(name, x, y, (k + 1) % count, dashed=k >= count) for k, (name, x, y) in enumerate(lines))


def run_time(time: Array, starts: Sequence[int]) -> Array:
    """Return the time of each log, from its first row where it is a clock's (above 1e5 s), else as it is, (N,)."""
    shown = np.array(time, dtype=float)
    for start, stop in zip(starts, [*starts[1:], len(shown)], strict=True):
        if stop > start and shown[start] > _CLOCK:
            shown[start:stop] -= shown[start]
    return shown


@dataclass(frozen=True)
class TorqueBands:
    """Half widths of the bands about a predicted torque, for 95 %.

    Attributes:
        parameters: By the covariance of the parameters, shape (N,).
        whole: With the noise of the fit, shape (N,).
    """

    parameters: Array
    whole: Array


@dataclass(frozen=True)
class TorqueSignals:
    """Measured and predicted torque of a joint over time.

    Attributes:
        time: Shape (N,), in s; starts anew with each log.
        measured: Shape (N,).
        predicted: Shape (N,).
        starts: First sample of each log; a gap stands between two.
        bands: Half widths; None for none.
        parts: What each log is used for, and whether it is shaded, such as ``("test", True)``; none for no names.
        held: Least and largest torque of the model, shape (N,) each: at rest what static friction can hold, else
            ``predicted`` both; None for no such interval.
    """

    time: Array
    measured: Array
    predicted: Array
    starts: tuple[int, ...] = (0,)
    bands: TorqueBands | None = None
    parts: tuple[tuple[str, bool], ...] = ()
    held: tuple[Array, Array] | None = None

    @property
    def residual(self) -> Array:
        """Measured torque less the nearest of the model, shape (N,)."""
        return self.measured - (self.predicted if self.held is None else np.clip(self.measured, *self.held))


def _shades(time: Array, bands: TorqueBands | None) -> tuple[ShadedBand, ...]:
    if bands is None:
        return ()
    wide = ShadedBand("95 % band", time, bands.whole, 0, -bands.whole, 0.10)
    return wide, ShadedBand("of the parameters", time, bands.parameters, 1, -bands.parameters, 0.3)


def torque_chart(joint: str, unit: str, signals: TorqueSignals, detail: int = 0) -> str:
    """Return measured and predicted torque of a joint and, below on the same time axis, the residual.

    Figures 7 and 9 of the article. Bands hold 95 % of the residuals where the model and its noise are what they are
    said to be; the dark one is what the deviations of the parameters make of it. What static friction can hold at rest
    is shaded above; the residual is what is beyond.

    Args:
        joint: Name of the joint.
        unit: N m or N.
        signals: Its torques.
        detail: So many values of each signal go with it, for a page that can zoom; 0 for none.
    """
    shown, bands = run_time(signals.time, signals.starts), signals.bands
    kind = f"{'torque' if unit == 'N m' else 'force'} [{pretty_unit(unit)}]"
    residual = signals.residual
    known = residual[np.isfinite(residual)]
    rms = float(np.sqrt(np.mean(known**2))) if len(known) else float("nan")
    lines: tuple[Mark, ...] = (
        Line("measured", shown, signals.measured, *MEASURED),
        Line("predicted", shown, signals.predicted, *PREDICTED),
    )
    beyond = "" if signals.held is None else ", at rest beyond static friction"
    if signals.held is not None:
        lines = (ShadedBand("static friction", shown, signals.held[1], 2, signals.held[0], 0.25), *lines)
    plots = [
        Plot(kind, lines, 150.0),
        Plot(
            f"measured - predicted{beyond} [{pretty_unit(unit)}]",
            (*_shades(shown, bands), Line("", shown, residual, *RESIDUAL)),
            78.0,
        ),
    ]
    said = (
        f"Measured and predicted {kind} of {label(joint)} over {len(shown)} samples in {len(signals.starts)} log(s); "
        f"their difference has a root mean square of {format_number(rms, 3)} {pretty_unit(unit)}."
    )
    if signals.held is not None:
        said += " At rest it is what static friction, shaded, cannot hold."
    if bands is not None:
        stated = np.isfinite(residual) & np.isfinite(bands.whole)
        inside = np.abs(residual[stated]) <= bands.whole[stated]
        said += f" {format_percent(float(np.mean(inside)))} of the samples lie in the 95 % band." * bool(len(inside))
    return chart(label(joint), said, Across("time [s]", signals.starts, parts=signals.parts), plots, detail=detail)


def small_torque_chart(
    title: str,
    unit: str,
    time: Array,
    measured: Array,
    predicted: Array,
    starts: Sequence[int] = (0,),
    residual: Array | None = None,
) -> str:
    """Return measured and predicted torque of a joint with the residual on the same scale, one of a grid of many.

    The colours are those of :func:`torque_chart`; their names stand once beside the grid.

    Args:
        title: Name of the joint, and what to say in short.
        unit: N m or N.
        time: Shape (N,), in s; starts anew with each log.
        measured: Shape (N,).
        predicted: Shape (N,).
        starts: First sample of each log; a gap stands between two.
        residual: Shape (N,); None for measured less predicted.
    """
    shown = run_time(time, starts)
    left = measured - predicted if residual is None else residual
    signals = ((measured, MEASURED), (left, RESIDUAL), (predicted, PREDICTED))
    lines = tuple(Line("", shown, values, *look) for values, look in signals)
    said = f"Measured torque, predicted torque and residual in {pretty_unit(unit)} over time in s."
    return chart(title, said, Across("", tuple(starts)), [Plot("", lines, 92.0)], SMALL)


def torque_overview(
    title: str,
    joints: Sequence[tuple[str, str]],
    time: Array,
    measured: Array,
    predicted: Array,
    starts: Sequence[int] = (0,),
) -> str:
    """Return measured and predicted torques of all joints, one plot each over a common time axis. Figures 7 and 9.

    Args:
        title: What it shows.
        joints: Name and unit, N m or N, of each of the n joints.
        time: Shape (N,), in s; starts anew with each log.
        measured: Shape (N, n).
        predicted: Shape (N, n).
        starts: First sample of each log; a gap stands between two.
    """
    shown = run_time(time, starts)
    plots = [
        Plot(
            f"{label(name)} [{pretty_unit(unit)}]",
            (Line("measured", shown, measured[:, k], *MEASURED), Line("predicted", shown, predicted[:, k], *PREDICTED)),
            105.0,
        )
        for k, (name, unit) in enumerate(joints)
    ]
    said = f"Measured and predicted torques of {', '.join(label(name) for name, _ in joints)} over time."
    return chart(title, said, Across("time [s]", tuple(starts)), plots)


def trajectory_chart(
    title: str,
    joints: Sequence[str],
    kinds: Sequence[str],
    time: Array,
    q: Array,
    dq: Array | None = None,
    starts: Sequence[int] = (0,),
) -> str:
    """Return positions and speeds of the joints over time; turning and sliding joints apart. Figures 4 and 8.

    Args:
        title: What it shows.
        joints: Names of the n joints.
        kinds: ``revolute`` or ``prismatic`` for each.
        time: Shape (N,), in s.
        q: Positions, shape (N, n), in rad or m.
        dq: Speeds, shape (N, n), in rad/s or m/s; None draws positions only.
        starts: First sample of each log; a gap stands between two.
    """
    shown = run_time(time, starts)
    lines = coloured([(label(name), shown, q[:, k]) for k, name in enumerate(joints)])
    plots = []
    for what, values, units in (("position", q, ("rad", "m")), ("speed", dq, ("rad/s", "m/s"))):
        for kind, unit in zip(("revolute", "prismatic"), units, strict=True):
            own = [k for k, found in enumerate(kinds) if found == kind]
            if values is None or not own:
                continue
            marks = tuple(replace(lines[k], y=values[:, k], width=1.2, detail=2.0) for k in own)
            plots.append(Plot(f"{what} [{unit}]", marks, 125.0))
    reach = ", ".join(
        f"{label(name)} from {format_number(float(low), 3)} to {format_number(float(high), 3)}"
        for name, low, high in zip(joints, np.min(q, axis=0), np.max(q, axis=0), strict=True)
    )
    return chart(title, f"Positions over time: {reach}.", Across("time [s]", tuple(starts)), plots)


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
