"""Logs of the motors' side: gears, couplings and zeros, on a made robot and on the published log of the TX40."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dynident.case.case import read_case
from dynident.data.formats import write_log
from dynident.data.log import Log
from dynident.data.motor_side import joint_side
from dynident.errors import LogMismatch
from dynident.model.joint import Drive
from dynident.model.robot import Robot
from dynident.robot_files import read_robot
from real_data import real

RATIOS = (100.0, -80.0)
COUPLING = np.array([[1.0, 0.0], [0.5, 1.0]])
URDF = """<robot name="two"><link name="base"/>
<link name="a"><inertial><mass value="2"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
<link name="b"><inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
<joint name="one" type="revolute"><parent link="base"/><child link="a"/><axis xyz="0 0 1"/>
<limit lower="-3" upper="3" velocity="3" effort="200"/></joint>
<joint name="two" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 1 0"/>
<limit lower="-3" upper="3" velocity="3" effort="200"/></joint></robot>
"""


@pytest.fixture
def robot(tmp_path: Path) -> Robot:
    (tmp_path / "robot.urdf").write_text(URDF)
    plain = read_robot(tmp_path / "robot.urdf")
    drives = {name: Drive(gear_ratio=ratio) for name, ratio in zip(plain.joint_names, RATIOS, strict=True)}
    return plain.with_drives(drives, COUPLING)


def logs(seed: int = 0) -> tuple[Log, Log]:
    """Return a log of the joints, and the same of the motors: q_m = N C q, and power is the same on both sides."""
    generator = np.random.default_rng(seed)
    q, dq, motor_torque = generator.normal(size=(3, 50, 2))
    time = 0.01 * np.arange(50)
    gears = np.diag(RATIOS) @ COUPLING
    at_motors = Log(("one", "two"), time, q @ gears.T, dq @ gears.T, torque=motor_torque)
    power = np.sum(motor_torque * (dq @ gears.T), axis=1)
    torque = motor_torque @ gears
    np.testing.assert_allclose(np.sum(torque * dq, axis=1), power)
    return Log(("one", "two"), time, q, dq, torque=torque), at_motors


def test_motion_and_torque_come_to_the_joints(robot: Robot) -> None:
    true, at_motors = logs()
    found = joint_side(at_motors, robot, ("q", "dq", "torque"))
    for name in ("q", "dq", "torque"):
        np.testing.assert_allclose(getattr(found, name), getattr(true, name), rtol=1e-12)
    assert found.source.steps == ("q, dq, torque from the motors to the joints",)
    np.testing.assert_array_equal(joint_side(at_motors, robot, ("torque",)).q, at_motors.q)


def test_a_robot_without_gears_and_logs_of_other_joints_are_refused(robot: Robot) -> None:
    _, at_motors = logs()
    with pytest.raises(LogMismatch, match="without gears and couplings; state gear_ratio under drives"):
        joint_side(at_motors, robot.with_drives({n: Drive() for n in robot.joint_names}, np.eye(2)), ("q",))
    with pytest.raises(LogMismatch, match="order it as the robot's joints"):
        joint_side(replace(at_motors, joints=("two", "one")), robot, ("q",))


def test_a_case_of_the_motors_side_with_joints_in_another_order(robot: Robot, tmp_path: Path) -> None:
    true, at_motors = logs()
    write_log(at_motors.ordered(("two", "one")), tmp_path / "run.csv")
    (tmp_path / "case.yaml").write_text(
        "case: 1\nrobot: robot.urdf\njoints: [two, one]\ncoupling: [[1, 0], [0.5, 1]]\n"
        "drives: {one: {gear_ratio: 100}, two: {gear_ratio: -80}}\nlog: {side: motor, zero: [0.25, -1]}\n"
    )
    found = read_case(tmp_path / "case.yaml").read("run.csv")
    assert found.joints == ("one", "two")
    np.testing.assert_allclose(found.q, true.q + np.array([-1.0, 0.25]))
    np.testing.assert_allclose(found.torque, true.torque, rtol=1e-12)  # type: ignore[arg-type]


def test_a_locked_joint_in_a_log_of_the_motors_side_is_refused(robot: Robot, tmp_path: Path) -> None:
    write_log(logs()[1], tmp_path / "run.csv")
    (tmp_path / "case.yaml").write_text(
        "case: 1\nrobot: robot.urdf\nlocked: {two: 0}\ndrives: {one: {gear_ratio: 100}}\nlog: {side: motor}\n"
    )
    with pytest.raises(LogMismatch, match="two is locked, and a log of the motors' side has it"):
        read_case(tmp_path / "case.yaml").read("run.csv")


def test_the_motors_of_the_tx40_give_its_joint_side_log(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """FIGAROH's joint-side log of the TX40 is what its own maps make of the log of the motors, every fifth row."""
    logs = real("staubli_tx40_figaroh", monkeypatch)
    names = read_robot(logs / "robot.urdf").joint_names
    drives = ", ".join(f"{name}: {{gear_ratio: {n}}}" for name, n in zip(names, (32, 32, 45, -48, 45, 32), strict=True))
    path = tmp_path / "case.yaml"
    path.write_text(
        f"case: 1\nrobot: {logs / 'robot.urdf'}\ndrives: {{{drives}}}\n"
        "coupling: [[1,0,0,0,0,0],[0,1,0,0,0,0],[0,0,1,0,0,0],[0,0,0,1,0,0],[0,0,0,0,1,0],[0,0,0,0,1,1]]\n"
        "log: {side: motor, columns: {q: 'qm{}', torque: 'taum{}'}, zero: [0, -pi/2, pi/2, 0, 0, 0]}\n"
    )
    found = read_case(path).read(logs / "motor_side_1kHz.csv")
    true = read_case(logs / "robot.urdf").read(logs / "trajectory.csv").rows(slice(None, None, 5), "every fifth row")
    np.testing.assert_allclose(found.time, true.time, atol=1e-6)
    np.testing.assert_allclose(found.q, true.q, atol=2e-6)
    scale = np.abs(np.asarray(true.torque)).max()
    np.testing.assert_allclose(found.torque, true.torque, atol=1e-6 * scale)  # type: ignore[arg-type]
