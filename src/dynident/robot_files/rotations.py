"""Rotation matrices from what files of robot models write: angles in an order, quaternions, axes."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from dynident.arrays import Array
from dynident.model.joint import rotation_about


def rotation_from_rpy(rpy: npt.ArrayLike) -> Array:
    """Return R = Rz(yaw) Ry(pitch) Rx(roll) for (roll, pitch, yaw) in rad, shape (3,) -> (3, 3) (URDF's order)."""
    (sr, sp, sy), (cr, cp, cy) = np.sin(rpy), np.cos(rpy)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def rotation_from_quaternion(quaternion: npt.ArrayLike) -> Array:
    """Return the rotation of a unit quaternion (w, x, y, z), shape (4,) -> (3, 3)."""
    w, x, y, z = np.asarray(quaternion, dtype=float)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def rotation_from_euler(angles: npt.ArrayLike, sequence: str) -> Array:
    """Return the rotation of three angles in rad about axes in turn, shape (3,) -> (3, 3).

    Args:
        angles: The angles.
        sequence: Three of ``xyz`` (axes that turn along) and ``XYZ`` (axes that stay).
    """
    found = np.eye(3)
    for angle, letter in zip(np.asarray(angles, dtype=float), sequence, strict=True):
        turn = rotation_about(np.eye(3)["xyz".index(letter.lower())], angle)
        found = found @ turn if letter.islower() else turn @ found
    return found


def rotation_to_axis(axis: npt.ArrayLike) -> Array:
    """Return the smallest rotation that takes z to a direction, shape (3,) -> (3, 3); about x where it is -z."""
    x, y, z = np.asarray(axis, dtype=float) / np.linalg.norm(axis)
    length = float(np.hypot(x, y))
    if length < 1e-10:
        return np.eye(3) if z > 0 else np.diag([1.0, -1.0, -1.0])
    return rotation_about(np.array([-y, x, 0.0]) / length, float(np.arctan2(length, z)))
