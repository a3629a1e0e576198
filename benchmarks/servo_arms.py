"""Virtual arms of several joints whose servos are known: an integrator of its own.

The time stepping of Moreau with the mass matrix of the whole arm: damping by the trapezoidal rule, dry friction of all
joints together by projected Gauss-Seidel, positions, Coriolis torques and Stribeck friction at the middle of the step,
no jump of a command within one. With a tenth of the step positions differ by less than 0.01 mrad (root mean square),
with friction that grows with the load by less than 0.02. Nothing of dynident's roll-outs is in it; mass matrix and bias
torque are dynident's kernels, compared with Pinocchio for every arm that is drawn.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numba
import numpy as np
import pinocchio as pin  # pyright: ignore[reportMissingImports]

from dynident.actuators.drive_law import DriveLaw
from dynident.actuators.parameters import PLACE, neutral
from dynident.actuators.servo_log import ServoLog
from dynident.arrays import Array, BoolArray, IntArray
from dynident.model.kernels.generic import WORK, bias_torque, pack, placed_mass
from dynident.model.kernels.jit import compiled
from dynident.model.robot import Robot
from dynident.robot_files import read_robot

#: Step of the integration in s.
STEP = 5e-5

#: Least step in s.
_APART = 1e-12

#: Passes of the friction's projected Gauss-Seidel over the joints.
_PASSES = 30

#: Change of the velocities in rad/s in one pass at which they agree.
_AGREE = 1e-12

#: Parameters of a drive that the loop takes.
_COLUMNS = (
    "full_torque",
    "back_emf",
    "viscous",
    "coulomb",
    "armature",
    "angle_offset",
    "slew_limit",
    "coulomb_stribeck",
    "stribeck_velocity",
    "load_motor",
)

#: Axes of the joints from the base on: a turning base, shoulder, elbow and wrist in one plane, two wrist joints.
_AXES = ("0 0 1", "0 1 0", "0 1 0", "0 1 0", "1 0 0", "0 1 0")

_LINK = """<link name="l{k}"><inertial><origin xyz="0 {y} {z}"/><mass value="{mass}"/>
<inertia ixx="{ixx}" ixy="0" ixz="0" iyy="{ixx}" iyz="0" izz="{izz}"/></inertial></link>
<joint name="joint{k}" type="revolute"><parent link="l{before}"/><child link="l{k}"/><origin xyz="0 0 {up}"/>
<axis xyz="{axis}"/><limit lower="-3.2" upper="3.2" effort="50" velocity="30"/></joint>"""


@dataclass(frozen=True)
class VirtualArm:
    """An arm with its true servos.

    Attributes:
        robot: As dynident reads it.
        file: Its URDF.
        law: Drive law of all joints.
        true: True parameters, shape (n, COUNT).
    """

    robot: Robot
    file: Path
    law: DriveLaw
    true: Array


def drawn_arm(random: np.random.Generator, joints: int, law: DriveLaw, folder: Path) -> VirtualArm:
    """Return a drawn arm of desk size, with a servo for each joint."""
    parts, up, before = ['<link name="l0"/>'], 0.05, 0
    for k, axis in enumerate(_AXES[:joints], start=1):
        length = float(random.uniform(0.06, 0.14)) if k > 1 else 0.06
        mass = float(random.uniform(0.8, 1.2)) * 0.35 * 0.8**k
        own = mass * length**2 / 12.0 + 1e-5
        parts.append(
            _LINK.format(
                k=k, before=before, axis=axis, up=up, mass=mass, z=0.6 * length, y=0.1 * length, ixx=own, izz=0.4 * own
            )
        )
        up, before = length, k
    file = folder / f"arm{joints}.urdf"
    file.write_text(f'<robot name="arm{joints}">{"".join(parts)}</robot>')
    model = pin.buildModelFromUrdf(str(file))
    data = model.createData()
    poses = random.uniform(-1.5, 1.5, (200, joints))
    weight = np.max([np.abs(pin.computeGeneralizedGravity(model, data, q)) for q in poses], axis=0)
    inertia = np.mean([np.diag(pin.crba(model, data, q)) for q in poses], axis=0)
    true = np.array([neutral()] * joints)
    for k in range(joints):
        torque = max(weight[k], 0.3 * weight.max() * 0.6**k, 30.0 * inertia[k]) * random.uniform(2.5, 5.0)
        fastest = random.uniform(4.0, 8.0)
        values = {
            "full_torque": torque,
            "back_emf": 0.8 * torque / fastest,
            "viscous": 0.2 * torque / fastest,
            "coulomb": torque * random.uniform(0.01, 0.04),
            "armature": inertia[k] * random.uniform(0.2, 1.5) + 1e-4,
            "angle_offset": random.uniform(-0.03, 0.03) if k else 0.0,
            "delay": random.uniform(0.002, 0.020),
        }
        for name, value in values.items():
            true[k, PLACE[name]] = value
    robot = read_robot(str(file))
    _compare(robot, model, poses)
    return VirtualArm(robot, file, law, true)


def _compare(robot: Robot, model: pin.Model, poses: Array) -> None:
    """Stop where mass matrix or bias torque of an arm differ from Pinocchio's at some poses, shape (N, n)."""
    data, tables, theta = model.createData(), pack(robot.chain), np.asarray(robot.nominal)
    n = robot.dof
    bias, mass, work = np.zeros(n), np.zeros((n, n)), np.empty((len(tables[0]) + 1, WORK))
    bias_of, mass_of = compiled(bias_torque.py_func), compiled(placed_mass.py_func)  # pyright: ignore
    for q, v in zip(poses[:20], 3.0 * poses[20:40], strict=True):
        bias_of(*tables, theta, q, v, bias, work)
        mass_of(tables[0], tables[1], theta, mass, work)
        other = np.triu(pin.crba(model, data, q))
        np.testing.assert_allclose(bias, pin.nonLinearEffects(model, data, q, v), atol=1e-12)
        np.testing.assert_allclose(np.triu(mass), other, atol=1e-12)


@numba.njit(cache=True)
def _held(matrix: Array, momentum: Array, most: Array, v: Array, impulse: Array) -> None:
    """Write the velocity after a step, shape (n,), with impulses of dry friction of at most ``most`` (n,)."""
    n = len(v)
    for _ in range(_PASSES):
        moved = 0.0
        for i in range(n):
            rest = momentum[i]
            for j in range(n):
                if j != i:
                    rest -= matrix[i, j] * v[j]
            impulse[i] = min(max(rest, -most[i]), most[i])
            now = (rest - impulse[i]) / matrix[i, i]
            moved, v[i] = max(moved, abs(now - v[i])), now
        if moved < _AGREE:
            break


@numba.njit(cache=True)
def _integrated(
    body: tuple[IntArray, Array, Array, Array], columns: Array, law: Array, commands: Array, steps: Array, on: Array,
    q: Array, held: IntArray, seen: Array,
) -> None:  # fmt: skip
    """Write the positions at the samples, shape (N, n).

    Args:
        body: Tables of the chain, gravity and inertial parameters.
        columns: Parameters of the drives by _COLUMNS, shape (len(_COLUMNS), n).
        law: Duty per rad of error and its limit.
        commands: Delayed command in each step, shape (steps, n), in rad; it jumps between two.
        steps: Length of each step in s, shape (steps,).
        on: 1 where each drive is on, shape (N, n).
        q: Positions at first, shape (n,), in rad.
        held: Sample that each step follows, shape (steps,).
        seen: Written.
    """
    links, reals, gravity, theta = body
    torque, emf, viscous, coulomb, armature, offset, slew, stribeck, fade, load = columns
    n, goal, v, impulse = len(q), q.copy(), np.zeros(len(q)), np.zeros(len(q))
    bias, mass, work = np.zeros(n), np.zeros((n, n)), np.empty((len(links) + 1, WORK))
    momentum, most, sample = np.zeros(n), np.zeros(n), -1
    aim, before, middle, last = np.zeros(n), np.zeros(n), np.zeros(n), steps[0]
    rate, pull = np.zeros(n), np.zeros(n)
    for k in range(len(steps)):
        if held[k] != sample:
            sample = held[k]
            seen[sample] = q
        h, is_on = steps[k], on[sample]  # by joint
        for i in range(n):
            most_moved = slew[i] * h
            moved = min(max(commands[k, i] - goal[i], -most_moved), most_moved)
            aim[i] = goal[i] + (0.5 * moved if abs(moved) == most_moved else moved)
            goal[i] += moved
            q[i] += 0.5 * h * v[i]
            middle[i] = v[i] + 0.5 * h / last * (v[i] - before[i])  # on the line through this and the step before
            before[i] = v[i]
        last = h
        bias_torque(links, reals, gravity, theta, q + offset, middle, bias, work)
        placed_mass(links, reals, theta, mass, work)
        for i in range(n):
            mass[i, i] += armature[i]
        for i in range(n):
            duty = min(max(law[0] * (aim[i] - q[i]), -law[1]), law[1])
            damping = viscous[i] + is_on[i] * emf[i]
            momentum[i] = h * (is_on[i] * torque[i] * duty - bias[i] - 0.5 * damping * v[i])
            pull[i] = is_on[i] * (torque[i] * duty - emf[i] * middle[i]) + bias[i]  # motor less external torque
            for j in range(n):
                momentum[i] += mass[i, j] * v[j]
                if j != i:  # the others accelerate as in the step before
                    pull[i] += mass[i, j] * rate[j]
            friction = coulomb[i] + load[i] * abs(pull[i]) + stribeck[i] * math.exp(-abs(middle[i]) / fade[i])
            most[i] = h * friction
        for i in range(n):
            mass[i, i] += 0.5 * h * (viscous[i] + is_on[i] * emf[i])
        _held(mass, momentum, most, v, impulse)
        for i in range(n):
            q[i] += 0.5 * h * v[i]
            rate[i] = (v[i] - before[i]) / h
    seen[len(seen) - 1] = q


def arm_log(
    arm: VirtualArm, time: Array, command: Array, kp: float, enabled: BoolArray, step: float = STEP, counts: int = 4096
) -> ServoLog:
    """Return the log of an arm that follows commands (N, n); drives are on where ``enabled``, (N,) or (N, n)."""
    count, n = command.shape
    enabled = np.broadcast_to(enabled.reshape(count, -1), (count, n)).copy()
    pieces = max(1, math.ceil(float(np.diff(time).max()) / step - 1e-9))
    parts = np.interp(np.arange((count - 1) * pieces + 1) / pieces, np.arange(count), time)
    delays = arm.true[:, PLACE["delay"]]
    cuts = np.unique(np.concatenate([parts, *(time + delay for delay in delays)]))  # no command jumps within a step
    cuts = cuts[(cuts <= time[-1]) & (np.diff(cuts, prepend=-np.inf) > _APART)]
    steps, middles = np.diff(cuts), 0.5 * (cuts[1:] + cuts[:-1])
    held = np.searchsorted(time, middles) - 1
    given = np.maximum(np.searchsorted(time, middles[:, None] - delays) - 1, 0)
    commands = np.take_along_axis(command, given, axis=0)
    columns = np.array([arm.true[:, PLACE[name]] for name in _COLUMNS])
    law, seen = np.array(arm.law.numbers(kp)[:2]), np.empty((count, n))
    body = (*pack(arm.robot.chain), np.asarray(arm.robot.nominal))
    _integrated(body, columns, law, commands, steps, enabled.astype(float), command[0].copy(), held, seen)
    size = 2.0 * np.pi / counts
    return ServoLog(
        name=f"kp{kp:g}",
        joints=arm.robot.joint_names,
        time=time,
        q=np.round(seen / size) * size,
        q_ref=command,
        dq_ref=np.zeros_like(command),
        added=np.zeros_like(command),
        enabled=enabled,
        supply=np.ones(count),
        failed=np.zeros((count, n), dtype=bool),
        kp=kp,
    )


def arm_logs(
    arm: VirtualArm, rate: float, gains: tuple[float, ...], seconds: float = 6.0, is_on: bool = False
) -> list[ServoLog]:
    """Return logs of chirps, steps and a lift with a free swing, or held, at some gains, all joints at once."""
    n = arm.robot.dof
    phase = np.linspace(0.0, 1.0, n)
    lifts = np.where(phase == 0.0, 0.3, 0.7 / np.maximum(n - 1, 1))
    found = []
    for kp in gains:
        for name, time, command, on in _motions(phase, lifts, rate, seconds):
            log = arm_log(arm, time, command, kp, on | is_on)
            found.append(replace(log, name=f"{name} kp{kp:g}"))
    return found


def single_logs(arm: VirtualArm, rate: float, poses: Mapping[float, Array], seconds: float = 6.0) -> list[ServoLog]:
    """Return the same motions of one joint after the other, the others held at a pose, (n,) in rad, of each gain."""
    n = arm.robot.dof
    found = []
    for kp, pose in poses.items():
        for joint, phase in enumerate(np.linspace(0.0, 1.0, n)):
            moves = np.arange(n) == joint
            for name, time, command, is_on in _motions(np.array([phase]), np.array([0.7]), rate, seconds):
                log = arm_log(arm, time, pose + command * moves, kp, is_on[:, None] | ~moves)
                found.append(replace(log, name=f"{name} joint{joint + 1} kp{kp:g}"))
    return found


def _motions(phase: Array, lifts: Array, rate: float, seconds: float) -> list[tuple[str, Array, Array, BoolArray]]:
    """Return name, time, commands (N, n) and where the drives are on (N,) of each motion.

    Args:
        phase: What tells the motions of the joints apart, shape (n,).
        lifts: Speed of the lift before the free swing, shape (n,), in rad/s.
        rate: In Hz.
        seconds: Length.
    """
    time = np.arange(0.0, seconds, 1.0 / rate)
    on = np.ones(len(time), dtype=bool)
    chirp = 0.5 * np.sin(2 * np.pi * ((0.3 + 0.1 * phase) + 0.15 * time[:, None]) * time[:, None])
    beat = 0.4 + 0.13 * phase
    steps = 0.6 * np.sign(np.sin(2 * np.pi * beat * time[:, None])) * np.minimum(time[:, None] / 0.5, 1.0)
    lift = np.outer(np.clip(time, 0.0, 1.5), lifts)
    return [("chirp", time, chirp, on), ("steps", time, steps, on), ("drop", time, lift, time < 2.0)]
