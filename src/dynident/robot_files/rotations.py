"""Rotation matrices from what files of robot models write: angles in an order, quaternions, axes."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from dynident.arrays import Array


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
