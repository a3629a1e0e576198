"""Every fault in the XML and the tree of a URDF, with its full message."""

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
}


@pytest.mark.parametrize("name", CASES)
def test_message(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert_refused("bad.urdf", GOOD_URDF, CASES[name])


def test_the_good_one_reads(tmp_path: Path) -> None:
    assert_sound(str(tmp_path / "good.urdf"), GOOD_URDF)
