"""Where an element of an MJCF is placed: position and any of the five ways to write an orientation."""

from __future__ import annotations

from typing import Final

import numpy as np

from dynident.arrays import Array
from dynident.model.documents.numbers import shown
from dynident.model.joint import rotation_about
from dynident.robot_files.mjcf.document import CompilerSettings
from dynident.robot_files.rotations import rotation_from_euler, rotation_from_quaternion, rotation_to_axis
from dynident.robot_files.xml_elements import Values

Pose = tuple[Array, Array]

ORIENTATIONS: Final = ("quat", "axisangle", "xyaxes", "zaxis", "euler")
IDENTITY: Final[Pose] = (np.eye(3), np.zeros(3))


def pose_of(values: Values, compiler: CompilerSettings) -> Pose:
    """Return rotation and position of an element in the frame that it stands in.

    Raises:
        DescriptionError: No numbers, several orientations, or one that is none.
    """
    position = values.numbers("pos", 3) if "pos" in values else np.zeros(3)
    return rotation_of(values, compiler), position


def rotation_of(values: Values, compiler: CompilerSettings) -> Array:
    """Return the orientation of an element, shape (3, 3)."""
    written = [name for name in ORIENTATIONS if name in values]
    if not written:
        return np.eye(3)
    if len(written) > 1:
        raise values.place.error(f"it has both {written[0]} and {written[1]}", "keep one of the two")
    name = written[0]
    numbers = values.numbers(name, {"quat": 4, "axisangle": 4, "xyaxes": 6, "zaxis": 3, "euler": 3}[name])
    if name == "euler":
        return rotation_from_euler(compiler.unit * numbers, compiler.sequence)
    first = numbers if name == "quat" else numbers[:3]
    length = float(np.linalg.norm(first))
    if not 1e-14 < length < np.inf:
        raise values.place.error(f"{name} {shown(values.text(name))} has no direction", "write one that is not zero")
    if name == "quat":
        return rotation_from_quaternion(numbers / length)
    if name == "axisangle":
        return rotation_about(first / length, compiler.unit * float(numbers[3]))
    if name == "zaxis":
        return rotation_to_axis(first)
    x = first / length
    y = numbers[3:] - (x @ numbers[3:]) * x
    if np.linalg.norm(y) < 1e-14:
        raise values.place.error(f"xyaxes {shown(values.text(name))} are parallel", "write two axes that differ")
    y = y / np.linalg.norm(y)
    return np.column_stack([x, y, np.cross(x, y)])


def placed(outer: Pose, inner: Pose) -> Pose:
    """Return where a pose in a frame is in the frame of the frame."""
    return outer[0] @ inner[0], outer[1] + outer[0] @ inner[1]
