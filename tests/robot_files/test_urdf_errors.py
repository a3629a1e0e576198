"""Every fault in the XML, the tree and the values of a URDF, with its full message."""

from __future__ import annotations

from pathlib import Path

import pytest
from faulty_descriptions import GOOD_URDF, Fault, assert_refused, assert_sound

CASES: dict[str, Fault] = {
    "document type": (
        "<robot name",
        "<!DOCTYPE robot>\n<robot name",
        (
            "line 2: it has a document type (DTD) or an entity; remove the <!DOCTYPE ...> part: it can hide "
            "entities and outside files"
        ),
    ),
    "entity": (
        "<robot name",
        '<!DOCTYPE robot [<!ENTITY a "1">]>\n<robot name',
        (
            "line 2: it has a document type (DTD) or an entity; remove the <!DOCTYPE ...> part: it can hide "
            "entities and outside files"
        ),
    ),
    "external": (
        "<robot name",
        '<!DOCTYPE robot [<!ENTITY a SYSTEM "file:///etc/hostname">]>\n<robot name',
        (
            "line 2: it has a document type (DTD) or an entity; remove the <!DOCTYPE ...> part: it can hide "
            "entities and outside files"
        ),
    ),
    "undefined entity": (
        '"1.5"',
        '"&a;"',
        ("line 7: not XML (undefined entity); correct the line, or write the file again with the tool that made it"),
    ),
    "not XML": (
        '</link>\n  <link name="hand"/>',
        '<link name="hand"/>',
        "line 24: not XML (mismatched tag); correct the line, or write the file again with the tool that made it",
    ),
    "truncated": (
        GOOD_URDF,
        GOOD_URDF[:500],
        "line 17: not XML (unclosed token); correct the line, or write the file again with the tool that made it",
    ),
    "text": (
        None,
        "< hello",
        (
            "line 1: not XML (not well-formed (invalid token)); correct the line, or write the file again with "
            "the tool that made it"
        ),
    ),
    "encoding": (
        '<?xml version="1.0"?>',
        '<?xml version="1.0" encoding="no-such"?>',
        "line 1: not XML (unknown encoding: no-such); save the file as UTF-8",
    ),
    "root": (None, "<scene></scene>", "line 1: the file begins with <scene>, not with <robot>; give a URDF"),
    "xacro value": (
        '"0 0 0.3"',
        '"0 0 ${h}"',
        ("line 15: xyz='0 0 ${h}' makes this a xacro file, not a URDF; expand it first: xacro file.xacro > file.urdf"),
    ),
    "deep": (
        '<link name="base"/>',
        '<link name="base">' + "<v>" * 64 + "</v>" * 64 + "</link>",
        "line 3: elements more than 64 levels deep; give the URDF of one robot",
    ),
    "many links": (
        '<link name="base"/>',
        "".join(f'<link name="l{i}"/>' for i in range(1001)),
        "line 3: more than 1000 links; give the URDF of one robot",
    ),
    "many elements": (
        '<link name="base"/>',
        '<link name="base">' + "<inertial/>" * 20_000 + "</link>",
        "line 3: more than 20000 elements; give the URDF of one robot",
    ),
    "no links": (
        None,
        '<robot name="a"><joint name="b" type="fixed"/></robot>',
        "no <link> in <robot>; give the URDF of a robot",
    ),
    "nothing moves": (
        None,
        '<robot name="a"><link name="b"/></robot>',
        "no joint moves; give the robot model of an arm with moving joints",
    ),
    "robot name": (
        '<robot name="arm">',
        "<robot>",
        "line 2: <robot> has no attribute 'name'; write <robot name=\"...\">",
    ),
    "link name": (
        '<link name="base"/>',
        "<link/>",
        "line 3: <link> has no attribute 'name'; write <link name=\"...\">",
    ),
    "link name empty": ('<link name="base"/>', '<link name=" "/>', "line 3: link name is empty; give it a name"),
    "control character": (
        '<link name="hand"/>',
        '<link name="hand&#10;error: x"/>',
        "line 11: link name 'hand\\nerror: x' has characters that cannot be printed; use plain letters",
    ),
    "joint name": (
        '<joint name="wrist"',
        "<joint",
        "line 20: <joint> has no attribute 'name'; write <joint name=\"...\">",
    ),
    "joint type": (
        ' type="continuous"',
        "",
        "joint 'wrist': <joint> has no attribute 'type'; write <joint type=\"...\">",
    ),
    "joint type unknown": (
        '"continuous"',
        '"Continous"',
        (
            "joint 'wrist': type 'Continous' is not known; choose one of: fixed, revolute, continuous, "
            "prismatic; did you mean 'continuous'?"
        ),
    ),
    "floating": (
        '"continuous"',
        '"floating"',
        (
            "joint 'wrist': type 'floating' has more than one degree of freedom; replace it by revolute and "
            "prismatic joints, or that of a base by a fixed one: the base has to rest in the logs"
        ),
    ),
    "planar": (
        '"continuous"',
        '"planar"',
        (
            "joint 'wrist': type 'planar' has more than one degree of freedom; replace it by revolute and "
            "prismatic joints, or that of a base by a fixed one: the base has to rest in the logs"
        ),
    ),
    "link twice": (
        '<link name="hand"/>',
        '<link name="hand"/><link name="upper"/>',
        "line 11: a second link is called 'upper'; give each link a name of its own",
    ),
    "joint twice": (
        'name="wrist"',
        'name="shoulder"',
        "line 20: a second joint is called 'shoulder'; give each joint a name of its own",
    ),
    "parent missing": (
        '<parent link="upper"/>',
        "",
        "joint 'wrist': <joint> has no <parent>; add <parent .../> (line 20)",
    ),
    "parent unknown": (
        '<parent link="upper"/>',
        '<parent link="uper"/>',
        (
            "joint 'wrist': its parent link 'uper' is not in the file; add the link, or correct the name; did "
            "you mean 'upper'?"
        ),
    ),
    "parent attribute": (
        '<parent link="upper"/>',
        '<parent body="upper"/>',
        "joint 'wrist': <parent> has no attribute 'link'; write <parent link=\"...\">",
    ),
    "child unknown": (
        '<child link="hand"/>',
        '<child link="foot"/>',
        "joint 'wrist': its child link 'foot' is not in the file; add the link, or correct the name",
    ),
    "child missing": ('<child link="hand"/>', "", "joint 'wrist': <joint> has no <child>; add <child .../> (line 20)"),
    "two parents": (
        '<child link="hand"/>',
        '<child link="upper"/>',
        (
            "link 'upper': it is the child of two joints, 'shoulder' and 'wrist'; keep one of them: each "
            "link is the child of one joint"
        ),
    ),
    "two roots": (
        '<link name="base"/>',
        '<link name="base"/><link name="spare"/>',
        "2 links have no parent joint: 'base', 'spare'; connect all but one with a joint, or remove them",
    ),
    "cycle with root": (
        '<parent link="upper"/>',
        '<parent link="hand"/>',
        "the links form a loop: 'hand' -> 'hand'; remove one joint of the loop: only trees are read",
    ),
    "cycle all": (
        '<parent link="base"/>',
        '<parent link="hand"/>',
        ("the links form a loop: 'upper' -> 'hand' -> 'upper'; remove one joint of the loop: only trees are read"),
    ),
    "cycle no root": (
        '<link name="base"/>',
        '<joint name="extra" type="fixed"><parent link="hand"/><child link="base"/></joint><link name="base"/>',
        "the links form a loop: 'base' -> 'upper' -> 'hand' -> 'base'; "
        "remove one joint of the loop: only trees are read",
    ),
    "empty": (None, "", "the file is empty; give a URDF, MJCF, SDF or xacro, or a DH table in YAML"),
    "white": (None, " \n", "the file is empty; give a URDF, MJCF, SDF or xacro, or a DH table in YAML"),
    "mass comma": ('"1.5"', '"1,5"', "link 'upper': mass value '1,5' is not a number; write a decimal point: 1.5"),
    "mass unit": (
        '"1.5"',
        '"1kg"',
        "link 'upper': mass value '1kg' is not a number; write one plain number, without a unit",
    ),
    "mass empty": ('"1.5"', '""', "link 'upper': mass value is empty; write a number"),
    "mass nan": ('"1.5"', '"nan"', "link 'upper': mass value 'nan' is not a finite number; write a finite number"),
    "mass inf": ('"1.5"', '"inf"', "link 'upper': mass value 'inf' is not a finite number; write a finite number"),
    "mass overflow": ('"1.5"', '"1e400"', "link 'upper': mass value '1e400' is too large; write a number in SI units"),
    "mass huge": ('"1.5"', '"1e60"', "link 'upper': mass value '1e60' is too large; write a number in SI units"),
    "mass negative": ('"1.5"', '"-1"', "link 'upper': mass value -1 is negative; write the mass in kg, 0 or more"),
    "mass underscore": (
        '"1.5"',
        '"1_5"',
        "link 'upper': mass value '1_5' is not a number; write one plain number, without a unit",
    ),
    "mass hexadecimal": (
        '"1.5"',
        '"0x1p3"',
        "link 'upper': mass value '0x1p3' is not a number; write one plain number, without a unit",
    ),
    "mass digits": (
        '"1.5"',
        '"\u0661"',
        "link 'upper': mass value '١' is not a number; write one plain number, without a unit",
    ),
    "mass long": (
        '"1.5"',
        '"' + "x" * 100 + '"',
        (
            "link 'upper': mass value 'xxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxx'... is not a number; write "
            "one plain number, without a unit"
        ),
    ),
    "mass missing": ('<mass value="1.5"/>', "", "link 'upper': <inertial> has no <mass>; add <mass .../> (line 5)"),
    "mass attribute": (
        '<mass value="1.5"/>',
        "<mass>1.5</mass>",
        "link 'upper': <mass> has no attribute 'value'; write <mass value=\"...\">",
    ),
    "mass element": (
        '<mass value="1.5"/>',
        "<mass><value>1.5</value></mass>",
        ('line 7: <value> is an element of <mass>, which no reader sees; write an attribute: <mass value="...">'),
    ),
    "mass twice": (
        '<mass value="1.5"/>',
        '<mass value="1.5"/><mass value="2"/>',
        "link 'upper': 2 <mass> elements (lines 7, 7); keep one of them",
    ),
    "inertia missing": (
        '<inertia ixx="0.01" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.03"/>',
        "",
        "link 'upper': <inertial> has no <inertia>; add <inertia .../> (line 5)",
    ),
    "inertia attribute": (
        'iyz="0" ',
        "",
        "link 'upper': <inertia> has no attribute 'iyz'; write <inertia iyz=\"...\">",
    ),
    "inertia text": (
        'ixx="0.01"',
        'ixx="a"',
        "link 'upper': inertia ixx 'a' is not a number; write one plain number, without a unit",
    ),
    "inertia nan": (
        'ixx="0.01"',
        'ixx="NaN"',
        "link 'upper': inertia ixx 'NaN' is not a finite number; write a finite number",
    ),
    "inertial twice": (
        '<link name="hand"/>',
        '<link name="hand"><inertial/><inertial/></link>',
        "link 'hand': 2 <inertial> elements (lines 11, 11); keep one of them",
    ),
    "xyz count": (
        '"0 0 0.3"',
        '"0 0.3"',
        "joint 'shoulder': origin xyz '0 0.3' is not 3 numbers; write 3 numbers with spaces between them",
    ),
    "xyz commas": (
        '"0 0 0.3"',
        '"0,0,0.3"',
        "joint 'shoulder': origin xyz '0,0,0.3' is not 3 numbers; write 3 numbers with spaces between them",
    ),
    "xyz text": (
        '"0 0 0.3"',
        '"0 0 high"',
        "joint 'shoulder': origin xyz 'high' is not a number; write one plain number, without a unit",
    ),
    "inertial xyz": (
        '"0.1 0 0"',
        '"0.1 0 0 0"',
        "link 'upper': origin xyz '0.1 0 0 0' is not 3 numbers; write 3 numbers with spaces between them",
    ),
    "rpy text": (
        'rpy="0 0 0.5"',
        'rpy="0 0 pi/2"',
        "link 'upper': origin rpy 'pi/2' is not a number; write one plain number, without a unit",
    ),
    "rpy count": (
        'rpy="0 0 0"',
        'rpy="0 0"',
        "joint 'shoulder': origin rpy '0 0' is not 3 numbers; write 3 numbers with spaces between them",
    ),
    "quaternion and rpy": (
        'rpy="0 0 0"',
        'rpy="0 0 0" quat_xyzw="0 0 0 1"',
        "joint 'shoulder': origin has both rpy and quat_xyzw; keep one of the two",
    ),
    "quaternion length": (
        'rpy="0 0 0"',
        'quat_xyzw="0 0 0 2"',
        "joint 'shoulder': origin quat_xyzw '0 0 0 2' has length 2, not 1; write a unit quaternion x y z w",
    ),
    "quaternion count": (
        'rpy="0 0 0"',
        'quat_xyzw="0 0 1"',
        ("joint 'shoulder': origin quat_xyzw '0 0 1' is not 4 numbers; write 4 numbers with spaces between them"),
    ),
    "axis zero": (
        '<axis xyz="0 0 1"/>',
        '<axis xyz="0 0 0"/>',
        "joint 'shoulder': axis xyz '0 0 0' has no direction; write it as '0 0 1'",
    ),
    "axis count": (
        '<axis xyz="0 0 1"/>',
        '<axis xyz="0 1"/>',
        "joint 'shoulder': axis xyz '0 1' is not 3 numbers; write 3 numbers with spaces between them",
    ),
    "axis attribute": (
        '<axis xyz="0 0 1"/>',
        "<axis/>",
        "joint 'shoulder': <axis> has no attribute 'xyz'; write <axis xyz=\"...\">",
    ),
    "axis inf": (
        '<axis xyz="0 0 1"/>',
        '<axis xyz="0 0 inf"/>',
        "joint 'shoulder': axis xyz 'inf' is not a finite number; write a finite number",
    ),
    "limits crossed": (
        'lower="-1"',
        'lower="2"',
        "joint 'shoulder': the lower limit 2 is above the upper limit 1; exchange or correct them",
    ),
    "limit nan": (
        'lower="-1"',
        'lower="nan"',
        "joint 'shoulder': limit lower 'nan' is not a finite number; write a finite number",
    ),
    "limit overflow": (
        'upper="1"',
        'upper="1e400"',
        "joint 'shoulder': limit upper '1e400' is too large; write 'inf' where there is no limit",
    ),
    "limit side": (
        'lower="-1"',
        'lower="inf"',
        "joint 'shoulder': the lower limit inf is above the upper limit 1; exchange or correct them",
    ),
    "velocity negative": (
        'velocity="2"',
        'velocity="-2"',
        "joint 'shoulder': limit velocity -2 is negative; write 0 or more",
    ),
    "effort negative": (
        'effort="10"',
        'effort="-10"',
        "joint 'shoulder': limit effort -10 is negative; write 0 or more",
    ),
    "acceleration negative": (
        'velocity="2"',
        'velocity="2" acceleration="-1"',
        "joint 'shoulder': limit acceleration -1 is negative; write 0 or more",
    ),
    "damping negative": (
        'damping="0.5"',
        'damping="-0.5"',
        "joint 'shoulder': dynamics damping -0.5 is negative; write 0 or more",
    ),
    "friction negative": (
        'friction="0.1"',
        'friction="-0.1"',
        "joint 'shoulder': dynamics friction -0.1 is negative; write 0 or more",
    ),
    "friction text": (
        'friction="0.1"',
        'friction="low"',
        "joint 'shoulder': dynamics friction 'low' is not a number; write one plain number, without a unit",
    ),
    "damping element": (
        '<dynamics damping="0.5" friction="0.1"/>',
        "<dynamics><damping>0.5</damping></dynamics>",
        (
            "line 18: <damping> is an element of <dynamics>, which no reader sees; write an attribute: "
            '<dynamics damping="...">'
        ),
    ),
    "mimic unknown": (
        'mimic joint="shoulder"',
        'mimic joint="sholder"',
        (
            "joint 'wrist': it follows 'sholder', which is no joint; write the name of a joint of this file "
            "in <mimic>; did you mean 'shoulder'?"
        ),
    ),
    "mimic itself": (
        'mimic joint="shoulder"',
        'mimic joint="wrist"',
        ("joint 'wrist': it follows itself: 'wrist' -> 'wrist'; let one of them move on its own: remove its <mimic>"),
    ),
    "mimic loop": (
        '<axis xyz="0 0 1"/>',
        '<mimic joint="wrist"/>',
        (
            "joint 'shoulder': it follows itself: 'shoulder' -> 'wrist' -> 'shoulder'; let one of them move "
            "on its own: remove its <mimic>"
        ),
    ),
    "mimic zero": (
        'multiplier="2"',
        'multiplier="0"',
        "joint 'wrist': mimic multiplier 0 holds it still; make the joint fixed, or correct the multiplier",
    ),
    "mimic joint": (
        '<mimic joint="shoulder"',
        "<mimic",
        "joint 'wrist': <mimic> has no attribute 'joint'; write <mimic joint=\"...\">",
    ),
    "mimic fixed": (
        'type="revolute"',
        'type="fixed"',
        "joint 'wrist': it follows 'shoulder', which is fixed; remove the <mimic>, or make the joint fixed",
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_message(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert_refused("bad.urdf", GOOD_URDF, CASES[name])


def test_the_good_one_reads(tmp_path: Path) -> None:
    assert_sound(str(tmp_path / "good.urdf"), GOOD_URDF)
