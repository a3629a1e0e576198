"""Rotation matrices as quaternions and as roll, pitch and yaw, exact to rounding at every orientation."""

from __future__ import annotations

import numpy as np

from dynident.arrays import Array


def quaternion(rotation: Array) -> Array:
    """Return (w, x, y, z) with w >= 0 of a rotation matrix, shape (3, 3) -> (4,) (Shepperd 1978: no small divisor)."""
    r = np.asarray(rotation, dtype=float)
    trace = float(np.trace(r))
    squares = np.array([1.0 + trace, *(1.0 + 2.0 * np.diag(r) - trace)])  # 4 w^2, 4 x^2, 4 y^2, 4 z^2
    k = int(np.argmax(squares))
    odd = np.array([r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]])
    if k == 0:
        found = np.array([squares[0], *odd])
    else:
        a = k - 1
        found = np.array([odd[a], *(r[a] + r[:, a])])
        found[k] = squares[k]
    found = found / np.linalg.norm(found)
    return (found if found[0] >= 0 else -found) + 0.0


def roll_pitch_yaw(rotation: Array) -> Array:
    """Return (roll, pitch, yaw) in rad with R = Rz(yaw) Ry(pitch) Rx(roll), shape (3, 3) -> (3,).

    Where pitch is a right angle only roll and yaw together are determined: yaw is then what rounding makes it, and roll
    is computed for that yaw.
    """
    r = np.asarray(rotation, dtype=float)
    yaw = np.arctan2(r[1, 0], r[0, 0])
    cos, sin = np.cos(yaw), np.sin(yaw)
    rest = np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]]) @ r  # Ry(pitch) Rx(roll)
    return np.array([np.arctan2(-rest[1, 2], rest[1, 1]), np.arctan2(-rest[2, 0], rest[0, 0]), yaw]) + 0.0
