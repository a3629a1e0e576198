"""The motion of an arm by the roll-outs of all its joints, and the loads that follow from it.

Each joint is rolled out along the motion of the others, found before: waveform relaxation (Lelarasmee, Ruehli and
Sangiovanni-Vincentelli 1982). Logged positions are coarse in time and in angle and count from the encoder's zero; the
load of a joint wants accelerations, and the angles that the robot model means.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dynident.actuators.drive_law import DriveLaw
from dynident.actuators.joint_load import (
    ArmMotion,
    JointLoad,
    MeasuredMotion,
    between,
    bias_of,
    carrying,
    inertias_of,
    joint_loads,
    load_times,
    measured_loads,
    measured_motion,
    motion_at,
)
from dynident.actuators.parameters import PLACE
from dynident.actuators.rollout import JointRecord, encoder_step, record_of, rolled_out
from dynident.actuators.servo_log import ServoLog
from dynident.arrays import Array
from dynident.model.robot import Robot

#: Passes over the joints in each turn, and where no turn follows.
SWEEPS, ALL_SWEEPS = 2, 4


def relaxed(
    robot: Robot,
    joints: Sequence[tuple[JointRecord, Array, float]],
    measured: MeasuredMotion,
    motion: ArmMotion,
    ends: Array,
    sweeps: int = SWEEPS,
) -> ArmMotion:
    """Return the motion of an arm in one log by the roll-outs of its joints, and what these leave, filtered.

    One joint after the other, each under the load of what is known by then (Gauss-Seidel): as the mass matrix is
    positive definite, the accelerations come to agree however strongly joints are coupled.

    Args:
        robot: Of n joints.
        joints: Each joint in the log, its parameters, shape (COUNT,), and the angle at which its encoder reads zero.
        measured: The measured motion, with its filter.
        motion: What is known of the motion so far.
        ends: Ends of the parts of the load, shape (K + 1,), in s.
        sweeps: Passes over the joints.
    """
    columns = [motion.q.copy(), motion.dq.copy(), motion.ddq.copy()]
    for _ in range(sweeps):
        inertias = inertias_of(robot, ArmMotion(motion.time, *columns))
        for joint, (record, own, zero) in enumerate(joints):
            bias = bias_of(robot, ArmMotion(motion.time, *columns), joint)
            load = JointLoad(motion.time, inertias[:, joint], bias)
            parts = joint_motion(record.under(load), own, measured, ends)
            if np.isfinite(parts[0]).all():
                for column, part, offset in zip(columns, parts, (zero, 0.0, 0.0), strict=True):
                    column[:, joint] = part + offset
    return ArmMotion(motion.time, *columns)


def joint_motion(record: JointRecord, own: Array, measured: MeasuredMotion, ends: Array) -> Sequence[Array]:
    """Return reading, velocity and acceleration of a joint in the parts of its load, each (K,), two steps a part.

    Args:
        record: The joint in the log.
        own: Its parameters, shape (COUNT,).
        measured: With its filter: what the roll-out leaves of the positions is part of the motion.
        ends: Ends of the parts of the load, shape (K + 1,), in s.
    """
    step, time = np.diff(ends), 0.5 * (ends[1:] + ends[:-1])
    model = rolled_out(record.finely(ends), own, longest=0.5 * float(step.max()))
    found = [0.5 * (model.q[1:] + model.q[:-1]), np.diff(model.q) / step, np.diff(model.dq) / step]
    if not np.isfinite(model.q).all():
        return found
    stamps = record.samples[record.read, 0]
    rolled = model.q[:: len(step) // (len(record.q) - 1)]
    left = beyond_noise(record.q - rolled, record)[record.read, None]
    if not left.any():
        return found
    rest = measured.filtered(between(stamps, left, np.clip(measured.time, stamps[0], stamps[-1])))[:, 0]
    speed = np.gradient(rest, measured.time)
    parts = (rest, speed, np.gradient(speed, measured.time))
    return [own + np.interp(time, measured.time, part) for own, part in zip(found, parts, strict=True)]


def beyond_noise(left: Array, record: JointRecord) -> Array:
    """Return what a roll-out leaves of the positions, shape (N,), less the share that noise of the encoder explains.

    A quarter of the squared step, as the reading of a joint that rests is off by one and the same part of half a step
    (a moving one by a twelfth), or the noise that second differences show where that is more: where the model says all,
    its roll-out is the best that is known of the motion, and twice differentiated noise would be part of the load.
    Samples that do not count are those that the model is not for: there the measurement is all that is known.
    """
    used = left[record.used]
    noise = max(encoder_step([record]) ** 2 / 4.0, float(np.mean(np.diff(used, 2) ** 2)) / 6.0)
    share = max(0.0, 1.0 - noise / max(float(np.mean(used**2)), 1e-300))
    return np.where(record.used, share, 1.0) * left


def arm_loads(robot: Robot, log: ServoLog, laws: Sequence[DriveLaw], parameters: Sequence[Array]) -> list[JointLoad]:
    """Return the load of every joint in a log whose drives are known; the measured one of a single joint.

    Args:
        robot: Of n joints.
        log: The log.
        laws: Drive law of each joint.
        parameters: Of each joint, shape (COUNT,).
    """
    measured = measured_motion(log)
    loads = measured_loads(robot, log, measured)
    if robot.dof == 1:
        return loads
    records = [record_of(log, joint, loads[joint], law) for joint, law in enumerate(laws)]
    ends = load_times(log, robot.dof)
    motion = motion_at(measured, ends)
    zeros = [float(own[PLACE["angle_offset"]]) for own in parameters]
    motion = replace(motion, q=motion.q + zeros)
    joints, own = list(zip(records, parameters, zeros, strict=True)), carrying(robot, log)
    return joint_loads(own, relaxed(own, joints, measured, motion, ends, ALL_SWEEPS))
