"""Logs of servos are recognised by a word for the command alone, and logs of torques are not taken for them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dynident.case.draft.commands import command_pair
from dynident.cli.main import main

DESK = ("shoulder_pan", "shoulder_lift", "elbow_flex")
MOTORS = (*DESK, "gripper")
NUMBERED = ("joint1", "joint2", "joint3")


def headers(told: str, did: str, names: tuple[str, ...] = DESK) -> list[str]:
    return ["t", *(told.format(name) for name in names), *(did.format(name) for name in names)]


@pytest.mark.parametrize("joints", [DESK, NUMBERED], ids=["named", "numbered"])
@pytest.mark.parametrize(
    ("told", "did"),
    [
        ("action.{}.pos", "observation.state.{}.pos"),
        ("action_{}", "state_{}"),
        ("goal_{}", "present_{}"),
        ("leader_{}", "follower_{}"),
        ("{}_target_position", "{}_position"),
        ("{} command [deg]", "{} measured [deg]"),
    ],
)
def test_words_tell_the_command(told: str, did: str, joints: tuple[str, ...]) -> None:
    found = command_pair(headers(told, did), joints)
    assert found["q_ref"].names == tuple(told.format(name) for name in DESK)
    assert found["q"].names == tuple(did.format(name) for name in DESK)
    assert found["q"].named is (joints == DESK)


def test_numbers_tell_the_joint_and_a_gripper_is_left_out() -> None:
    found = command_pair(headers("cmd{}", "pos{}", ("1", "2", "3")), DESK)
    assert found["q_ref"].names == ("cmd1", "cmd2", "cmd3")
    header = headers("action.{}", "state.{}", (MOTORS[3], *MOTORS[:3]))
    assert command_pair(header, DESK)["q"].names == ("state.shoulder_pan", "state.shoulder_lift", "state.elbow_flex")
    assert command_pair(header, NUMBERED)["q"].count == 4  # the user is asked which


@pytest.mark.parametrize(
    "header",
    [
        [*headers("cmd{}", "pos{}"), "tau1", "tau2", "tau3"],
        [*headers("cmd{}", "pos{}"), "a", "b", "c"],  # may be torques
        headers("q_{}", "position_{}"),
        headers("cmd_{}", "pos_{}", DESK[:2]),
        headers("action_{}_x", "state_{}_y"),
        ["t", "target_torque_1", "target_torque_2", "target_torque_3", "pos1", "pos2", "pos3"],
    ],
)
def test_no_pair(header: list[str]) -> None:
    assert command_pair(header, NUMBERED) == {}


def write_arm(names: tuple[str, ...]) -> None:
    links = "".join(
        f'<link name="l{k}"><inertial><origin xyz="0 0 0.1"/><mass value="0.2"/><inertia ixx="1e-3" ixy="0" ixz="0" '
        'iyy="1e-3" iyz="0" izz="1e-3"/></inertial></link>'
        f'<joint name="{name}" type="revolute"><parent link="l{k - 1}"/>'
        f'<child link="l{k}"/><origin xyz="0 0 0.1"/><axis xyz="0 1 0"/><limit lower="-3" upper="3" effort="5" '
        'velocity="9"/></joint>'
        for k, name in enumerate(names, start=1)
    )
    Path("arm.urdf").write_text(f'<robot name="arm"><link name="l0"/>{links}</robot>')


def drafted(size: np.ndarray, middle: np.ndarray, more: tuple[str, ...] = ()) -> str:
    """Return the draft for a log of commands and positions of MOTORS, sines of a size about a middle, each (4,)."""
    time = np.arange(300) / 50.0
    told = np.column_stack([middle[k] + size[k] * np.sin(2.0 * time + k) for k in range(4)])
    did = np.column_stack([middle[k] + 0.9 * size[k] * np.sin(2.0 * time - 0.2 + k) for k in range(4)])
    rest = np.column_stack([np.sin(time)] * len(more)) if more else np.zeros((300, 0))
    header = ",".join([*headers("action.{}.pos", "observation.state.{}.pos", MOTORS), *more])
    np.savetxt("run.csv", np.column_stack([time, told, did, rest]), "%.6f", ",", header=header, comments="")
    assert main(["init", "arm.urdf", "run.csv", "-o", "case.yaml", "--force"]) == 0
    return Path("case.yaml").read_text()


def test_init_drafts_servos(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    write_arm(DESK)
    text = drafted(np.full(4, 0.5), np.zeros(4))
    assert "\nservo:" in text and "torque: none" in text
    assert "joints: [shoulder_pan, shoulder_lift, elbow_flex]" in text
    assert "q_ref: [action.shoulder_pan.pos, action.shoulder_lift.pos, action.elbow_flex.pos]" in text
    assert "no torques and no currents: the case is for the actuators" in text


@pytest.mark.parametrize(("largest", "is_asked"), [(60.0, True), (130.0, False)])
def test_positions_of_lerobot_within_100_may_be_percent(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, largest: float, is_asked: bool
) -> None:
    """They are no likely degrees then: the stiffness follows which of both they are."""
    monkeypatch.chdir(tmp_path)
    write_arm(MOTORS)
    text = drafted(np.array([largest, 40.0, 50.0, 45.0]), np.zeros(4))
    (line,) = [line for line in text.splitlines() if line.startswith("    position:")]
    assert ("percent of the calibrated range" in line and "lerobot-calibrate" in line) == is_asked
    assert line.endswith("likely deg") != is_asked


def test_a_gripper_in_percent_is_asked_for_and_a_load_is_no_torque(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    write_arm(MOTORS)
    degrees, loads = np.array([60.0, 40.0, 50.0, 45.0]), tuple(f"observation.state.{name}.load" for name in MOTORS)
    text = drafted(degrees, np.array([0.0, 0.0, 0.0, 50.0]), loads)
    (line,) = [line for line in text.splitlines() if line.startswith("  calibration")]
    assert line.startswith("  calibration: ask   # ask: observation.state.gripper.pos runs from ")
    assert "\nservo:" in text and "no torques and no currents" not in text
    assert "not read: observation.state.shoulder_pan.load, " in text and "shares of its drive, no torques" in text
    assert "\n  calibration" not in drafted(degrees, np.zeros(4))  # a gripper that turns below 0 is in degrees
    assert "calibration" not in drafted(0.01 * degrees, np.array([0.0, 0.0, 0.0, 0.5]))  # rad
