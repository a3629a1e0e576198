"""Drafts of logs of an arm whose two fingers are tied: which of them is read, and which torque."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from drafted_logs import moved, named, read, write_log
from dynident.arrays import Array
from dynident.case.case_draft import Draft, draft_case
from dynident.robot_files import read_robot
from two_joint_arm import URDF

FINGER = """  <link name="{0}"><inertial><origin xyz="0 0 0.02"/><mass value="1"/>
    <inertia ixx="1e-4" ixy="0" ixz="0" iyy="1e-4" iyz="0" izz="1e-4"/></inertial></link>
  <joint name="finger_{0}" type="prismatic"><parent link="fore"/><child link="{0}"/><origin xyz="0.3 0 0"/>
    <axis xyz="0 {1} 0.3"/><limit lower="-2" upper="2" velocity="2" effort="200"/>{2}</joint>
"""
RATIO = -0.5
TIE = f'<mimic joint="finger_r" multiplier="{RATIO}" offset="0.01"/>'
ARM = ("shoulder", "elbow")


@pytest.fixture
def arm(tmp_path: Path) -> str:
    path = tmp_path / "arm.urdf"
    fingers = FINGER.format("l", 1, TIE) + FINGER.format("r", -1, "")
    path.write_text(URDF.replace("</robot>", f"{fingers}</robot>"))
    assert read_robot(path).joint_names == (*ARM, "finger_r")
    return str(path)


@pytest.fixture
def motion(arm: str) -> dict[str, Array]:
    """Return the motion of all joints; the drive is at the left finger, the right one has noise of a sensor."""
    found = moved(read_robot(arm), samples=2000, rate=250.0)
    q, torque = found["q"], found["torque"]
    left = q[:, 2:] * RATIO + 0.01
    noise = np.random.default_rng(0).normal(0.0, 1e-3, len(q))
    efforts = np.column_stack([torque[:, :2], torque[:, 2] / RATIO, noise])
    return {"time": found["time"], "q": np.hstack([q[:, :2], left, q[:, 2:]]), "torque": efforts}


def drafted(folder: Path, arm: str, motion: dict[str, Array], q: str, torque: str, swapped: bool = False) -> Draft:
    """Return the draft of a log with columns of the fingers of which letters are given, as positions and as torques."""
    values = motion["torque"][:, [0, 1, 3, 2]] if swapped else motion["torque"]
    whole = {"time": motion["time"], "q": motion["q"], "torque": values}
    names = {key: [f"{one}.{word}" for one in (*ARM, "finger_l", "finger_r")] for key, word in WORDS.items()}
    columns = named(whole, "time", names)
    sides = {"position": q, "effort": torque}
    left_out = {f"finger_{side}.{word}" for word in sides for side in "lr" if side not in sides[word]}
    kept = {name: values for name, values in columns.items() if name not in left_out}
    return draft_case(arm, write_log(folder / "log.csv", kept), folder)


WORDS = {"q": "position", "torque": "effort"}


@pytest.mark.parametrize(
    ("q", "torque", "leads"), [("l", "l", "l"), ("lr", "l", "l"), ("lr", "lr", "l"), ("r", "r", "r"), ("lr", "r", "r")]
)
def test_the_finger_of_the_columns_is_read(
    tmp_path: Path, arm: str, motion: dict[str, Array], q: str, torque: str, leads: str
) -> None:
    draft = drafted(tmp_path, arm, motion, q, torque)
    case = read(draft, tmp_path)
    assert case.robot.joint_names == case.columns.joints == (*ARM, f"finger_{leads}") and not case.locked
    told = [remark for remark in draft.remarks if "moves on its own" in remark]
    assert bool(told) == (leads == "l") and all("the log has the " in remark for remark in told)


def test_the_finger_with_the_drive_stays_and_two_drives_are_told(
    tmp_path: Path, arm: str, motion: dict[str, Array]
) -> None:
    draft = drafted(tmp_path, arm, motion, "lr", "lr", swapped=True)
    assert draft.recognition.joints.names == (*ARM, "finger_r")
    assert not any("moves on its own" in told or "both have" in told for told in draft.remarks)
    both = {**motion, "torque": motion["torque"][:, [0, 1, 2, 2]]}
    draft = drafted(tmp_path, arm, both, "lr", "lr")
    (asked,) = [question.text for question in draft.needed]
    total = "finger_r.effort - 0.5 * finger_l.effort"
    assert "forces of drives of their own" in asked and f"'{total}']" in asked and "finger_r.effort] " not in asked
    answers = {"drives of their own": f"[shoulder.effort, elbow.effort, {total}]"}
    log = read(draft, tmp_path, answers).read(str(tmp_path / "log.csv"))
    np.testing.assert_allclose(np.asarray(log.torque)[:, 2], (1.0 + RATIO) * motion["torque"][:, 2])


@pytest.mark.parametrize("swapped", [False, True])
def test_numbered_columns_of_all_joints_leave_out_the_follower(
    tmp_path: Path, arm: str, motion: dict[str, Array], swapped: bool
) -> None:
    values = motion["torque"][:, [0, 1, 3, 2]] if swapped else motion["torque"]
    names = {"q": [f"qpos{k}" for k in range(1, 5)], "torque": [f"qfrc_actuator{k}" for k in range(1, 5)]}
    log = write_log(tmp_path / "log.csv", named({**motion, "torque": values}, "time", names))
    case = read(draft := draft_case(arm, log, tmp_path), tmp_path)
    assert case.columns.joints == (*ARM, f"finger_{'r' if swapped else 'l'}")
    assert case.columns.q is not None and case.columns.q[-1] == ("qpos4" if swapped else "qpos3")
    assert draft.recognition.joints.certain


def test_forces_of_mujoco_at_both_fingers_are_summed(tmp_path: Path, arm: str, motion: dict[str, Array]) -> None:
    """A tendon over both fingers: by virtual work the joint that leads has the force of each times its ratio."""
    forces = np.column_stack([motion["torque"][:, :3], 0.7 * motion["torque"][:, 2]])
    names = {"q": [f"qpos{k}" for k in range(1, 5)], "torque": [f"qfrc_actuator{k}" for k in range(1, 5)]}
    log = write_log(tmp_path / "log.csv", named({**motion, "torque": forces}, "time", names))
    case = read(draft := draft_case(arm, log, tmp_path), tmp_path)
    assert not draft.needed and "qfrc_actuator4 - 0.5 * qfrc_actuator3" in draft.text and "not read" not in draft.text
    assert case.columns.joints == (*ARM, "finger_r")
    found = case.read(log)
    np.testing.assert_allclose(np.asarray(found.torque)[:, 2], forces[:, 3] + RATIO * forces[:, 2])


def test_numbered_columns_that_do_not_follow_are_asked(tmp_path: Path, arm: str, motion: dict[str, Array]) -> None:
    names = {"q": [f"qpos{k}" for k in range(1, 5)], "torque": [f"tau{k}" for k in range(1, 5)]}
    other = {**motion, "q": motion["q"] * [1.0, 1.0, -1.0, 1.0]}
    draft = draft_case(arm, write_log(tmp_path / "log.csv", named(other, "time", names)), tmp_path)
    assert not draft.recognition.joints.certain
    assert any("joints" in question.text for question in draft.questions)
