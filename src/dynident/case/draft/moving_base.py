"""Columns of the pose or velocity of a base: a robot whose base moves in the log is not what is identified."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dynident.case.draft.column_groups import joint_columns
from dynident.case.draft.column_words import KIND, tokens_of
from dynident.case.draft.yaml_words import few
from dynident.data.formats import LogTable
from dynident.errors import LogFormatError
from dynident.model.robot import Robot

#: Words for a base, and for its pose and velocity; accelerations and forces have noise and gravity.
_BASES = frozenset("base odom odometry platform vehicle chassis pelvis torso basis".split())
_MOTIONS = frozenset(
    "x y z roll pitch yaw rx ry rz qx qy qz qw vx vy vz wx wy wz pos position pose vel velocity twist linear angular "
    "orientation quat quaternion lin ang omega speed heading".split()
)
_OTHERS = frozenset("acc accel acceleration force wrench torque tau covariance cov stamp sec nanosec time".split())

#: Words for the end of an arm, whose pose has the base for its frame (``base.tool_pose_x`` of Kortex) or beside it.
_ENDS = frozenset("tool tcp ee eef effector endeffector flange gripper hand wrist tip camera".split())

#: Span of a column, outliers left out, from which it moves: m, rad, m/s or rad/s.
_MOVES, _OUTLIERS = 0.05, (0.02, 0.98)

#: Rows that are looked at of each log.
_ROWS = 1 << 15


def moving_base(robot: Robot, tables: Sequence[LogTable]) -> list[str]:
    """Return what is said of logs whose columns of a base's pose or velocity move; nothing where none do.

    Args:
        robot: Whose joints are no base.
        tables: The logs.
    """
    of_joints = {name for own in joint_columns(tables[0].header, robot.joint_names).values() for name in own}
    names = [name for name in tables[0].header if name not in of_joints and _is_of_base(name)]
    found = dict[str, float]()
    for table in tables if names else ():
        for name, span in zip(names, _spans(table, names), strict=True):
            if span > _MOVES:
                found[name] = max(span, found.get(name, 0.0))
    if not found:
        return []
    most = max(found, key=lambda name: found[name])
    what = f"the base moves ({few(list(found), 6)}; {few([most])} by {found[most]:.3g})"
    return [f"{what}: a robot is identified on a base at rest, and these logs cannot be: record with the base at rest"]


def _is_of_base(name: str) -> bool:
    words = set(tokens_of(name))
    is_told = any(KIND.get(word) in ("commanded", "model") for word in words)
    return bool(words & _BASES and words & _MOTIONS) and not words & (_OTHERS | _ENDS) and not is_told


def _spans(table: LogTable, names: Sequence[str]) -> list[float]:
    """Return how far columns go, outliers left out; of quaternions, which turn their sign, by size."""
    try:
        values = next(table.batches(names, _ROWS), np.zeros((1, len(names))))
    except LogFormatError:
        return [0.0] * len(names)
    values = np.array(values[np.isfinite(values).all(axis=1)]).reshape(-1, len(names))
    for k, name in enumerate(names):
        if {"quat", "quaternion", "orientation", "qx", "qy", "qz", "qw"} & set(tokens_of(name)):
            values[:, k] = np.abs(values[:, k])
    low, high = np.quantile(values, _OUTLIERS, axis=0) if len(values) else np.zeros((2, len(names)))
    return (high - low).tolist()
