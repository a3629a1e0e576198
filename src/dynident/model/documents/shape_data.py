"""Shapes as plain data for JSON, and back, exactly."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

from dynident.arrays import Array
from dynident.model.documents.sections import Section
from dynident.model.shapes import Box, Capsule, Cylinder, Mesh, Shape, Sphere

_KEYS: Final[Mapping[str, tuple[str, ...]]] = {
    "sphere": ("kind", "radius", "centre"),
    "capsule": ("kind", "start", "end", "radius"),
    "box": ("kind", "size", "rotation", "translation"),
    "cylinder": ("kind", "radius", "length", "rotation", "translation"),
    "mesh": ("kind", "file", "scale", "rotation", "translation"),
}
_ALL: Final = tuple(dict.fromkeys(key for keys in _KEYS.values() for key in keys))


def shapes_to_list(shapes: Sequence[Shape]) -> list[dict[str, Any]]:
    """Return shapes as plain data; :func:`read_shapes` gives back the same numbers, bit by bit."""
    found = []
    for shape in shapes:
        kind = type(shape).__name__.lower()
        values = {key: getattr(shape, key) for key in _KEYS[kind][1:]}
        found.append({"kind": kind, **{k: v.tolist() if isinstance(v, np.ndarray) else v for k, v in values.items()}})
    return found


def read_shapes(section: Section, key: str) -> tuple[Shape, ...]:
    """Return the shapes in the list under a key; none where the key is missing.

    Raises:
        DescriptionError: No list of shapes, an unknown kind or key, a size that is not above 0.
    """
    if not section.has(key):
        return ()
    return tuple(_shape(item) for item in section.sections(key, _ALL))


def read_rotation(section: Section) -> Array:
    """Return the rotation matrix under the key rotation, shape (3, 3).

    Raises:
        DescriptionError: Missing, or no rotation.
    """
    rotation = section.matrix("rotation", 3, 3)
    if np.abs(rotation @ rotation.T - np.eye(3)).max() > 1e-6 or np.linalg.det(rotation) < 0:
        raise section.place("rotation").error("the matrix is no rotation", "write an orthogonal matrix, determinant 1")
    return rotation


def _shape(section: Section) -> Shape:
    kind = section.choice("kind", tuple(_KEYS))
    section.known(_KEYS[kind])
    if kind == "sphere":
        return Sphere(_size(section, "radius"), section.numbers("centre", 3))
    if kind == "capsule":
        ends = section.numbers("start", 3), section.numbers("end", 3)
        return Capsule(*ends, section.at_least_zero("radius"))
    pose = read_rotation(section), section.numbers("translation", 3)
    if kind == "cylinder":
        return Cylinder(_size(section, "radius"), _size(section, "length"), *pose)
    if kind == "mesh":
        scale = section.numbers("scale", 3)
        if np.any(scale == 0.0):
            raise section.place("scale").error("a factor is zero", "write three factors")
        return Mesh(section.text("file"), scale, *pose)
    size = section.numbers("size", 3)
    if np.any(size <= 0.0):
        raise section.place("size").error(f"an edge is {size.min():g} m", "write three lengths above 0")
    return Box(size, *pose)


def _size(section: Section, key: str) -> float:
    value = section.number(key)
    if value <= 0.0:
        raise section.place(key).error(f"{value:g} is not above 0", "write a length in m")
    return value
