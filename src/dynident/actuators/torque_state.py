"""Logs whose column of the torque state is inverted, and logs whose drive is at its limit throughout."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from dynident.actuators.directions import LogTorques, Turned, likeliest
from dynident.actuators.drive_law import DriveLaw
from dynident.actuators.joint_load import carrying, measured_motion
from dynident.actuators.linear_start import OFF_S, REST
from dynident.actuators.servo_log import MOVED, ServoLog
from dynident.actuators.torque_rows import (
    LESS,
    LIMITED_WORDS,
    ODDS,
    STATE,
    bodies_torques,
    joint_rows,
    limited_throughout,
)
from dynident.errors import LogMismatch
from dynident.model.robot import Robot


def check_saturation(robot: Robot, laws: Sequence[DriveLaw], logs: Sequence[ServoLog]) -> None:
    """Refuse logs in all of which a drive of an unknown gain is at its limit.

    Args:
        robot: With inertias, in SI units.
        laws: Drive law of each joint.
        logs: Logs of its joints.

    Raises:
        LogMismatch: The torque of joints has one size, whatever the position error.
        NotConsistent: The robot model has no inertias.
    """
    joints = ", ".join(robot.joint_names[joint] for joint in limited_throughout(robot, laws, logs))
    if joints:
        raise LogMismatch(", ".join(log.name for log in logs[:4]), f"the drive of {joints} is {LIMITED_WORDS}", LESS)


def check_torque_state(robot: Robot, log: ServoLog) -> None:
    """Refuse a log whose column of the torque state is inverted for a joint.

    Friction, armature and a drive explain the torque of the bodies in motion, once with the column as it is and once
    with it turned over. The drive gives any torque that grows with the position error, of a goal that may be limited in
    speed: no law and no gain is needed.
    The column is inverted where that is far more likely by Schwarz's criterion (Annals of Statistics 6, 1978), unless
    a joint that runs the other way explains the torques of the whole arm still better.

    Args:
        robot: With inertias, in SI units.
        log: A log of its joints.

    Raises:
        LogMismatch: The column turned over, or a joint, explains the motion, and the log as it is does not.
        NotConsistent: The robot model has no inertias.
    """
    switched = np.flatnonzero((log.enabled != log.enabled[0]).any(axis=0))
    if not len(switched):
        return
    motion = measured_motion(log)
    target = bodies_torques(carrying(robot, log), motion)[0]
    held = np.clip(np.searchsorted(log.time, motion.time, side="right") - 1, 0, None)
    for joint in switched.tolist():
        rows, on = joint_rows(log, joint, motion, has_weight=True), log.enabled[held, joint]
        rest, moved = (log.sized(joint, size) for size in (REST, MOVED))
        seconds = float(motion.time[1] - motion.time[0]) * (np.abs(motion.dq[:, joint]) > rest)
        is_tried = seconds[on].sum() > OFF_S or np.ptp(log.q_ref[log.enabled[:, joint], joint]) > moved
        if rows is None or not is_tried or seconds[~on].sum() <= OFF_S:
            continue
        as_is, turned = (float(np.linalg.norm(rows.left(kind, target[:, joint]))) for kind in ("", STATE))
        least = math.log(ODDS) + 0.5 * rows.drive(STATE, 0).shape[1] * math.log(rows.count)
        if rows.count * math.log(as_is / max(turned, float(np.finfo(float).tiny))) > least:
            found = likeliest([LogTorques.of(robot, log)], is_switched=True)
            found = found or Turned(STATE, joint, 0.0, True, turned / as_is)
            raise LogMismatch(log.name, *found.told(log.joints))
