"""The section drives of a case file: what else stands in the file stays, and what is written is read again."""

from __future__ import annotations

from pathlib import Path

import pytest

from dynident.case.case import read_case
from dynident.case.drives_text import GainLine, case_with_drives, drives_section, stated_drives
from dynident.errors import DescriptionError
from dynident.robot_files import read_robot

ROBOT = read_robot("generic-scara")
CASE = """# a case
case: 1
robot: generic-scara      # ships
drives:   # from the data sheet
  {first}: {{gain: 1.5, gear_ratio: 100}}
  # a remark
  {last}:
    gain: ask   # ask: the drive gain, N m at the joint per unit of i4; {{roughly}} 8
    bias: 2

# after the drives
friction: [coulomb, viscous]
train: run.csv
"""


def names() -> tuple[str, ...]:
    return ROBOT.joint_names


def gains() -> dict[str, GainLine]:
    first, *_, last = names()
    return {first: GainLine(12.25, 0.031, ""), last: GainLine(None, 0.0, "not\ndetermined # at all")}


def test_the_rest_of_the_file_stays(tmp_path: Path) -> None:
    first, *_, last = names()
    text = CASE.format(first=first, last=last)
    written = case_with_drives("case.yaml", text.encode(), ROBOT, gains())
    before, after = text.split("drives:")[0], text.split("    bias: 2\n")[1]
    assert written.startswith(before)
    assert written.endswith(after)
    assert f"  {first}: {{gear_ratio: 100, gain: 12.25, gain_std: 0.031}}\n" in written
    asked = f"# ask: the drive gain of {last}, torque per unit of current; not determined # at all"
    assert f"  {last}: {{gain: ask, bias: 2}}  {asked}\n" in written
    (tmp_path / "case.yaml").write_text(written)
    with pytest.raises(DescriptionError, match=f"line .* asks for the drive gain of {last}"):
        read_case(tmp_path / "case.yaml")
    drives = {joint.name: joint.drive for joint in read_case(tmp_path / "case.yaml", open_gains=True).robot.active}
    assert (drives[first].gain, drives[first].gain_deviation, drives[first].gear_ratio) == (12.25, 0.031, 100.0)
    assert (drives[last].gain, drives[last].bias) == (ROBOT.active[-1].drive.gain, 2.0)


@pytest.mark.parametrize("tail", ["", "\n", "\n# the end\n"])
@pytest.mark.parametrize("drives", ["", "drives: ask  # ask: the drives\n", "drives: {}\n"])
def test_a_case_without_drives_gets_them(tail: str, drives: str) -> None:
    text = f"case: 1\nrobot: generic-scara\n{drives}train: run.csv{tail}"
    written = case_with_drives("case.yaml", text.encode(), ROBOT, gains())
    assert stated_drives("case.yaml", written.encode()) == {names()[0]: {"gain": "12.25", "gain_std": "0.031"}}
    for line in text.splitlines():
        assert line.startswith("drives") or line in written


def test_names_that_yaml_would_misread_are_quoted() -> None:
    section = drives_section(ROBOT, {}, {"on": {"gain": "2"}, "a: 'b'": {"gain": "3"}})
    assert "  'on': {gain: 2}\n" in section
    assert "  'a: ''b''': {gain: 3}\n" in section
    assert stated_drives("x", section.encode()) == {"on": {"gain": "2"}, "a: 'b'": {"gain": "3"}}


def test_a_section_that_is_no_block_is_refused() -> None:
    first = names()[0]
    text = f"{{case: 1, robot: generic-scara, drives: {{{first}: {{gain: 2}}}}}}\n"
    with pytest.raises(DescriptionError):
        case_with_drives("case.yaml", text.encode(), ROBOT, gains())
