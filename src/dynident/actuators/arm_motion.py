"""The motion of an arm by the roll-outs of all its joints, and the loads that follow from it.

Each joint is rolled out along the motion of the others, found before: waveform relaxation (Lelarasmee, Ruehli and
Sangiovanni-Vincentelli 1982). Logged positions are coarse in time and in angle and count from the encoder's zero; the
load of a joint wants accelerations, and the angles that the robot model means. A roll-out of the whole arm has all
joints together under their commands, with the dynamics of the whole arm.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

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
    loop_samples,
    measured_loads,
    measured_motion,
    motion_at,
    rigid_inertia,
)
from dynident.actuators.parameters import COUNT, PLACE
from dynident.actuators.rollout import STEP, JointRecord, encoder_step, record_of, rolled_out
from dynident.actuators.rollout_loop import (
    ACTIVE,
    ENTRIES,
    LOADS,
    ON,
    ROWS,
    WIDE,
    added_duty,
    begin_joint,
    follow,
    middle_speed,
    pieces,
    push,
)
from dynident.actuators.servo_log import ServoLog
from dynident.arrays import Array
from dynident.model.kernels.generic import WORK, bias_torque, pack, placed_mass
from dynident.model.kernels.jit import compiled
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


_OFFSET, _DELAY = PLACE["angle_offset"], PLACE["delay"]

#: Passes over the joints in a step at most, and the change of a velocity in rad/s at which they agree.
_PASSES, _AGREED = 100, 1e-11


@compiled
def _roll_out_arm(
    p: Array, samples: Array, laws: Array, start: Array, longest: float, chain: Any, theta: Array, out: Array
) -> None:
    """Integrate all joints from the first sample, each step as that of one joint (``roll_out``).

    In the middle of a step the load of a joint is that of mass matrix and bias torque of the whole arm there, with the
    accelerations of the other joints over the step: one joint after the other until all agree (Gauss-Seidel, which
    converges as the mass matrix is positive definite and friction opposes the motion).

    Args:
        p: Parameters of each joint, shape (n, COUNT).
        samples: Of each joint, shape (n, N, COLUMNS).
        laws: Numbers of each drive law, shape (n, 4).
        start: Positions and velocities at the first sample, shape (2, n).
        longest: Longest step in s.
        chain: Tables of ``pack``.
        theta: Inertial parameters, shape (10 l,).
        out: Positions at the samples, shape (N, n); written.
    """
    joints, count, time, (links, reals, gravity) = len(p), samples.shape[1], samples[0, :, 0], chain
    q, v, before, middle, angle = start[0].copy(), start[1].copy(), np.zeros(joints), np.zeros(joints), np.zeros(joints)
    rate, bias, mass, load = np.zeros(joints), np.zeros(joints), np.zeros((joints, joints)), np.zeros(LOADS)
    now, slopes, work = np.zeros((joints, ENTRIES)), np.zeros((ROWS, 1)), np.empty((len(links) + 1, WORK))
    place, wide, at = np.zeros(joints, np.int64), np.zeros(joints), np.full(COUNT + 2, -1)
    for j in range(joints):
        wide[j] = WIDE * (samples[j, :, 1].max() - samples[j, :, 1].min())
        begin_joint(p[j], samples[j], v[j], now[j], at)
    for i in range(count):
        out[i] = q
        if i + 1 == count:
            break
        steps, most = max(1, math.ceil((time[i + 1] - time[i]) / longest - 1e-9)), 1
        for j in range(joints):
            most = max(most, pieces(samples[j], time[i + 1] - p[j, _DELAY], place[j], wide[j]))
        steps *= most
        h = (time[i + 1] - time[i]) / steps
        for step in range(steps):
            for j in range(joints):
                begin = time[i] + step * h - p[j, _DELAY]
                now[j, ON], now[j, ACTIVE] = samples[j, i, 4], samples[j, i, 4] * samples[j, i, 5]
                place[j] = follow(p[j], samples[j], begin, h, place[j], slopes[6:8], now[j], at)
                added_duty(p[j], samples[j], begin, h, place[j], now[j])
                before[j], middle[j] = v[j], middle_speed(h, v[j], now[j], slopes)
                q[j] += 0.5 * h * v[j]
                angle[j] = q[j] + p[j, _OFFSET]
            bias_torque(links, reals, gravity, theta, angle, middle, bias, work)
            placed_mass(links, reals, theta, mass, work)
            for _ in range(_PASSES):
                change = 0.0
                for j in range(joints):
                    load[0], load[1] = mass[j, j], bias[j]
                    for k in range(joints):
                        load[1] += mass[j, k] * rate[k] if k != j else 0.0
                    new = push(p[j], h, q[j], before[j], middle[j], load, laws[j], now[j])[0]
                    change, v[j], rate[j] = max(change, abs(new - v[j])), new, (new - before[j]) / h
                if change < _AGREED:
                    break
            for j in range(joints):
                q[j] += 0.5 * h * v[j]


def arm_rolled_out(
    robot: Robot, log: ServoLog, laws: Sequence[DriveLaw], parameters: Sequence[Array], start: Array
) -> Array:
    """Return the readings of all joints of an arm at the samples of a log, shape (N, n), in rad or m.

    Its commands are the only input: no joint is on its measured motion.

    Args:
        robot: Of n joints.
        log: The log.
        laws: Drive law of each joint.
        parameters: Of each joint, shape (COUNT,).
        start: Readings and velocities at the first sample, shape (2, n).
    """
    own, out = carrying(robot, log), np.empty(log.q.shape)
    samples = np.stack([loop_samples(log, joint) for joint in range(robot.dof)])
    numbers, values = np.stack([law.numbers(log.kp) for law in laws]), np.stack(list(parameters))
    _roll_out_arm(values, samples, numbers, start, STEP, pack(own.chain), rigid_inertia(own), out)
    return out
