"""Joints that run the other way are named by the torques of the bodies; right logs are not."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from benchmarks.servo_arms import VirtualArm, arm_logs, drawn_arm
from benchmarks.servo_bodies import disturbed
from servo_bench import CASE_OF_LOGS, PENDULUM, fill, parameters, pendulum, virtual_logs

from dynident.actuators.direction_search import turned_over
from dynident.actuators.directions import AXIS, ORDER, POSITION, LogTorques, Turned, compared
from dynident.actuators.drive_law import preset
from dynident.actuators.identify import identify_actuators
from dynident.actuators.servo_log import ServoColumns, ServoLog, ServoSetup
from dynident.actuators.torque_rows import COMMAND
from dynident.cli.main import main
from dynident.model.robot import Robot
from dynident.results.actuator_text import joint_warnings
from dynident.robot_files import read_robot

LAW = preset("feetech_sts3215")

#: The pendulum of the other tests, its mass to the side at angle 0: from the other side it looks otherwise.
SIDE = PENDULUM.replace('xyz="0 0 -0.15"', 'xyz="0.15 0 0"')


@pytest.fixture(scope="module")
def side(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    path = tmp_path_factory.mktemp("side") / "side.urdf"
    path.write_text(SIDE)
    return read_robot(str(path))


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> VirtualArm:
    return drawn_arm(np.random.default_rng([11, 6, 100]), 6, LAW, tmp_path_factory.mktemp("arm"))


@pytest.fixture(scope="module")
def logs(arm: VirtualArm) -> list[ServoLog]:
    return arm_logs(arm, 50.0, (8.0,), seconds=4.0)


def turned(log: ServoLog, kind: str, joint: int = 0) -> ServoLog:
    """Return a log with the signs of a joint the other way."""
    sides = np.where(np.arange(len(log.joints)) == joint, -1.0, 1.0)
    q, q_ref = (log.q if kind == COMMAND else sides * log.q), (log.q_ref if kind == POSITION else sides * log.q_ref)
    return replace(log, q=q, q_ref=q_ref)


@pytest.mark.parametrize("kind", [AXIS, COMMAND, POSITION])
def test_the_direction_of_a_single_joint_is_named(side: Robot, kind: str) -> None:
    """By a weight that looks otherwise from the other side; turned over, its encoder may read 0 elsewhere as well."""
    logs = virtual_logs(side, parameters())[:3]
    assert turned_over(side, logs) == []
    (found,) = turned_over(side, [turned(log, kind) for log in logs])
    assert (found.kind, found.joint, found.is_zero) == (kind, 0, False) and found.left < 0.3
    assert (found.zero != 0.0) == (kind == AXIS)


def test_what_looks_the_same_from_both_sides_is_not_told(tmp_path: Path) -> None:
    """A weight that hangs at angle 0: the axis makes no difference; commands and positions may each be the ones."""
    robot = pendulum(tmp_path)
    logs = virtual_logs(robot, parameters())[:3]
    assert turned_over(robot, logs) == turned_over(robot, [turned(log, AXIS) for log in logs]) == []
    (found,) = turned_over(robot, [turned(log, COMMAND) for log in logs])
    assert {found.kind, *(kind for kind, _ in found.others)} == {COMMAND, POSITION}
    assert "commands of joint1 in the log; or turn over the sign of the pos" in found.told(("joint1",))[1] or (
        "positions of joint1 in the log; or turn over the sign of the comm" in found.told(("joint1",))[1]
    )


@pytest.mark.parametrize("joint", [0, 2, 5])
def test_the_axis_of_an_arm_is_named(arm: VirtualArm, logs: list[ServoLog], joint: int) -> None:
    """With bodies of the robot model that are 30 % off; as the logs are nothing is said."""
    robot = disturbed(arm.robot, np.random.default_rng(joint))
    assert not turned_over(robot, logs)
    found = turned_over(robot, [turned(log, AXIS, joint) for log in logs])
    (best,) = found  # base and wrist of the same axis explain each other nearly as well
    assert (AXIS, joint) in ((best.kind, best.joint), *best.others)


def test_joints_that_are_exchanged_are_named(arm: VirtualArm, logs: list[ServoLog]) -> None:
    """Not by zeros of their encoders, with bodies of the robot model that are 30 % off."""
    robot, order = disturbed(arm.robot, np.random.default_rng(0)), [0, 4, 2, 3, 1, 5]
    exchanged = [replace(log, q=log.q[:, order], q_ref=log.q_ref[:, order]) for log in logs]
    (found,) = turned_over(robot, exchanged)
    assert (found.kind, found.joint, found.others) == (ORDER, 1, ((ORDER, 4),)) and not found.is_zero
    names = robot.joint_names
    assert found.remark(names).startswith(f"another order: {names[1]} and {names[4]} are exchanged")
    assert "log: columns: q, q_ref" in found.told(names)[1]


def test_a_joint_that_carries_nothing_has_no_direction_of_its_own(tmp_path: Path) -> None:
    """Its torque of the bodies is next to none, and any error of the drive explains that; it follows its commands."""
    robot = pendulum(tmp_path)
    light = replace(robot, gravity=np.zeros(3))
    logs = virtual_logs(light, parameters(armature=0.5))[:3]
    assert turned_over(light, logs) == []


def test_commands_that_a_light_joint_follows_late_are_not_turned_over(tmp_path: Path) -> None:
    """Stamped 0.3 s late they would explain its torque of next to nothing better the other way round."""
    robot = replace(pendulum(tmp_path), gravity=np.zeros(3))
    logs = [
        log
        for k, log in enumerate(virtual_logs(robot, parameters(armature=0.1), gains=(5.0, 6.0, 7.0, 8.0)))
        if k % 3 < 2
    ]
    logs = [replace(log, q_ref=np.roll(log.q_ref, 60, axis=0)) for log in logs]
    parts = [LogTorques.of(robot, log) for log in logs]
    assert compared(COMMAND, 0, parts, parts[0].directions.turned(COMMAND, 0)).is_sure
    assert turned_over(robot, logs) == []


@pytest.mark.parametrize("those", [[(AXIS, 5), (COMMAND, 3)], [(AXIS, 1), (AXIS, 2)]], ids=str)
def test_several_joints_are_named(arm: VirtualArm, logs: list[ServoLog], those: list[tuple[str, int]]) -> None:
    """No one of them explains the logs by itself: each moves the torques of the others."""
    moved = logs
    for kind, joint in those:
        moved = [turned(log, kind, joint) for log in moved]
    assert {(one.kind, one.joint) for one in turned_over(arm.robot, moved)} == set(those)


def test_another_zero_is_told_in_place_of_a_direction(tmp_path: Path) -> None:
    """An encoder that reads nearly half a turn too little; 0.2 rad are made up for by the fit and not told."""
    arm, first = drawn_arm(np.random.default_rng([11, 3, 100]), 3, LAW, tmp_path), np.arange(3) == 1
    logs = arm_logs(arm, 30.0, (8.0,), seconds=4.0)
    for beside in (0.2, 2.9):
        moved = [replace(log, q=log.q - beside * first, q_ref=log.q_ref - beside * first) for log in logs]
        found = turned_over(arm.robot, moved)
        assert [(one.joint, one.is_zero) for one in found] == ([(1, True)] if beside > 1.0 else [])
        assert all(one.zero == pytest.approx(beside, abs=0.15) for one in found)


def test_zeros_of_all_joints_are_told(tmp_path: Path) -> None:
    """Encoders whose counts begin elsewhere; the base's angle moves no weight, and nothing tells it."""
    arm = drawn_arm(np.random.default_rng([11, 3, 100]), 3, LAW, tmp_path)
    logs = arm_logs(arm, 50.0, (8.0,), seconds=4.0)
    found = turned_over(arm.robot, [replace(log, q=log.q - 4.7, q_ref=log.q_ref - 4.7) for log in logs])
    assert {one.joint for one in found} <= {1, 2} and found and all(one.is_zero for one in found)
    assert next(one.zero for one in found if one.joint == 1) == pytest.approx(4.7 - 2.0 * np.pi, abs=0.2)
    assert turned_over(arm.robot, logs) == []


@pytest.mark.parametrize(("kind", "remedy"), [(AXIS, "turn over the axis of joint1"), (COMMAND, "commands of joint1")])
def test_identify_says_the_direction_and_not_what_follows(side: Robot, kind: str, remedy: str) -> None:
    setup = ServoSetup((LAW,), ServoColumns(("joint1",)), "m1")
    logs = virtual_logs(side, parameters())[:2]
    (told,) = joint_warnings(identify_actuators(side, setup, [turned(log, kind) for log in logs]).joints[0])
    assert told.startswith("another direction: joint1") and remedy in told
    assert not any("direction" in text for text in joint_warnings(identify_actuators(side, setup, logs).joints[0]))


def test_check_names_the_direction(side: Robot, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """By all training logs; with the axis turned over in the log there is nothing."""
    fill(tmp_path, side, SIDE, CASE_OF_LOGS.replace("torque: none}", "torque: none}, units: {position: -rad}"))
    assert main(["check", str(tmp_path / "case.yaml"), *map(str, sorted(tmp_path.glob("*.csv")))]) == 1
    text = " ".join(capsys.readouterr().out.split())
    assert "error: direction (joint1): joint1 moves against the axis of the robot model" in text
    assert "its sign in the log (log: {units: {position: -rad}})" in text
    (tmp_path / "case.yaml").write_text(CASE_OF_LOGS)
    assert main(["check", str(tmp_path / "case.yaml"), *map(str, sorted(tmp_path.glob("*.csv")))]) == 0
    assert "error" not in capsys.readouterr().out


def test_another_zero_is_not_told_of_a_joint_whose_roll_outs_follow(
    side: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Torques that lack a part of the friction may fit another zero better; the roll-outs judge."""
    found = Turned(AXIS, 0, 100.0, is_sure=True, left=0.5, zero=2.0, is_zero=True)
    monkeypatch.setattr("dynident.actuators.identify.turned_over", lambda *_: [found])
    setup = ServoSetup((LAW,), ServoColumns(side.joint_names), "m1")
    for zero in (0.0, 2.0):
        logs = [replace(log, q=log.q - zero, q_ref=log.q_ref - zero) for log in virtual_logs(side, parameters())[:3]]
        told = joint_warnings(identify_actuators(side, setup, logs).joints[0])
        assert any(text.startswith("another zero") for text in told) == (zero > 0.0)
