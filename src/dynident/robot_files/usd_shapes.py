"""The shapes of a body of a USD stage: cubes, spheres, cylinders, capsules and meshes, in the frame of its prim."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from dynident.arrays import Array
from dynident.model.documents.numbers import Place
from dynident.model.shapes import Box, Capsule, Cylinder, Shape, Sphere

#: Sizes that a shape has, by the type of its prim.
_SIZES: Final = {
    "Cube": ("size",),
    "Sphere": ("radius",),
    "Cylinder": ("radius", "height"),
    "Capsule": ("radius", "height"),
    "Cone": ("radius", "height"),
}

#: Largest difference of scales that are one, and of directions that are at right angles.
_SAME: Final = 1e-5


def shape_of(prim: Any, matrix: Array, length: float, place: Place) -> Shape | None:
    """Return the shape of a prim, the box around it where it is stretched or of another kind; None where it has none.

    Args:
        prim: The prim.
        matrix: Its transform to the frame of its body, a row of coordinates times the matrix, shape (4, 4).
        length: m in the unit of the stage.
        place: Where it stands, for messages.

    Raises:
        DescriptionError: A size that is no length, or points that are no numbers.
    """
    found, scales = _half_sizes(prim, place), np.linalg.norm(matrix[:3, :3], axis=1)
    if found is None or not (np.all(np.isfinite(matrix)) and np.all(scales > 0.0)):
        return None
    middle, half, along = found
    directions = (matrix[:3, :3] / scales[:, None]).T
    centre = (middle @ matrix[:3, :3] + matrix[3, :3]) * length
    if np.abs(directions.T @ directions - np.eye(3)).max() > _SAME:  # sheared: the box about its corners
        return Box(2.0 * length * half @ np.abs(matrix[:3, :3]), np.eye(3), centre)
    if np.linalg.det(directions) < 0.0:
        directions = directions * [1.0, 1.0, -1.0]  # mirrored: each shape is symmetric
    size = half * scales * length
    round_one = _round(str(prim.GetTypeName()), size, along, (directions, centre))
    return round_one or Box(2.0 * size, directions, centre)


def _round(kind: str, size: Array, along: int, pose: tuple[Array, Array]) -> Shape | None:
    """Return the sphere, cylinder or capsule of half lengths ``size`` (3,); None where it is none or stretched."""
    (directions, centre), across = pose, np.delete(size, along)
    if np.ptp(across) > _SAME * across.max() or (kind == "Sphere" and np.ptp(size) > _SAME * size.max()):
        return None
    turn, radius = np.roll(directions, 2 - along, axis=1), float(across.mean())
    if kind == "Sphere":
        return Sphere(radius, centre)
    if kind == "Cylinder":
        return Cylinder(radius, 2.0 * float(size[along]), turn, centre)
    reach = max(float(size[along]) - radius, 0.0) * turn[:, 2]
    return Capsule(centre - reach, centre + reach, radius) if kind == "Capsule" else None


def _half_sizes(prim: Any, place: Place) -> tuple[Array, Array, int] | None:
    """Return middle and half lengths (3,) of the box around a prim in its own frame, and the number of its axis."""
    kind = str(prim.GetTypeName())
    if kind in ("Mesh", "Points"):
        points = np.array(prim.GetAttribute("points").Get() or np.zeros((0, 3)), dtype=float)
        if not len(points):
            return None
        if not np.all(np.isfinite(points)):
            raise place.error("points that are no numbers", "export the mesh again")
        low, high = points.min(axis=0), points.max(axis=0)
        half = (high - low) / 2.0
        return ((low + high) / 2.0, np.maximum(half, _SAME * half.max()), 2) if half.any() else None
    if kind not in _SIZES:
        return None
    sizes = [float(prim.GetAttribute(name).Get()) for name in _SIZES[kind]]
    if not all(0.0 < size < np.inf for size in sizes):
        told = ", ".join(f"{name} {size:g}" for name, size in zip(_SIZES[kind], sizes, strict=True))
        raise place.error(f"its {told} is no length", "write lengths above 0")
    if kind == "Cube":
        return np.zeros(3), np.full(3, sizes[0] / 2.0), 2
    if kind == "Sphere":
        return np.zeros(3), np.full(3, sizes[0]), 2
    letter = str(prim.GetAttribute("axis").Get())
    if letter not in ("X", "Y", "Z"):
        raise place.error(f"its axis is '{letter}'", "write X, Y or Z")
    along = "XYZ".index(letter)
    half = np.full(3, sizes[0])
    half[along] = sizes[1] / 2.0 + (sizes[0] if kind == "Capsule" else 0.0)
    return np.zeros(3), half, along
