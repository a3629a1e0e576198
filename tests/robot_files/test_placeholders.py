"""Masses that are placeholders: one body for all links of an arm is none, the same wheel four times is one."""

from __future__ import annotations

from pathlib import Path

import pytest

from drafted_logs import moved, numbered, write_log
from dynident.case.case_draft import draft_case
from dynident.model.robot import Robot
from dynident.robot_files import read_robot, shipped_robots
from dynident.robot_files.tree import PLACEHOLDERS

CENTRE = "0 0 0"


def arm(folder: Path, masses: list[str], centre: str = CENTRE, is_chain: bool = True) -> str:
    """Write an arm, or a base with wheels, whose links have one moment of inertia."""
    text = '<robot name="arm"><link name="base"/>'
    for k, mass in enumerate(masses):
        text += f"""<link name="link{k}"><inertial><origin xyz="{centre}"/><mass value="{mass}"/>
          <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial></link>
        <joint name="j{k}" type="revolute"><parent link="{f"link{k - 1}" if k and is_chain else "base"}"/>
          <child link="link{k}"/><origin xyz="0 0 0.3"/><axis xyz="{k % 2} 1 0"/>
          <limit lower="-3" upper="3" velocity="2" effort="100"/></joint>"""
    path = folder / "arm.urdf"
    path.write_text(f"{text}</robot>")
    return str(path)


def is_unknown(robot: Robot) -> bool:
    assert (PLACEHOLDERS in robot.note) == all(link.inertia is None for link in robot.links)
    return PLACEHOLDERS in robot.note


def test_one_body_for_all_links_of_an_arm_is_no_mass(tmp_path: Path) -> None:
    assert is_unknown(read_robot(arm(tmp_path, ["2", "2", "2"])))
    robot = read_robot(arm(tmp_path, ["2", "2", "2", "2", "3"]))
    assert is_unknown(robot) and "4 of 5 links state one body of 2 kg, its centre in their frame" in robot.note


@pytest.mark.parametrize(
    ("masses", "centre", "is_chain"),
    [
        (["2", "2"], CENTRE, True),  # two links may be alike
        (["2", "2", "1.5", "1"], CENTRE, True),
        (["2", "2", "2"], "0 0 0.1", True),  # modules of a snake
        (["2", "2", "2", "2"], CENTRE, False),  # wheels, propellers
        (["0.01", "0.01", "0.01", "3"], CENTRE, True),  # next to no mass of the robot
    ],
)
def test_bodies_that_may_be_a_robots_are_taken(tmp_path: Path, masses: list[str], centre: str, is_chain: bool) -> None:
    assert not is_unknown(read_robot(arm(tmp_path, masses, centre, is_chain)))


def test_no_robot_that_ships_has_placeholders() -> None:
    assert not [name for name in shipped_robots() if PLACEHOLDERS in read_robot(name).note]


def test_a_draft_says_so_and_proposes_no_gain(tmp_path: Path) -> None:
    """A gain by masses that are placeholders is wrong, and obeyed it turned every warning off."""
    path = arm(tmp_path, ["2", "2", "2.001"])
    columns = numbered(moved(read_robot(path)), torque="current{} [A]")
    log = write_log(tmp_path / "run.csv", columns)
    assert "roughly" in draft_case(path, log, tmp_path).text
    draft = draft_case(arm(tmp_path, ["2", "2", "2"]), log, tmp_path)
    assert "roughly" not in draft.text and len(draft.needed) == 3
    assert draft.remarks[0].startswith("the robot model's masses and inertias are placeholders")
