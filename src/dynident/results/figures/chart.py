"""Charts: plots with a common horizontal axis, one below the other, and the marks that stand in them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from dynident.arrays import Array
from dynident.results.figures import svg
from dynident.results.figures.scales import AxisScale, Linear, LogScale, finite_range, round_step, upright, upright_log
from dynident.results.figures.zoom import Live, LivePlot, zoom_text
from dynident.results.text import shorten

#: Width of a figure: two stand side by side on a page, one fills a telephone.
WIDTH = 480.0

#: Opacity of a stretch that is shaded.
SHADE = 0.06

_NAMED = 15.0  # height of the names of stretches
_ROW = 19.0  # height of a line of text
_APART = 64.0  # least way between two ticks across
_STRETCH = 2.0  # of a drawing, over which a band keeps only its lowest and highest place


@dataclass(frozen=True)
class Mark(ABC):
    """Data in a plot.

    Attributes:
        label: Its name in the legend; empty for none.
        x: Shape (N,).
        y: Shape (N,); NaN where there is none.
        colour: Number in the palette.
    """

    label: str
    x: Array
    y: Array
    colour: int = 1

    @property
    def extent(self) -> Array:
        """Heights that the vertical axis has to reach, shape (K,)."""
        return self.y

    def placed(self, rows: slice, across: AxisScale, upwards: AxisScale) -> str:
        """Return the mark over some of its rows."""
        return self.draw(across.at(self.x[rows]), upwards.at(self.y[rows]))

    @abstractmethod
    def draw(self, x: Array, y: Array) -> str:
        """Return the mark at places (N,) of the drawing."""

    @abstractmethod
    def sample(self, x: float, y: float) -> str:
        """Return what stands before the label in the legend, 18 wide, its middle at height ``y``."""

    @abstractmethod
    def live(self) -> Live:
        """Return what a page needs to draw the mark anew when it is zoomed.

        Raises:
            NotImplementedError: A mark of its kind is not drawn over time.
        """


@dataclass(frozen=True)
class Line(Mark):
    """A line through the points in their order, with a gap where one is missing.

    Attributes:
        width: Of the stroke.
        dashed: Whether it is broken.
        detail: Stretch of the drawing in which only the lowest and the highest point are kept.
    """

    width: float = 1.3
    dashed: bool = False
    detail: float = 0.5

    def draw(self, x: Array, y: Array) -> str:
        if len(x) and np.all(np.diff(x) >= 0):
            rows = svg.kept_rows(x, y, self.detail)
            x, y = x[rows], y[rows]
        return svg.stroke(svg.track(x, y), self.colour, self.width, self.dashed)

    def sample(self, x: float, y: float) -> str:
        return svg.stroke(svg.track(np.array([x, x + 18]), np.array([y, y])), self.colour, 2.0, self.dashed)

    def live(self) -> Live:
        return Live(self.colour, self.y[None, :], self.width, dashed=self.dashed)


@dataclass(frozen=True)
class ShadedBand(Mark):
    """The area between two lines, from ``low`` (N,) up to ``y``.

    Attributes:
        low: Shape (N,).
        opacity: From 0 to 1.
    """

    low: Array = field(default_factory=lambda: np.zeros(0))
    opacity: float = 0.2

    @property
    def extent(self) -> Array:
        return np.concatenate([self.low, self.y])

    def placed(self, rows: slice, across: AxisScale, upwards: AxisScale) -> str:
        x, low, high = across.at(self.x[rows]), upwards.at(self.low[rows]), upwards.at(self.y[rows])
        good = np.isfinite(x) & np.isfinite(low) & np.isfinite(high)
        x, low, high = x[good], low[good], high[good]
        if not len(x) or np.any(np.diff(x) < 0):
            return ""
        starts = np.flatnonzero(np.concatenate([[True], np.diff(np.floor(x / _STRETCH)) > 0]))
        ends = [np.maximum.reduceat(low, starts), np.minimum.reduceat(high, starts)]  # y runs downwards in a drawing
        left, right = x[starts], x[np.append(starts[1:], len(x)) - 1]
        there = np.stack([left, right], axis=1).ravel()
        bottom, top = (np.repeat(side, 2) for side in ends)
        return self.draw(np.concatenate([there, there[::-1]]), np.concatenate([top, bottom[::-1]]))

    def draw(self, x: Array, y: Array) -> str:
        return svg.filled(svg.track(x, y) + "z", self.colour, self.opacity)

    def sample(self, x: float, y: float) -> str:
        return svg.filled(f"M{svg.number(x)} {svg.number(y - 5)}h18v10h-18z", self.colour, self.opacity)

    def live(self) -> Live:
        return Live(self.colour, np.stack([self.low, self.y]), opacity=self.opacity)


@dataclass(frozen=True)
class Cloud(Mark):
    """Many points as their density: cells of the drawing, the darker the more points lie in them (four shades)."""

    def draw(self, x: Array, y: Array) -> str:
        cell = 3
        good = np.isfinite(x) & np.isfinite(y)
        places = np.rint(np.column_stack([y[good], x[good]]) / cell).astype(np.int64)
        cells, counts = np.unique(places, axis=0, return_counts=True)
        if not len(cells):
            return ""
        level = np.minimum(np.log1p(counts) / np.log1p(counts.max()) * 4, 3).astype(int)
        follows = (np.diff(cells[:, 0]) == 0) & (np.diff(cells[:, 1]) == 1) & (np.diff(level) == 0)
        starts = np.flatnonzero(np.concatenate([[True], ~follows]))  # of runs of a shade, drawn as one line each
        lengths = cell * np.diff(np.append(starts, len(cells)))
        runs = [f"M{b * cell:g} {a * cell:g}h{wide:g}" for (a, b), wide in zip(cells[starts], lengths, strict=True)]
        layers = ["".join(run for run, own in zip(runs, level[starts], strict=True) if own == k) for k in range(4)]
        shades = zip(layers, (0.22, 0.42, 0.68, 1.0), strict=True)
        return "".join(svg.stroke(layer, self.colour, cell, opacity=opacity) for layer, opacity in shades)

    def sample(self, x: float, y: float) -> str:
        return svg.filled(f"M{svg.number(x + 6)} {svg.number(y - 3)}h6v6h-6z", self.colour, 0.7)

    def live(self) -> Live:
        raise NotImplementedError("a density has no order in time")


@dataclass(frozen=True)
class Level:
    """A horizontal line with a word to it; an empty one for none."""

    value: float
    text: str


@dataclass(frozen=True)
class Plot:
    """One rectangle of a chart.

    Attributes:
        heading: What is drawn upwards, with its unit; an empty one takes no room.
        marks: The data, the last on top.
        height: Of the rectangle.
        log: Whether the vertical axis is logarithmic; only where all data are above zero.
        levels: Horizontal lines.
    """

    heading: str
    marks: tuple[Mark, ...]
    height: float = 150.0
    log: bool = False
    levels: tuple[Level, ...] = ()

    def scale(self, top: float) -> AxisScale:
        """Return the vertical scale of the plot when its rectangle begins at ``top``."""
        levels = [level.value for level in self.levels]
        low, high = finite_range(*(mark.extent for mark in self.marks), np.array(levels))
        if low in [level.value for level in self.levels if level.text]:  # room for its word above the axis
            low = low * (low / high) ** 0.12 if self.log else low - 0.12 * (high - low)
        return (upright_log if self.log else upright)(low, high, top + self.height, top)


@dataclass(frozen=True)
class Across:
    """The horizontal axis that the plots of a chart share.

    Attributes:
        heading: What it is, with its unit; an empty one takes no room.
        starts: First row of each stretch; a stretch is a log whose time runs on its own.
        log: Whether it is logarithmic.
        pad: Share of the range that stays free at both ends of a linear axis in one stretch.
        parts: What each stretch is called, and whether it is shaded; none for no names.
    """

    heading: str
    starts: tuple[int, ...] = (0,)
    log: bool = False
    pad: float = 0.0
    parts: tuple[tuple[str, bool], ...] = ()

    def pieces(self, plots: Sequence[Plot], left: float, right: float) -> list[tuple[slice, AxisScale]]:
        """Return the rows and the scale of each stretch, side by side with a gap, as long as its span of values."""
        marks = [mark for plot in plots for mark in plot.marks]
        if len(self.starts) == 1:
            low, high = finite_range(*(mark.x for mark in marks))
            free = self.pad * (high - low)
            scale = LogScale(low, high, left, right) if self.log else Linear(low - free, high + free, left, right)
            return [(slice(0, None), scale)]
        rows = [slice(a, b) for a, b in zip(self.starts, [*self.starts[1:], None], strict=True)]
        ends = [finite_range(marks[0].x[part]) for part in rows]
        gap = min(10.0, 0.2 * (right - left) / len(rows))
        length = (right - left - gap * (len(rows) - 1)) / sum(high - low for low, high in ends)
        middle = float(np.median([high - low for low, high in ends]))
        step = min(round_step(_APART / length), round_step(middle / 2.5))  # two ticks in most stretches
        found: list[tuple[slice, AxisScale]] = []
        place = left
        for part, (low, high) in zip(rows, ends, strict=True):
            found.append((part, Linear(low, high, place, place + (high - low) * length, step)))
            place += (high - low) * length + gap
        return found


def chart(
    title: str, description: str, across: Across, plots: Sequence[Plot], width: float = WIDTH, detail: int = 0
) -> str:
    """Return a figure of plots with a common horizontal axis.

    Args:
        title: What it shows; stands above it.
        description: What can be seen, in words, with the figures that matter.
        across: The horizontal axis.
        plots: From top to bottom.
        width: In units of the drawing.
        detail: So many values of each mark go with the drawing, for a page that can zoom; 0 for none. All marks are
            lines or bands over the same rows then.
    """
    head, top = heading(title, [mark for plot in plots for mark in plot.marks if mark.label], width)
    tops = []
    named = _NAMED if across.parts else 0.0
    top += named
    for plot in plots:
        top += _ROW + 5 if plot.heading else 8
        tops.append(top)
        top += plot.height + 12
    scales = [plot.scale(at) for plot, at in zip(plots, tops, strict=True)]
    left = 9 + max(svg.breadth(tick.text) for scale in scales for tick in scale.ticks(30.0))
    pieces = across.pieces(plots, left, width - 12)
    live = [_parts(across.parts, pieces, tops, [plot.height for plot in plots])] if across.parts else []
    for plot, scale in zip(plots, scales, strict=True):
        live.append(_grid(plot, scale, pieces, left))
        live += [_marks(mark, scale, pieces) for mark in plot.marks]
        live.append(_levels(plot, scale, left, width - 12))
    bottom = tops[-1] + plots[-1].height
    live.append(_ticks(pieces, bottom))
    body = [head]
    raised = [named, *[0.0] * (len(plots) - 1)]
    places = zip(plots, tops, raised, strict=True)
    body += [svg.words(plot.heading, 0, at - 12 - up) for plot, at, up in places if plot.heading]
    body.append(svg.element("g", "".join(live), {"class": "live"}) if detail else "".join(live))
    rows = 2 if across.heading else 1
    body.append(svg.words(across.heading, width - 12, bottom + 2 * _ROW - 1, anchor="end") if across.heading else "")
    zoom = _zoom(plots, tops, across, pieces, detail) if detail else ""
    return svg.drawing(width, bottom + rows * _ROW + 5, "".join(body), title, description, zoom)


def _zoom(
    plots: Sequence[Plot], tops: Sequence[float], across: Across, pieces: Sequence[tuple[slice, AxisScale]], detail: int
) -> str:
    x = plots[0].marks[0].x
    places = np.concatenate([scale.at(x[rows]) for rows, scale in pieces])
    live = [
        LivePlot(top, plot.height, tuple(mark.live() for mark in plot.marks))
        for plot, top in zip(plots, tops, strict=True)
    ]
    ends = [(scale.start, scale.end, scale.low, scale.high) for _, scale in pieces if isinstance(scale, Linear)]
    return zoom_text(live, places, across.starts, ends, detail, across.parts)


def _parts(
    parts: Sequence[tuple[str, bool]],
    pieces: Sequence[tuple[slice, AxisScale]],
    tops: Sequence[float],
    heights: Sequence[float],
) -> str:
    """Shade the stretches that are to be told apart, and name those that have room for their name, alike ones once."""
    spans = [sorted(_ends(piece)) for _, piece in pieces]
    body = []
    for (start, end), (_, shaded) in zip(spans, parts, strict=True):
        for top, height in zip(tops, heights, strict=True) if shaded else ():
            wide = svg.number(end - start)
            path = f"M{svg.number(start)} {svg.number(top)}h{wide}v{svg.number(height)}h-{wide}z"
            body.append(svg.filled(path, 0, SHADE))
    whole: list[tuple[str, float, float]] = []
    for (name, _), (start, end) in zip(parts, spans, strict=True):
        before = whole.pop() if whole and whole[-1][0] == name else (name, start, end)
        whole.append((name, before[1], end))
    for name, start, end in whole:
        if svg.breadth(name) <= end - start:
            body.append(svg.words(name, 0.5 * (start + end), tops[0] - 4, anchor="middle"))
    return "".join(body)


def heading(title: str, marks: Sequence[Mark], width: float) -> tuple[str, float]:
    """Return the title with the legend beside it, or below where there is no room, and the height they take."""
    legend = list({mark.label: mark for mark in marks}.values())
    labels = [shorten(mark.label, 28) for mark in legend]
    sizes = [18 + 6 + svg.breadth(text) + 14 for text in labels]
    room = width - sum(sizes) - 16 if legend else width
    beside = sum(sizes) < 0.7 * width and (svg.breadth(title) * 1.06 <= room or sum(sizes) < 0.45 * width)
    shown = shorten(title, int((room if beside else width) / (1.06 * svg.LETTER)))
    body = [
        svg.element("g", svg.words(shown, 0, 15, "ink", full=title if shown != title else ""), {"font-weight": "600"})
    ]
    x, y = (width - sum(sizes) + 10, 15.0) if beside else (0.0, 15.0 + _ROW)
    for mark, text, size in zip(legend, labels, sizes, strict=True):
        if x > 0 and x + size > width + 14:
            x, y = 0.0, y + _ROW
        body.append(mark.sample(x, y - 4.5))
        body.append(svg.words(text, x + 24, y, full=mark.label if text != mark.label else ""))
        x += size
    return "".join(body), (y if legend else 15.0) + 5


def _grid(plot: Plot, scale: AxisScale, pieces: Sequence[tuple[slice, AxisScale]], left: float) -> str:
    spans = [sorted(_ends(piece)) for _, piece in pieces]
    body: list[str] = []
    for tick in scale.ticks(30.0):
        y = float(scale.at(np.array(tick.value)))
        body += [svg.rule(a, y, b, y, strong=tick.value == 0 and not plot.log) for a, b in spans]
        body.append(svg.words(tick.text, left - 7, y + 4.5, anchor="end"))
    return "".join(body)


def _ends(scale: AxisScale) -> tuple[float, float]:
    assert isinstance(scale, Linear | LogScale)
    return scale.start, scale.end


def _marks(mark: Mark, scale: AxisScale, pieces: Sequence[tuple[slice, AxisScale]]) -> str:
    return "".join(mark.placed(rows, piece, scale) for rows, piece in pieces)


def _levels(plot: Plot, scale: AxisScale, left: float, right: float) -> str:
    body = []
    for level in plot.levels:
        y = float(scale.at(np.array(level.value)))
        body.append(svg.stroke(svg.track(np.array([left, right]), np.array([y, y])), 0, 1.0, dashed=True))
        below = isinstance(scale, Linear | LogScale) and y + 16 < scale.start
        if level.text:
            body.append(svg.words(level.text, left + 4, y + 15 if below else y - 5, "ink", halo=True))
    return "".join(body)


def _ticks(pieces: Sequence[tuple[slice, AxisScale]], bottom: float) -> str:
    """Draw the horizontal axis; labels that would touch are left out, the first of a stretch last."""
    body: list[str] = []
    found: list[tuple[int, float, str]] = []
    for _, scale in pieces:
        start, end = _ends(scale)
        body.append(svg.rule(start, bottom, end, bottom, strong=True))
        ticks = scale.ticks(_APART)
        found += [(k, float(scale.at(np.array(tick.value))), tick.text) for k, tick in enumerate(ticks)]
    taken: list[tuple[float, float]] = []
    for _, x, text in sorted(found, key=lambda entry: entry[0]):
        body.append(svg.rule(x, bottom, x, bottom + 4, strong=True))
        half = svg.breadth(text) / 2 + 3
        if all(x + half < left or x - half > right for left, right in taken):
            taken.append((x - half, x + half))
            body.append(svg.words(text, x, bottom + _ROW - 2, anchor="middle"))
    return "".join(body)
