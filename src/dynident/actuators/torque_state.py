"""Logs whose column of the torque state is inverted: a joint is driven where the column says that its drive is off."""

from __future__ import annotations

import math

import numpy as np
from scipy.optimize import nnls

from dynident.actuators.joint_fit import OFF_S
from dynident.actuators.joint_load import CUTOFF_HZ, MeasuredMotion, between, measured_loads, measured_motion
from dynident.actuators.linear_start import REST
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
    with it turned over. The drive gives any torque that grows with the position error: no law and no gain is needed.
    The column is inverted where that is far more likely by Schwarz's criterion (Annals of Statistics 6, 1978).

    Args:
        robot: With inertias, in SI units.
        log: A log of its joints.

    Raises:
        LogMismatch: The column turned over explains the motion, and the column as it is does not.
        NotConsistent: The robot model has no inertias.
    """
    switched = np.flatnonzero((log.enabled != log.enabled[0]).any(axis=0))
    if not len(switched):
        return
    motion = measured_motion(log)
    loads = measured_loads(robot, log, motion)
    for joint in switched.tolist():
        load, q, ddq = loads[joint], motion.q[:, joint], motion.ddq[:, joint]
        torque = np.interp(motion.time, load.time, load.inertia) * ddq + load.torque(motion.time, q)
        if _is_inverted(log, joint, motion, motion.filtered(torque)):
            evidence = f"{log.joints[joint]} is driven where its drive is off by the column, and not where it is on"
            step = "the column of the torque is inverted: turn it over (1 is on); or the axis of the robot model is"
            raise LogMismatch(log.name, evidence, step)


def _is_inverted(log: ServoLog, joint: int, motion: MeasuredMotion, target: Array) -> bool:
    """Return whether the torque of the bodies, shape (K,), is explained by the column turned over and not as it is."""
    time, q, dq = motion.time, motion.q[:, joint], motion.dq[:, joint]
    now, before = (np.clip(np.searchsorted(log.time, at, side="right") - 1, 0, None) for at in (time, time - _DELAY_S))
    on, moves, step = log.enabled[now, joint], np.abs(dq) > REST, float(time[1] - time[0])
    is_tried = np.sum(moves & on) * step > OFF_S or np.ptp(log.q_ref[log.enabled[:, joint], joint]) > MOVED
    if not is_tried or np.sum(moves & ~on) * step <= OFF_S:
        return False
    error = log.q_ref[before, joint] - between(log.time, log.q[:, [joint]], time)[:, 0]
    drive = [np.clip(error, -bend, bend) for bend in np.quantile(np.abs(error[moves]), _BENDS)]
    drive += [-dq, log.added[before, joint], log.dq_ref[before, joint]]
    weight = [np.ones(len(q)), np.sin(q), np.cos(q)]  # what the zero of the encoder changes
    always = [*weight, *(-one for one in weight), -dq, -np.tanh(dq / REST), -motion.ddq[:, joint]]

    def left(state: Array) -> float:
        columns = motion.filtered(np.array([*always, *(one * state for one in drive)]).T)[moves]
        sizes = np.linalg.norm(columns, axis=0)
        matrix = np.column_stack([columns / np.where(sizes > 0, sizes, 1.0), target[moves]])
        factor = np.asarray(np.linalg.qr(matrix, mode="r"))
        return max(float(nnls(factor[:, :-1], factor[:, -1])[1]), float(np.finfo(float).tiny))

    cutoff = min(CUTOFF_HZ, 0.2 / float(np.median(np.diff(log.time))))
    count = 2.0 * cutoff * step * float(moves.sum())  # values of a filtered signal that are independent
    gain = count * math.log(left(on) / left(~on))
    return gain > math.log(_ODDS) + 0.5 * len(drive) * math.log(count)
