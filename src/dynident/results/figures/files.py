"""Figures as files of their own: SVG as drawn, PDF and PNG by Typst, which brings all it needs in one wheel."""

from __future__ import annotations

import importlib
import re

from dynident.errors import MissingDependency, UnknownChoice

#: Formats of a figure file.
FORMATS = ("svg", "pdf", "png")

#: Dots per inch of a PNG; a drawing of 480 units, 127 mm wide, gets 1500 of them.
DOTS = 300.0

#: Unlike a page, a paper asks for the letters that its readers have.
_FACES = "Helvetica, Arial, 'Liberation Sans', 'DejaVu Sans', sans-serif"

#: The last number below an axis reaches so far over the edge of a drawing; a page shows it, a file would cut it.
_EDGE = 8.0

_LONGEST = 64
_NOT_PLAIN = re.compile(r"[^a-z0-9_.]+")
_VIEW = re.compile(r'viewBox="0 0 ([\d.]+) ([\d.]+)"')

#: What a page needs and a file does not.
_LIVE = re.compile(r' data-zoom="[^"]*"')

#: 1 unit of a drawing is a pixel of a page, 1/96 of an inch.
_PAGE = """#set document(title: sys.inputs.title, date: none)
#set page(width: auto, height: auto, margin: 3pt, fill: {fill})
#image("figure.svg", width: {width:.4f}pt, alt: sys.inputs.said)
"""


def file_stem(*words: str) -> str:
    """Return words as the name of a file that every system takes: small letters, digits, ``_``, ``.`` and ``-``.

    Words are joined by hyphens, empty ones left out; one of which nothing is left is called ``unnamed``.
    """
    plain = (_NOT_PLAIN.sub("-", word.lower())[:_LONGEST].strip("-.") or "unnamed" for word in words if word)
    return "-".join(plain) or "unnamed"


def figure_file(drawing: str, title: str, description: str, format: str = "svg") -> bytes:
    """Return a figure as the content of a file.

    Args:
        drawing: SVG text of a figure of this package.
        title: What it shows; the title of a PDF.
        description: What can be seen; the alternative text of a PDF.
        format: ``svg``, ``pdf`` (letters are letters, fonts embedded) or ``png`` (300 dots per inch, white paper).

    Raises:
        MissingDependency: PDF and PNG need the package typst.
        UnknownChoice: Another format.
    """
    if format not in FORMATS:
        raise UnknownChoice("figure format", format, FORMATS)
    own = _on_its_own(str(drawing))
    return own.encode("utf-8") if format == "svg" else _typeset(own, title, description, format)


def _on_its_own(drawing: str) -> str:
    """Return the drawing with its size in pixels, room at both sides and the faces of a paper."""
    view = _VIEW.search(drawing)
    assert view is not None
    width, height = float(view[1]) + 2 * _EDGE, float(view[2])
    own = f'width="{width:g}" height="{height:g}" viewBox="{-_EDGE:g} 0 {width:g} {height:g}"'
    sized = _LIVE.sub("", drawing).replace(view[0], own, 1)
    return sized.replace('font-family="system-ui, sans-serif"', f'font-family="{_FACES}"', 1) + "\n"


def _typeset(drawing: str, title: str, description: str, format: str) -> bytes:
    try:
        typst = importlib.import_module("typst")
    except ImportError as error:
        raise MissingDependency(f"writing figures as {format.upper()}", "typst", "figures") from error
    width = re.search(r'width="([\d.]+)"', drawing)
    assert width is not None
    page = _PAGE.format(width=0.75 * float(width[1]), fill="white" if format == "png" else "none")
    files = {"main.typ": page.encode(), "figure.svg": drawing.encode()}
    made = typst.compile(files, format=format, ppi=DOTS, sys_inputs={"title": title, "said": description})
    assert isinstance(made, bytes)
    return made
