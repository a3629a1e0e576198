"""Reading figures back: their elements, the boxes of their labels, the points of their paths."""

from __future__ import annotations

import re
from dataclasses import dataclass
from itertools import combinations
from xml.etree.ElementTree import Element

import numpy as np
from defusedxml.ElementTree import fromstring

NAMESPACE = "{http://www.w3.org/2000/svg}"

#: Width and height of a letter of 13 units in a common face.
ACROSS, UP = 7.2, 11.0


@dataclass(frozen=True)
class Box:
    """Where a label stands."""

    text: str
    left: float
    right: float
    top: float
    bottom: float

    def meets(self, other: Box) -> bool:
        """Say whether two labels stand on each other, by more than a hair."""
        across = min(self.right, other.right) - max(self.left, other.left)
        return across > 1.0 and min(self.bottom, other.bottom) - max(self.top, other.top) > 1.0


def parsed(figure: str) -> Element:
    """Return the root element of a figure; fails where it is not well formed."""
    root = fromstring(figure)
    assert root.tag == f"{NAMESPACE}svg"
    return root


def named(root: Element, name: str) -> list[Element]:
    """Return all elements with a tag."""
    return root.findall(f".//{NAMESPACE}{name}")


def labels(root: Element) -> list[Box]:
    """Return the boxes of all texts."""
    boxes = []
    for found in named(root, "text"):
        text = found.text or ""
        x, y, wide = float(found.attrib["x"]), float(found.attrib["y"]), ACROSS * len(text)
        left = {"start": x, "middle": x - wide / 2, "end": x - wide}[found.attrib["text-anchor"]]
        boxes.append(Box(text, left, left + wide, y - UP + 1, y + 1))
    return boxes


def check_labels(figure: str) -> None:
    """Fail where two labels overlap, one leaves the drawing, or the alternative texts are missing."""
    root = parsed(figure)
    assert root.attrib["role"] == "img"
    texts = [child.text for child in root if child.tag in (f"{NAMESPACE}title", f"{NAMESPACE}desc")]
    assert len(texts) == 2 and all(texts)
    assert root.attrib["aria-label"] == texts[0]
    _, _, width, height = (float(part) for part in root.attrib["viewBox"].split())
    boxes = labels(root)
    for box in boxes:
        assert box.left >= -1 and box.right <= width + 8, box
        assert box.top >= -1 and box.bottom <= height + 1, box
    for a, b in combinations(boxes, 2):
        assert not a.meets(b), (a, b)


def points(data: str) -> list[np.ndarray]:
    """Return the points of each stretch of path data made of M and coordinates, shape (N, 2) each."""
    return [
        np.array([float(v) for v in re.findall(r"-?[\d.]+(?:e-?\d+)?", part)]).reshape(-1, 2)
        for part in data.split("M")[1:]
    ]


def lines(root: Element, name: str) -> list[str]:
    """Return the path data of all lines in a colour class that are longer than a sample in the legend."""
    paths = [path.attrib["d"] for path in named(root, "path") if path.get("class") == name]
    return [data for data in paths if max(np.ptp(part[:, 0]) for part in points(data)) > 19]
