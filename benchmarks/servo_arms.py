"""Virtual arms of several joints whose servos are known: an integrator of its own, by Pinocchio.

The time stepping of Moreau with the mass matrix of the whole arm: damping by the trapezoidal rule, dry friction of all
joints together by projected Gauss-Seidel, the positions at the middle of the step. Nothing of dynident's roll-outs is
in it.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numba
import numpy as np
import pinocchio as pin  # pyright: ignore[reportMissingImports]

from dynident.actuators.drive_law import DriveLaw
from dynident.actuators.parameters import PLACE, neutral
from dynident.actuators.servo_log import ServoLog
from dynident.arrays import Array, BoolArray
from dynident.model.robot import Robot
from dynident.robot_files import read_robot

#: Step of the integration in s.
STEP = 2.5e-4

#: Passes of the friction's projected Gauss-Seidel over the joints.
_PASSES = 30

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
    return VirtualArm(read_robot(str(file)), file, law, true)


@numba.njit(cache=True)
def _held(matrix: Array, momentum: Array, most: Array, v: Array, impulse: Array) -> None:
    """Write the velocity after a step, shape (n,), with impulses of dry friction of at most ``most`` (n,)."""
    n = len(v)
    for _ in range(_PASSES):
        for i in range(n):
            rest = momentum[i]
            for j in range(n):
                if j != i:
                    rest -= matrix[i, j] * v[j]
            impulse[i] = min(max(rest, -most[i]), most[i])
            v[i] = (rest - impulse[i]) / matrix[i, i]


def arm_log(
    arm: VirtualArm, time: Array, command: Array, kp: float, enabled: BoolArray, step: float = STEP, counts: int = 4096
) -> ServoLog:
    """Return the log of an arm that follows commands, each shape (N, n); all drives are on where ``enabled`` (N,)."""
    model = pin.buildModelFromUrdf(str(arm.file))
    data, (count, n) = model.createData(), command.shape
    column = {name: arm.true[:, place] for name, place in PLACE.items()}
    per_error, limit, _, _ = arm.law.numbers(kp)
    q, v, goal = command[0].copy(), np.zeros(n), command[0].copy()
    whole = np.vstack([np.zeros(n), np.cumsum(command[:-1] * np.diff(time)[:, None], axis=0)])  # held between samples
    seen, impulse = np.empty((count, n)), np.zeros(n)
    offset, delay, slew = column["angle_offset"], column["delay"], column["slew_limit"]
    stribeck, fade = column["coulomb_stribeck"], column["stribeck_velocity"]
    for i in range(count):
        seen[i] = q
        if i + 1 == count:
            break
        steps = max(1, int(np.ceil((time[i + 1] - time[i]) / step - 1e-9)))
        h = (time[i + 1] - time[i]) / steps
        on = float(enabled[i])
        for k in range(steps):
            begin = time[i] + k * h - delay
            ends = [[np.interp(t, time, whole[:, j], command[0, j] * (t - time[0])) for j, t in enumerate(at)]
                    for at in (begin, begin + h)]  # fmt: skip
            wanted = (np.array(ends[1]) - ends[0]) / h
            goal = goal + np.clip(wanted - goal, -slew * h, slew * h)
            q = q + 0.5 * h * v
            duty = np.clip(per_error * (goal - q), -limit, limit)
            bias = pin.nonLinearEffects(model, data, q + offset, v)
            mass = np.array(pin.crba(model, data, q + offset))
            mass = np.triu(mass) + np.triu(mass, 1).T + np.diag(column["armature"])
            damping = column["viscous"] + on * column["back_emf"]
            force = on * column["full_torque"] * duty - bias - 0.5 * damping * v
            most = h * (column["coulomb"] + stribeck * np.exp(-np.abs(v) / fade))
            momentum, v = mass @ v + h * force, v.copy()
            _held(mass + np.diag(0.5 * h * damping), momentum, most, v, impulse)
            q = q + 0.5 * h * v
    size = 2.0 * np.pi / counts
    return ServoLog(
        name=f"kp{kp:g}",
        joints=arm.robot.joint_names,
        time=time,
        q=np.round(seen / size) * size,
        q_ref=command,
        dq_ref=np.zeros_like(command),
        added=np.zeros_like(command),
        enabled=np.repeat(enabled[:, None], n, axis=1),
        supply=np.ones(count),
        failed=np.zeros((count, n), dtype=bool),
        kp=kp,
    )


def arm_logs(arm: VirtualArm, rate: float, gains: tuple[float, ...], seconds: float = 6.0) -> list[ServoLog]:
    """Return logs of chirps, steps and a lift with a free swing at some gains, all joints at once."""
    time = np.arange(0.0, seconds, 1.0 / rate)
    n = arm.robot.dof
    phase = np.linspace(0.0, 1.0, n)
    on = np.ones(len(time), dtype=bool)
    chirp = 0.5 * np.sin(2 * np.pi * ((0.3 + 0.1 * phase) + 0.15 * time[:, None]) * time[:, None])
    beat = 0.4 + 0.13 * phase
    steps = 0.6 * np.sign(np.sin(2 * np.pi * beat * time[:, None])) * np.minimum(time[:, None] / 0.5, 1.0)
    lift = np.outer(np.clip(time, 0.0, 1.5), np.where(phase == 0.0, 0.3, 0.7 / np.maximum(n - 1, 1)))
    found = []
    for kp in gains:
        for name, command, is_on in (("chirp", chirp, on), ("steps", steps, on), ("drop", lift, time < 2.0)):
            log = arm_log(arm, time, command, kp, is_on)
            found.append(ServoLog(**{**vars(log), "name": f"{name} kp{kp:g}"}))
    return found
