"""SVG text: elements, path data and the frame that every figure shares.

Colours are named by class (``ink``, ``soft``, ``rule``, ``c0`` to ``c6``) so that a page can set them for light and
dark; the attributes beside them are the light colours, so that a figure saved on its own looks right too.
"""

from __future__ import annotations

import html
from collections.abc import Mapping

import numpy as np

from dynident.arrays import Array, IntArray
from dynident.results.text import clean, display_width, label

#: Height of letters and the width of an average one, in units of the drawing.
SIZE = 13.0
LETTER = 0.61 * SIZE

#: Ink, then the palette of Okabe and Ito (2008) without its yellow, which white paper hides.
COLOURS = ("#1b1f24", "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")

_INK = {"ink": COLOURS[0], "soft": "#5b6570"}


def escape(text: object) -> str:
    """Return text that is only text, in an element or in a quoted attribute."""
    return html.escape(clean(text), quote=True)


def number(value: float) -> str:
    """Return a coordinate to a tenth of a unit."""
    return f"{round(float(value), 1) + 0.0:g}"


def element(name: str, content: str = "", attributes: Mapping[str, object] | None = None) -> str:
    """Return an element; attributes are escaped, ``content`` is SVG and is not.

    Args:
        name: Tag.
        content: What stands inside.
        attributes: By name; numbers keep a tenth.
    """
    parts = [name]
    for key, value in (attributes or {}).items():
        text = number(float(value)) if isinstance(value, float | np.floating) else escape(value)
        parts.append(f'{key}="{text}"')
    opened = " ".join(parts)
    return f"<{opened}>{content}</{name}>" if content else f"<{opened}/>"


def words(
    text: str, x: float, y: float, shade: str = "soft", anchor: str = "start", full: str = "", halo: bool = False
) -> str:
    """Return a line of text.

    Args:
        text: What it says; only text.
        x: Where it is anchored.
        y: Its base line.
        shade: ``ink`` or ``soft``.
        anchor: ``start``, ``middle`` or ``end``.
        full: The whole of a text that was shortened, as a title.
        halo: Whether paper shows around the letters where they stand on data.
    """
    inside = escape(text) + (element("title", escape(full)) if full else "")
    style: dict[str, object] = {"class": shade, "fill": _INK[shade], "text-anchor": anchor}
    if halo:
        style |= {"class": f"{shade} halo", "stroke": "#ffffff", "stroke-width": 3.5, "paint-order": "stroke"}
    return element("text", inside, {"x": float(x), "y": float(y), **style})


def breadth(text: str) -> float:
    """Return about how wide a line of text is drawn."""
    return display_width(text) * LETTER


def rule(x1: float, y1: float, x2: float, y2: float, strong: bool = False) -> str:
    """Return a line of the grid or, where ``strong``, of an axis."""
    style = {"class": "axis", "stroke": "#8a929b"} if strong else {"class": "rule", "stroke": "#e1e4e8"}
    return element("line", attributes={"x1": float(x1), "y1": float(y1), "x2": float(x2), "y2": float(y2), **style})


def track(x: Array, y: Array) -> str:
    """Return path data through points (N,), with a break at every point that is not finite."""
    good = np.isfinite(x) & np.isfinite(y)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], good, [False]]).astype(int)))
    parts = []
    for start, stop in zip(edges[::2], edges[1::2], strict=True):
        xs, ys = np.round(x[start:stop], 1).tolist(), np.round(y[start:stop], 1).tolist()
        parts.append("M" + " ".join(f"{a:g} {b:g}" for a, b in zip(xs, ys, strict=True)))
    return "".join(parts)


def stroke(
    data: str, colour: int, width: float = 1.3, dashed: bool = False, opacity: float = 1.0, round_ends: bool = False
) -> str:
    """Return a line along path data in a colour of the palette."""
    more: dict[str, object] = {"stroke-width": width}
    if round_ends:
        more["stroke-linecap"] = "round"
    if dashed:
        more["stroke-dasharray"] = "5 3"
    if opacity < 1:
        more["stroke-opacity"] = f"{opacity:g}"
    name = f"c{colour % len(COLOURS)}"
    fixed = {"fill": "none", "class": name, "stroke": COLOURS[colour % len(COLOURS)], "stroke-linejoin": "round"}
    return element("path", attributes={"d": data, **fixed, **more}) if data else ""


def filled(data: str, colour: int, opacity: float = 1.0) -> str:
    """Return an area along path data in a colour of the palette."""
    name = f"d{colour % len(COLOURS)}"
    fill = {"fill": COLOURS[colour % len(COLOURS)], "fill-opacity": f"{opacity:g}"}
    return element("path", attributes={"d": data, "class": name, **fill})


def kept_rows(x: Array, y: Array, bucket: float = 0.5) -> IntArray:
    """Return the rows of a line that show at a given resolution: the lowest and highest in each stretch of x.

    Args:
        x: Positions in the drawing, not falling, shape (N,).
        y: Heights, shape (N,); NaN where there is none.
        bucket: Length of a stretch.
    """
    rows = len(x)
    if rows < 4 or rows <= 2 * (x[-1] - x[0]) / bucket:
        return np.arange(rows)
    place = np.floor((x - x[0]) / bucket)
    starts = np.flatnonzero(np.concatenate([[True], np.diff(place) > 0]))
    lengths = np.diff(np.append(starts, rows))
    missing = np.isnan(y)
    found = [np.array([0, rows - 1])]
    for values, extreme in ((np.where(missing, np.inf, y), np.minimum), (np.where(missing, -np.inf, y), np.maximum)):
        hits = np.flatnonzero(values == np.repeat(extreme.reduceat(values, starts), lengths))
        found.append(hits[np.searchsorted(hits, starts)])
    return np.unique(np.concatenate(found))


def drawing(width: float, height: float, body: str, title: str, description: str, zoom: str = "") -> str:
    """Return a whole figure with its title and the robot model that stands for it where it cannot be seen.

    Args:
        width: Of the drawing.
        height: Of the drawing.
        body: What stands in it, as SVG.
        title: What it shows.
        description: What can be seen.
        zoom: Values for a page that can zoom; empty for none.
    """
    title = label(title)
    attributes: dict[str, object] = {
        "xmlns": "http://www.w3.org/2000/svg",
        "class": "fig",
        "viewBox": f"0 0 {number(width)} {number(height)}",
        "role": "img",
        "aria-label": title,
        "font-family": "system-ui, sans-serif",
        "font-size": SIZE,
    }
    inside = element("title", escape(title)) + element("desc", escape(description)) + body
    return element("svg", inside, attributes | ({"data-zoom": zoom} if zoom else {}))
