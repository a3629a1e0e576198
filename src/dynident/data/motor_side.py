"""Logs that were taken at the motors, turned to the joints through gears and couplings."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import numpy as np

from dynident.arrays import Array
from dynident.data.log import Log
from dynident.errors import LogMismatch
from dynident.model.robot import Robot

_MOTION = ("q", "dq", "ddq", "q_ref", "dq_ref")


def gears_of(robot: Robot) -> Array:
    """Return N C, shape (n, n), with N the gear ratios and C the coupling: motors turn by N C q."""
    return np.diag([joint.drive.gear_ratio for joint in robot.active]) @ np.asarray(robot.coupling)


def joint_side(log: Log, robot: Robot, signals: Collection[str]) -> Log:
    """Return the log with some of its signals turned from the motors to the joints.

    Power is the same on both sides of :func:`gears_of`, so q = (N C)^-1 q_motor and tau = (N C)' tau_motor.

    Args:
        log: With the joints of the robot in its order; the columns of a joint are those of its motor.
        robot: With gear ratios and coupling.
        signals: Fields of the log that are on the motors' side: q, dq, ddq, torque, raw_torque, q_ref, dq_ref.

    Raises:
        LogMismatch: The joints are not those of the robot, or it has neither gears nor couplings.
    """
    if log.joints != robot.joint_names:
        raise LogMismatch(log.name, f"it has the joints {', '.join(log.joints)}", "order it as the robot's joints")
    gears = gears_of(robot)
    if np.array_equal(gears, np.eye(robot.dof)):
        step = "state gear_ratio under drives and, where motors move several joints, coupling"
        raise LogMismatch(log.name, "a log of the motors' side, of a robot without gears and couplings", step)
    back = np.linalg.inv(gears).T
    changed = {name: values @ back for name, values in log.signals().items() if name in signals and name in _MOTION}
    torques = {name: values @ gears for name, values in log.signals().items() if name in signals and "torque" in name}
    if not changed and not torques:
        return log
    told = ", ".join([*changed, *torques])
    return replace(log.with_step(f"{told} from the motors to the joints"), **changed, **torques)


def with_zero(log: Log, zero: dict[str, float]) -> Log:
    """Return the log with a position added to those of each joint, in rad or m, by name."""
    shift = np.array([zero.get(name, 0.0) for name in log.joints])
    changed = {name: values + shift for name, values in log.signals().items() if name in ("q", "q_ref")}
    return replace(log.with_step("positions counted from the stated zero"), **changed)
