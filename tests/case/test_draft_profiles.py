"""Drafts of logs whose columns a profile knows."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from drafted_logs import joints_called, moved, named, read, write_log, write_robot
from dynident.arrays import Array
from dynident.case.case_draft import draft_case
from dynident.model.friction import FRICTION
from dynident.model.joint import Drive
from dynident.model.robot import Robot
from dynident.robot_files import read_robot

UR = tuple(f"{name}_joint" for name in ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3"))


def columns(motion: dict[str, Array], time: str, **patterns: str) -> dict[str, Array]:
    """Return columns under patterns with {0} for the number from 0 and {joint} for the name of a UR joint."""
    names = {
        signal: [pattern.replace("{0}", str(k)).replace("{joint}", UR[k % 6]) for k in range(motion["q"].shape[1])]
        for signal, pattern in patterns.items()
    }
    return named(motion, time, names)


@pytest.fixture(scope="module")
def ur() -> Robot:
    robot = joints_called(read_robot("generic-6r"), *UR)
    return robot.with_drives(dict.fromkeys(UR, Drive()))


@pytest.fixture(scope="module")
def motion(ur: Robot) -> dict[str, Array]:
    return moved(ur)


def test_a_log_of_the_rtde_client_asks_for_gains_only(ur: Robot, motion: dict[str, Array], tmp_path: Path) -> None:
    table = columns(motion, "timestamp", q="actual_q_{0}", dq="actual_qd_{0}", torque="actual_current_{0}")
    table |= columns(motion, "timestamp", torque="target_moment_{0}", q="target_q_{0}")
    log = write_log(tmp_path / "run.csv", table, separator=" ")
    draft = draft_case(write_robot(tmp_path / "ur.json", ur), log, tmp_path)
    assert len(draft.needed) == 6 and all("the drive gain of" in question.text for question in draft.needed)
    assert "profile: ur_rtde   # the header has 'timestamp' and actual_q_{0}" in draft.text
    case = read(draft, tmp_path, {"the drive gain of": "2.5"})
    read_back = case.read(case.train[0])
    np.testing.assert_allclose(np.asarray(read_back.torque), 2.5 * motion["torque"])
    assert read_back.q_ref is not None


@pytest.mark.parametrize("kind", ["warms", "constant", "absent"])
def test_temperatures_of_a_profile_are_left_to_the_logs_where_they_change(
    kind: str, ur: Robot, motion: dict[str, Array], tmp_path: Path
) -> None:
    table = columns(motion, "timestamp", q="actual_q_{0}", dq="actual_qd_{0}", torque="actual_current_{0}")
    values = 30.0 + motion["time"] * (kind == "warms")
    table |= {} if kind == "absent" else {f"joint_temperatures_{k}": values for k in range(6)}
    draft = draft_case(write_robot(tmp_path / "ur.json", ur), write_log(tmp_path / "run.csv", table), tmp_path)
    case = read(draft, tmp_path, {"the drive gain of": "2.5"})
    parts = [part for part in case.friction if FRICTION.name_of(part) == "temperature"]
    assert len(parts) == (kind == "warms") and all(part.is_optional for part in parts)
    if parts:
        np.testing.assert_allclose(np.asarray(case.read(case.train[0]).temperature)[:, 5], values)


def test_the_effort_of_a_ur_driver_is_asked(ur: Robot, motion: dict[str, Array], tmp_path: Path) -> None:
    table = columns(motion, "t", q="{joint}.position", dq="{joint}.velocity", torque="{joint}.effort")
    arm, log = write_robot(tmp_path / "ur.json", ur), write_log(tmp_path / "run.csv", table)
    draft = draft_case(arm, log, tmp_path)
    (asked,) = [question for question in draft.needed if "the kind of log" in question.text]
    assert "ur_ros2 ({joint}.effort is a current" in asked.text and asked.text.endswith("likely ur_ros2")
    case = read(draft, tmp_path, {"the kind of log": "ur_ros2", "the drive gain of": "3"})
    np.testing.assert_allclose(np.asarray(case.read(case.train[0]).torque), 3 * motion["torque"])
    stated = draft_case(arm, log, tmp_path, profile="joint_states")
    assert stated.needed == () and "drive gain" not in stated.text
    case = read(stated, tmp_path)
    np.testing.assert_allclose(np.asarray(case.read(case.train[0]).torque), motion["torque"])


def test_a_sensor_behind_the_gear_sees_no_rotor(tmp_path: Path) -> None:
    robot = read_robot("generic-7r")
    motion = moved(robot)
    table = columns({**motion, "time": 1e3 * motion["time"]}, "time", q="state.q[{0}]", torque="state.tau_J[{0}]")
    draft = draft_case("generic-7r", write_log(tmp_path / "log.csv", table), tmp_path)
    assert draft.needed == () and "profile: franka" in draft.text and "rotor_inertia" not in draft.text
    case = read(draft, tmp_path)
    assert case.read(case.train[0]).duration == pytest.approx(5.99)


def test_a_data_set_of_positions_asks_for_unit_and_effort(ur: Robot, motion: dict[str, Array], tmp_path: Path) -> None:
    count = range(1, 7)
    names = {"q": [f"observation.state{k}" for k in count], "torque": [f"observation.effort{k}" for k in count]}
    log = write_log(tmp_path / "run.csv", named(motion, "timestamp", names))
    draft = draft_case(write_robot(tmp_path / "ur.json", ur), log, tmp_path)
    effort, unit = draft.needed
    assert effort.text.endswith("likely 'observation.effort{}'") and unit.text.endswith("likely rad")
    case = read(draft, tmp_path, {"measured joint torques": "'observation.effort{}'", "the unit of": "rad"})
    np.testing.assert_allclose(np.asarray(case.read(case.train[0]).torque), motion["torque"])
