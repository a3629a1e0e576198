"""Logs whose column of the torque state is inverted: a joint is driven where the column says that its drive is off."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import nnls

from dynident.actuators.joint_fit import OFF_S
from dynident.actuators.joint_load import CUTOFF_HZ, MeasuredMotion, between, measured_loads, measured_motion
from dynident.actuators.linear_start import REST, SLEWS, limited_goal
from dynident.actuators.servo_log import MOVED, ServoLog
from dynident.arrays import Array
from dynident.errors import LogMismatch
from dynident.model.robot import Robot

#: Delay in s of the torques that is assumed: servos have 2 to 20 ms, and the filter lets 10 Hz pass.
_DELAY_S = 0.01

#: Quantiles of the position error at which the torque of a drive may bend: any torque that grows with the error and
#: saturates is close to a sum of these.
_BENDS = (0.1, 0.25, 0.5, 0.75, 1.0)

#: The column turned over has to be this much more likely than the column as it is.
_ODDS = 1e3


def check_torque_state(robot: Robot, log: ServoLog) -> None:
    """Refuse a log whose column of the torque state is inverted for a joint.

    Friction, armature and a drive explain the torque of the bodies in motion, once with the column as it is and once
    with it turned over. The drive gives any torque that grows with the position error, of a goal that may be limited in
    speed: no law and no gain is needed.
    The column is inverted where that is far more likely by Schwarz's criterion (Annals of Statistics 6, 1978), unless
    an axis of the robot model that points the other way explains still more with the column as it is.

    Args:
        robot: With inertias, in SI units.
        log: A log of its joints.

    Raises:
        LogMismatch: The column turned over, or the axis, explains the motion, and the column as it is does not.
        NotConsistent: The robot model has no inertias.
    """
    switched = np.flatnonzero((log.enabled != log.enabled[0]).any(axis=0))
    if not len(switched):
        return
    motion = measured_motion(log)
    target = _torques(robot, log, motion)
    for joint in switched.tolist():
        found = _unexplained(log, joint, motion, motion.filtered(target[:, joint]))
        if found is None or found.gain <= found.least:
            continue
        evidence = f"{log.joints[joint]} is driven where its drive is off by the column, and not where it is on"
        step = "the column of the torque is inverted: turn it over (1 is on); or an axis of the robot model is"
        least = found.turned
        for axis in range(robot.dof):  # its own, or that of another joint, of which its torque is made too
            sides = np.where(np.arange(robot.dof) == axis, -1.0, 1.0)
            other = replace(motion, q=sides * motion.q, dq=sides * motion.dq, ddq=sides * motion.ddq)
            torque = sides[joint] * motion.filtered(_torques(robot, log, other)[:, joint])
            beside = _unexplained(log, joint, motion, torque)
            if beside is not None and beside.as_is < least:
                least = beside.as_is
                evidence = f"{log.joints[joint]} moves against what the robot model says, not against the column"
                step = f"turn over the axis of {log.joints[axis]} in the robot model, or its sign in the log"
        raise LogMismatch(log.name, evidence, step)


def _torques(robot: Robot, log: ServoLog, motion: MeasuredMotion) -> Array:
    """Return the torques of the bodies along a motion of a log, shape (K, n)."""
    loads = measured_loads(robot, log, motion)
    parts = zip(loads, motion.q.T, motion.ddq.T, strict=True)
    return np.column_stack(
        [np.interp(motion.time, one.time, one.inertia) * ddq + one.torque(motion.time, q) for one, q, ddq in parts]
    )


@dataclass(frozen=True)
class _Unexplained:
    """What a drive and friction leave of the torque of the bodies, as norms.

    Attributes:
        as_is: With the column of the torque state as it is.
        turned: With the column turned over.
        gain: Logarithm of how much more likely the column turned over is.
        least: Of that, from which it counts.
    """

    as_is: float
    turned: float
    gain: float
    least: float


def _unexplained(log: ServoLog, joint: int, motion: MeasuredMotion, target: Array) -> _Unexplained | None:
    """Return what is left of the torque of the bodies, shape (K,); None where the joint hardly moves on or off."""
    time, q, dq = motion.time, motion.q[:, joint], motion.dq[:, joint]
    now, before = (np.clip(np.searchsorted(log.time, at, side="right") - 1, 0, None) for at in (time, time - _DELAY_S))
    on, moves, step = log.enabled[now, joint], np.abs(dq) > REST, float(time[1] - time[0])
    is_tried = np.sum(moves & on) * step > OFF_S or np.ptp(log.q_ref[log.enabled[:, joint], joint]) > MOVED
    if not is_tried or np.sum(moves & ~on) * step <= OFF_S:
        return None
    angle, command = between(log.time, log.q[:, [joint]], time)[:, 0], log.q_ref[before, joint]
    drives = []
    for slew in float(np.abs(dq).max()) * np.array(SLEWS):
        error = limited_goal(time, command, slew) - angle
        bends = np.quantile(np.abs(error[moves]), _BENDS)
        own = [np.clip(error, -bend, bend) for bend in bends]
        drives.append(np.array([*own, -dq, log.added[before, joint], log.dq_ref[before, joint]]))
    weight = [np.ones(len(q)), np.sin(q), np.cos(q)]  # what the zero of the encoder changes
    always = [*weight, *(-one for one in weight), -dq, -np.tanh(dq / REST), -motion.ddq[:, joint]]
    always = motion.filtered(np.array(always).T)[moves]

    def left(drive: Array) -> float:
        columns = np.hstack([always, motion.filtered(drive.T)[moves]])
        sizes = np.linalg.norm(columns, axis=0)
        matrix = np.column_stack([columns / np.where(sizes > 0, sizes, 1.0), target[moves]])
        factor = np.asarray(np.linalg.qr(matrix, mode="r"))
        return max(float(nnls(factor[:, :-1], factor[:, -1])[1]), float(np.finfo(float).tiny))

    cutoff = min(CUTOFF_HZ, 0.2 / float(np.median(np.diff(log.time))))
    count = 2.0 * cutoff * step * float(moves.sum())  # values of a filtered signal that are independent
    as_is, turned = (min(left(drive * state) for drive in drives) for state in (on, ~on))
    gain = count * math.log(as_is / turned)
    return _Unexplained(as_is, turned, gain, math.log(_ODDS) + 0.5 * len(drives[0]) * math.log(count))
