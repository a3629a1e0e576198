"""What MJCF has not is refused by name, with the nearest known one; what MuJoCo's own schema has is read."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from dynident.errors import DescriptionError
from dynident.robot_files import read_robot
from dynident.robot_files.mjcf.schema import MjcfRule, mjcf_rules

mujoco = pytest.importorskip("mujoco")

ARM = (
    '<mujoco>{head}<worldbody {world}><body name="a"><joint name="j1"/><geom size=".1"/>{body}<body name="b">'
    '<joint name="j2"/><geom size=".1"/></body></body></worldbody>{tail}</mujoco>'
)
#: A typing error, and what the message names.
ERRORS = {
    "element of defaults": ({"head": "<default><jiont armature='1'/></default>"}, "<jiont>", "'joint'"),
    "attribute of a class that nothing has": (
        {"head": "<default><default class='c'><joint armatur='1'/></default></default>"},
        "'armatur'",
        "'armature'",
    ),
    "option": ({"head": "<option gravty='0 0 -1'/>"}, "unknown attribute 'gravty'", "'gravity'"),
    "flag": ({"head": "<option><flag gravty='disable'/></option>"}, "unknown attribute 'gravty'", "'gravity'"),
    "attribute of an actuator": (
        {"tail": "<actuator><motor joint='j1' geer='30'/></actuator>"},
        "<motor>: unknown attribute 'geer'",
        "'gear'",
    ),
    "actuator": (
        {"tail": "<actuator><moter joint='j1'/></actuator>"},
        "<moter>: no element in <actuator> has this name",
        "'motor'",
    ),
    "attribute of an equality": (
        {"tail": "<equality><joint joint1='j1' joint2='j2' polycoeff='0 2 0 0 0'/></equality>"},
        "'polycoeff'",
        "'polycoef'",
    ),
    "equality": ({"tail": "<equality><jiont joint1='j1' joint2='j2'/></equality>"}, "<jiont>", "'joint'"),
    "mesh": ({"head": "<asset><mesh name='m' scal='2 2 2'/></asset>"}, "<mesh name='m'>", "'scale'"),
    "world": ({"world": "name='w'"}, "<worldbody name='w'>: unknown attribute 'name'", "remove or correct it"),
    "site": ({"body": "<site nam='x'/>"}, "<site>: unknown attribute 'nam'", "'name'"),
    "a section that is not read": ({"tail": "<contact><pare/></contact>"}, "<pare>", "'pair'"),
    "element of a geom": ({"body": "<geom size='.1'><inertal/></geom>"}, "no element in <geom> has this name", ""),
    "in a frame": ({"body": "<frame><joint axs='1 0 0'/></frame>"}, "unknown attribute 'axs'", "'axis'"),
    "section": ({"tail": "<actuators/>"}, "<actuators>: no section of MJCF has this name", "'actuator'"),
}


@pytest.mark.parametrize("name", ERRORS)
def test_a_typing_error_is_refused_by_name(name: str, tmp_path: Path) -> None:
    parts, evidence, remedy = ERRORS[name]
    text = ARM.format(**{"head": "", "world": "", "body": "", "tail": "", **parts})
    path = tmp_path / "arm.xml"
    path.write_text(text)
    with pytest.raises(DescriptionError) as caught:
        read_robot(path)
    assert evidence in str(caught.value) and remedy in str(caught.value)
    if name == "in a frame":  # where MuJoCo passes over it
        return
    with pytest.raises(ValueError, match=r"Schema violation|unrecognized|World body"):
        mujoco.MjModel.from_xml_path(str(path))


def test_everything_in_the_schema_of_the_installed_mujoco_is_known() -> None:
    rows = re.sub(r"\n {26,}", " ", mujoco.mj_printSchema(False, False)).splitlines()
    above: list[MjcfRule] = []
    count = 0
    for row in rows:
        head = re.match(r"( *)(\S+) \(.\) *(.*)", row)
        if head is None:
            continue
        depth, tag = len(head[1]) // 3, head[2].replace("(world)", "")
        parent = above[depth - 1] if depth else None
        rule = mjcf_rules() if parent is None else (parent.children["worldbody"] if tag == "body" else parent).children
        rule = rule if isinstance(rule, MjcfRule) else rule[tag]
        assert set(head[3].split()) <= rule.attributes, row
        above[depth:] = [rule]
        count += 1
    assert count > 150


def test_what_every_xml_file_may_have_is_passed_over(tmp_path: Path) -> None:
    text = ARM.format(head="", world="", body="", tail="").replace(
        "<mujoco>", '<mujoco xmlns:xi="x" xml:base="y" xi:schema="z">'
    )
    (tmp_path / "arm.xml").write_text(text)
    assert read_robot(tmp_path / "arm.xml").dof == 2
