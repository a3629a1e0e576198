"""The roll-out of a whole arm: all joints together under their commands, with the dynamics of the whole arm."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from dynident.actuators.drive_law import DriveLaw
from dynident.actuators.joint_load import carrying, loop_samples, rigid_inertia
from dynident.actuators.parameters import COUNT, PLACE
from dynident.actuators.rollout import STEP
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
