"""Sphere, Capsule, Box, Cylinder, Mesh: the space that a body takes up, as frozen values in the frame of its link.

They say what a description states; a clearance check works with the capsules that cover them, see
excitation/collision/covering.py.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from dynident.arrays import Array, frozen


@dataclass(frozen=True)
class Sphere:
    """A ball.

    Attributes:
        radius: Radius, in m.
        centre: Centre in the link frame, shape (3,), in m.
    """

    radius: float
    centre: Array = field(default_factory=lambda: np.zeros(3))

    def __post_init__(self) -> None:
        _set_size(self, "radius")
        object.__setattr__(self, "centre", frozen(self.centre, (3,), "centre"))

    def moved(self, rotation: npt.ArrayLike, translation: npt.ArrayLike) -> Sphere:
        """Return the shape seen from a frame in which this frame is placed at (rotation, translation)."""
        return Sphere(self.radius, np.asarray(rotation) @ self.centre + np.asarray(translation))


@dataclass(frozen=True)
class Capsule:
    """All points within ``radius`` of the segment from ``start`` to ``end``; a sphere where the two are one.

    Attributes:
        start: One end of the segment in the link frame, shape (3,), in m.
        end: The other end, shape (3,), in m.
        radius: Radius, in m; 0 is a bare segment.
    """

    start: Array
    end: Array
    radius: float

    def __post_init__(self) -> None:
        _set_size(self, "radius", above=False)
        object.__setattr__(self, "start", frozen(self.start, (3,), "start"))
        object.__setattr__(self, "end", frozen(self.end, (3,), "end"))

    @property
    def length(self) -> float:
        """Length of the segment, in m; the capsule is longer by twice its radius."""
        return float(np.linalg.norm(self.end - self.start))

    @property
    def volume(self) -> float:
        """Volume, in m^3."""
        return float(np.pi * self.radius**2 * (self.length + 4.0 / 3.0 * self.radius))

    def distances(self, points: npt.ArrayLike) -> Array:
        """Return the signed distances of points (k, 3) from the surface, shape (k,), in m; negative inside."""
        away = np.asarray(points, dtype=float) - self.start
        along = self.end - self.start
        square = float(along @ along)
        share = np.clip(away @ along / square, 0.0, 1.0) if square > 0 else np.zeros(len(away))
        return np.linalg.norm(away - share[:, None] * along, axis=1) - self.radius

    def moved(self, rotation: npt.ArrayLike, translation: npt.ArrayLike) -> Capsule:
        """Return the shape seen from a frame in which this frame is placed at (rotation, translation)."""
        turn, shift = np.asarray(rotation), np.asarray(translation)
        return Capsule(turn @ self.start + shift, turn @ self.end + shift, self.radius)


@dataclass(frozen=True)
class Box:
    """A box about the origin of its own frame.

    Attributes:
        size: Full edge lengths along its axes, shape (3,), in m.
        rotation: Orientation in the link frame, shape (3, 3).
        translation: Centre in the link frame, shape (3,), in m.
    """

    size: Array
    rotation: Array = field(default_factory=lambda: np.eye(3))
    translation: Array = field(default_factory=lambda: np.zeros(3))

    def __post_init__(self) -> None:
        object.__setattr__(self, "size", frozen(self.size, (3,), "size"))
        if not np.all((self.size > 0) & np.isfinite(self.size)):
            raise ValueError(f"the size of a box is {self.size.tolist()}")
        _set_pose(self)

    @classmethod
    def between(cls, lower: npt.ArrayLike, upper: npt.ArrayLike) -> Box:
        """Return the box between two corners, shape (3,) each, along the axes of the frame."""
        low, high = np.asarray(lower, dtype=float), np.asarray(upper, dtype=float)
        return cls(high - low, np.eye(3), 0.5 * (low + high))

    @property
    def corners(self) -> Array:
        """The eight corners in the link frame, shape (8, 3), in m."""
        signs = np.stack(np.meshgrid(*[[-0.5, 0.5]] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
        return (signs * self.size) @ self.rotation.T + self.translation

    def moved(self, rotation: npt.ArrayLike, translation: npt.ArrayLike) -> Box:
        """Return the shape seen from a frame in which this frame is placed at (rotation, translation)."""
        return Box(self.size, *_placed(self, rotation, translation))


@dataclass(frozen=True)
class Cylinder:
    """A cylinder along the z axis of its own frame, centred.

    Attributes:
        radius: Radius, in m.
        length: Length, in m.
        rotation: Orientation in the link frame, shape (3, 3).
        translation: Centre in the link frame, shape (3,), in m.
    """

    radius: float
    length: float
    rotation: Array = field(default_factory=lambda: np.eye(3))
    translation: Array = field(default_factory=lambda: np.zeros(3))

    def __post_init__(self) -> None:
        _set_size(self, "radius")
        _set_size(self, "length")
        _set_pose(self)

    def moved(self, rotation: npt.ArrayLike, translation: npt.ArrayLike) -> Cylinder:
        """Return the shape seen from a frame in which this frame is placed at (rotation, translation)."""
        return Cylinder(self.radius, self.length, *_placed(self, rotation, translation))


@dataclass(frozen=True)
class Mesh:
    """A reference to a file of triangles; the file is read only where its points are needed.

    Attributes:
        file: File name or URI as the robot model writes it, such as ``package://arm/meshes/link1.stl``.
        scale: What the file's coordinates are multiplied by to be in m, shape (3,); a negative one mirrors.
        rotation: Orientation in the link frame, shape (3, 3).
        translation: Position in the link frame, shape (3,), in m.
        points: Outermost points of the file once it is read, scaled, in the mesh's own frame, shape (k, 3), in m.
    """

    file: str
    scale: Array = field(default_factory=lambda: np.ones(3))
    rotation: Array = field(default_factory=lambda: np.eye(3))
    translation: Array = field(default_factory=lambda: np.zeros(3))
    points: Array | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "scale", frozen(self.scale, (3,), "scale"))
        if not np.all((self.scale != 0) & np.isfinite(self.scale)):
            raise ValueError(f"the scale of a mesh is {self.scale.tolist()}")
        _set_pose(self)

    def moved(self, rotation: npt.ArrayLike, translation: npt.ArrayLike) -> Mesh:
        """Return the shape seen from a frame in which this frame is placed at (rotation, translation)."""
        return Mesh(self.file, self.scale, *_placed(self, rotation, translation), self.points)


Shape: TypeAlias = Sphere | Capsule | Box | Cylinder | Mesh


def _set_size(shape: Sphere | Capsule | Cylinder, name: str, *, above: bool = True) -> None:
    value = float(getattr(shape, name))
    if not (np.isfinite(value) and (value > 0 or (value == 0 and not above))):
        raise ValueError(f"the {name} of a {type(shape).__name__.lower()} is {value:g}")
    object.__setattr__(shape, name, value)


def _set_pose(shape: Box | Cylinder | Mesh) -> None:
    object.__setattr__(shape, "rotation", frozen(shape.rotation, (3, 3), "rotation"))
    object.__setattr__(shape, "translation", frozen(shape.translation, (3,), "translation"))


def _placed(shape: Box | Cylinder | Mesh, rotation: npt.ArrayLike, translation: npt.ArrayLike) -> tuple[Array, Array]:
    turn = np.asarray(rotation, dtype=float)
    return turn @ shape.rotation, turn @ shape.translation + np.asarray(translation, dtype=float)
