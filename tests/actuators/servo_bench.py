"""A virtual pendulum with a servo whose parameters are known, and the motions that it is logged with."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from dynident.actuators.drive_law import DriveLaw, preset
from dynident.actuators.parameters import PLACE, neutral
from dynident.actuators.servo_log import ServoLog
from dynident.actuators.virtual import ServoBench, virtual_log
from dynident.arrays import Array
from dynident.model.robot import Robot
from dynident.robot_files import read_robot

PENDULUM = """<robot name="pendulum"><link name="base"/><link name="arm"><inertial><origin xyz="0 0 -0.15"/>
<mass value="0.8"/><inertia ixx="0.002" ixy="0" ixz="0" iyy="0.002" iyz="0" izz="0.001"/></inertial></link>
<joint name="joint1" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/>
<limit lower="-3.2" upper="3.2" effort="5" velocity="20"/></joint></robot>"""

#: A servo of another size than any of the shared data.
TRUE = {
    "full_torque": 2.4,
    "back_emf": 0.21,
    "viscous": 0.05,
    "coulomb": 0.04,
    "armature": 0.012,
    "angle_offset": 0.02,
    "delay": 0.007,
}


#: A case of its logs, without those to train on.
CASE_OF_LOGS = """case: 2
robot: pendulum.urdf
servo: {law: feetech_sts3215, kp: 'kp{}', enabled: torque_enable, friction: m1}
log: {columns: {time: t, q: [q1], q_ref: [q_ref1], torque: none}}
"""


def pendulum(folder: Path) -> Robot:
    """Return the pendulum, its file in a folder."""
    (folder / "pendulum.urdf").write_text(PENDULUM)
    return read_robot(str(folder / "pendulum.urdf"))


def parameters(**changed: float) -> Array:
    """Return the true parameters with some in place of those of TRUE."""
    found = neutral()
    for name, value in {**TRUE, **changed}.items():
        found[PLACE[name]] = value
    return found


def motions(rate: float = 200.0, seconds: float = 6.0) -> tuple[Array, dict[str, tuple[Array, Array]]]:
    """Return the times, and command and torque-enable of a chirp, steps, and a lift with a free swing."""
    time = np.arange(0.0, seconds, 1.0 / rate)
    chirp = 0.9 * np.sin(2 * np.pi * (0.3 + 0.12 * time) * time)
    steps = 1.1 * np.sign(np.sin(2 * np.pi * 0.4 * time)) * np.minimum(time / 0.5, 1.0)
    lift = np.clip(time, 0.0, 1.5)
    always = np.ones(len(time))
    return time, {"chirp": (chirp, always), "steps": (steps, always), "drop": (lift, (time < 2.0).astype(float))}


def virtual_logs(
    robot: Robot, true: Array, law: DriveLaw | None = None, gains: tuple[float, ...] = (2.0, 6.0), seed: int = 0
) -> list[ServoLog]:
    """Return the logs of all motions at some position gains."""
    bench = ServoBench(robot, law or preset("feetech_sts3215"), jitter_s=5e-4)
    time, each = motions()
    return [
        virtual_log(bench, true, time, command, kp, on > 0.5, seed=100 * seed + 10 * i + j)
        for i, kp in enumerate(gains)
        for j, (command, on) in enumerate(each.values())
    ]


def write_csv(log: ServoLog, path: Path) -> Path:
    """Write a log as the table that a user has."""
    table = np.column_stack([log.time, log.q[:, 0], log.q_ref[:, 0], log.enabled[:, 0]])
    np.savetxt(path, table, "%.9g", ",", header="t,q1,q_ref1,torque_enable", comments="")
    return path


def fill(folder: Path, robot: Robot, urdf: str, case: str) -> None:
    """Write a robot model, a case and a chirp, steps and a drop of the true pendulum into a folder."""
    (folder / "pendulum.urdf").write_text(urdf)
    for name, log in zip(("chirp", "steps", "drop"), virtual_logs(robot, parameters(), gains=(4.0,)), strict=True):
        write_csv(log, folder / f"{name}_kp4.csv")
    (folder / "case.yaml").write_text(case)
