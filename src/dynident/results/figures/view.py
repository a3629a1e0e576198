"""A parallel projection of space onto a drawing, and where labels may stand in it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dynident.arrays import Array
from dynident.results.figures import svg

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
