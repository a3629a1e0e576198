"""Which of two tied joints moves on its own: the one with the drive, or the one that a case file names."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import dynident as di
from dynident.case.case import read_case
from dynident.errors import DescriptionError, UnknownChoice
from dynident.model.friction import FRICTION
from dynident.robot_files.leaders import followed, led_by

ARM = """<mujoco model="gripper"><compiler angle="radian" autolimits="true"/><worldbody>
  <body name="arm"><inertial pos="0.2 0 0.1" mass="2" diaginertia="0.03 0.03 0.02"/>
    <joint name="turn" axis="0 1 0" armature="0.1" damping="0.5" frictionloss="0.4"/>
    <body name="left" pos="0.4 0 0"><inertial pos="0 0.01 0.02" mass="0.3" diaginertia="1e-4 1e-4 1e-4"/>
      <joint name="finger_l" type="slide" axis="0 1 0.5" range="-0.01 0.09" armature="0.2" damping="8"
             frictionloss="1.5"/></body>
    <body name="right" pos="0.4 0 0"><inertial pos="0 -0.01 0.02" mass="0.2" diaginertia="1e-4 1e-4 1e-4"/>
      <joint name="finger_r" type="slide" axis="0 1 0" range="-0.04 0.0" armature="0.1" damping="4"
             frictionloss="0.5"/></body>
  </body></worldbody>
  <equality><joint joint1="finger_l" joint2="finger_r" polycoef="0.01 -2 0 0 0"/></equality>
  <actuator><motor joint="turn" gear="10"/>{}</actuator></mujoco>"""
MOTOR = '<motor joint="finger_{}" gear="5" forcerange="-3 3"/>'


def written(folder: Path, *driven: str) -> str:
    path = folder / "gripper.xml"
    path.write_text(ARM.format("".join(map(MOTOR.format, driven))), encoding="utf-8")
    return str(path)


@pytest.mark.parametrize(
    ("driven", "leads"), [("", "finger_r"), ("r", "finger_r"), ("l", "finger_l"), ("lr", "finger_r")]
)
def test_the_finger_with_the_only_drive_leads(tmp_path: Path, driven: str, leads: str) -> None:
    path = written(tmp_path, *driven)
    mujoco: Any = pytest.importorskip("mujoco")
    for robot in (di.robot_of(path), di.robot_of(mujoco.MjModel.from_xml_path(path))):
        assert robot.joint_names == ("turn", leads)
        efforts = {joint.name: joint.limits.effort for joint in robot.joints}
        assert efforts == {f"finger_{side}": 15.0 if side in driven else np.inf for side in "lr"} | {"turn": np.inf}
        told = {followed(joint) for joint in robot.joints}
        other = "finger_l = -2 finger_r + 0.01" if leads == "finger_r" else "finger_r = -0.5 finger_l + 0.005"
        assert told == {"", other}


def test_torques_of_the_new_leader_are_those_of_the_old_one_by_virtual_work(tmp_path: Path) -> None:
    right = di.robot_of(written(tmp_path, "r"))
    left = led_by(right, "finger_l")
    ratio, q, dq, ddq = -2.0, *np.random.default_rng(0).normal(size=(3, 50, 2))
    there = [part * [1.0, ratio] for part in (q, dq, ddq)]
    there[0][:, 1] += 0.01
    torques = []
    for robot, motion in ((right, (q, dq, ddq)), (left, there)):
        model = di.DynamicModel(robot, (FRICTION.make("viscous"), FRICTION.make("coulomb", {"width": 1e-9})))
        theta = model.nominal()
        assert theta is not None
        torques.append(model.regressor(*motion) @ theta + motion[2] @ robot.reflected_inertia)
    np.testing.assert_allclose(torques[1], torques[0] / [1.0, ratio], rtol=1e-9, atol=1e-12)
    assert left.joints[1].limits.effort == pytest.approx(15.0 / 2)
    assert led_by(left, "finger_l") is left
    back = led_by(left, "finger_r")
    assert back.joint_names == right.joint_names and followed(back.joints[1]) == followed(right.joints[1])
    with pytest.raises(UnknownChoice, match="finger_x"):
        led_by(right, "finger_x")


def test_a_case_names_the_finger_whose_torque_is_logged(tmp_path: Path) -> None:
    written(tmp_path, "r")
    case = tmp_path / "case.yaml"
    case.write_text("case: 2\nrobot: gripper.xml\njoints: [turn, finger_l]\n", encoding="utf-8")
    assert read_case(case).robot.joint_names == read_case(case).columns.joints == ("turn", "finger_l")
    case.write_text("case: 2\nrobot: gripper.xml\njoints: [turn, finger_r]\n", encoding="utf-8")
    assert read_case(case).robot.joint_names == ("turn", "finger_r")
    case.write_text("case: 2\nrobot: gripper.xml\njoints: [turn, finger_l, finger_r]\n", encoding="utf-8")
    with pytest.raises(DescriptionError, match=r"'finger_l' follows 'finger_r'.*finger_l = -2 finger_r \+ 0.01"):
        read_case(case)
