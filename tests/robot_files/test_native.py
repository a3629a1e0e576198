"""The native form: exact round trips, and every fault with its full message."""

from __future__ import annotations

import copy
import json
import math
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dynident.errors import DescriptionError
from dynident.model.documents.robot_data import robot_from_dict, robot_to_dict
from dynident.model.inertia import Inertia
from dynident.model.joint import Drive, Joint, JointLimits, Mimic, rotation_about
from dynident.model.robot import Frame, Link, Robot
from dynident.robot_files import read_robot, shipped_robots

number = st.floats(-1e6, 1e6)
positive = st.floats(1e-6, 1e6)
name = st.text("abcäß_ 12:%'\"", min_size=1, max_size=8).map(lambda text: f"n{text}")
direction = st.tuples(st.floats(-1, 1), st.floats(-1, 1), st.floats(0.1, 1))


@st.composite
def poses(draw: st.DrawFn) -> tuple[np.ndarray, np.ndarray]:
    axis = np.array(draw(direction))
    rotation = rotation_about(axis / np.linalg.norm(axis), draw(st.floats(-4, 4)))
    return rotation, np.array([draw(number) for _ in range(3)])


@st.composite
def limits(draw: st.DrawFn) -> JointLimits:
    lower, upper = sorted((draw(number), draw(number)))
    bounds = [draw(st.one_of(positive, st.just(math.inf))) for _ in range(5)]
    return JointLimits(
        draw(st.sampled_from([lower, -math.inf])), draw(st.sampled_from([upper, math.inf])), *bounds
    )  # fmt: skip


@st.composite
def robots(draw: st.DrawFn) -> Robot:
    count = draw(st.integers(1, 4))
    links, joints = [], []
    optional = st.one_of(st.none(), number)
    for i in range(count):
        ten = draw(st.one_of(st.none(), st.lists(number, min_size=10, max_size=10)))
        fixed = tuple(draw(st.lists(name, max_size=2)))
        links.append(Link(draw(name), None if ten is None else Inertia.from_vector(ten), fixed))
        follows = i > 0 and draw(st.booleans())
        kinds: list[Literal["revolute", "prismatic"]] = ["revolute", "prismatic"]
        rotation, translation = draw(poses())
        joints.append(
            Joint(
                f"{draw(name)}{i}", draw(st.sampled_from(kinds)), draw(st.integers(-1, i - 1)), rotation, translation,
                np.array(draw(direction)), draw(limits()),
                Drive(draw(positive), draw(positive), draw(st.one_of(st.none(), positive))),
                Mimic(joints[0].name, draw(number), draw(number)) if follows else None,
                draw(optional), draw(optional),
            )
        )  # fmt: skip
    dof = sum(joint.mimic is None for joint in joints)
    frames = {f"{draw(name)}{i}": Frame(draw(st.integers(-1, count - 1)), *draw(poses())) for i in range(2)}
    coupling = np.eye(dof) + np.triu(np.full((dof, dof), draw(st.floats(-50, 50))), 1)
    return Robot(
        draw(name), tuple(links), tuple(joints), np.array([draw(number) for _ in range(3)]), draw(name), frames,
        draw(st.sampled_from(["", *frames])), coupling, draw(name),
    )  # fmt: skip


@given(robots())
@settings(max_examples=60, deadline=None)
def test_round_trip_is_exact(robot: Robot) -> None:
    data = robot_to_dict(robot)
    back = robot_from_dict(json.loads(json.dumps(data, allow_nan=False)))
    assert robot_to_dict(back) == data
    for ours, theirs in zip(robot.joints, back.joints, strict=True):
        assert (ours.limits, ours.drive, ours.mimic) == (theirs.limits, theirs.drive, theirs.mimic)
        for field in ("rotation", "translation", "axis"):
            assert getattr(ours, field).tobytes() == getattr(theirs, field).tobytes()
    for link, other in zip(robot.links, back.links, strict=True):
        assert (link.name, link.fixed) == (other.name, other.fixed)
        assert (link.inertia is None) == (other.inertia is None)
        if link.inertia is not None and other.inertia is not None:
            assert link.inertia.vector.tolist() == other.inertia.vector.tolist()
    assert (back.name, back.base, back.tool, back.note) == (robot.name, robot.base, robot.tool, robot.note)


def test_an_estimate_is_no_robot() -> None:
    with pytest.raises(DescriptionError, match=f"kind is 'dynident estimate', not 'dynident-robot'.*{GIVE}"):
        robot_from_dict({"kind": "dynident estimate"})


@pytest.mark.parametrize("shipped", shipped_robots())
def test_json_file_reads(shipped: str, tmp_path: Path) -> None:
    data = robot_to_dict(read_robot(shipped))
    path = tmp_path / "robot.json"
    path.write_text(json.dumps(data, allow_nan=False))
    assert robot_to_dict(read_robot(path)) == data


#: Where the data of the SCARA are changed (a missing value: removed), and the message after the file name.
MISSING = object()
GIVE = "or a robot that dynident has written; validate, predict, report and export read estimates"
FAULTS: dict[str, tuple[list[str | int], Any, str]] = {
    "schema": (["schema"], "other", "schema is 'other', not 'dynident-robot'; give a case, " + GIVE),
    "no schema": (["schema"], MISSING, "it states no schema; give a case, " + GIVE),
    "version": (["version"], 99, "a robot of version 99; this dynident reads versions up to 1; update dynident"),
    "unknown key": (
        ["gravty"],
        1,
        (
            "unknown key 'gravty'; known keys: schema, version, name, base, gravity, links, joints, frames, "
            "tool, coupling, note, base_shapes, held; did you mean 'gravity'?"
        ),
    ),
    "no name": (["name"], MISSING, "name: is missing; add it"),
    "link inertia": (
        ["links", 0, "inertia"],
        [1.0] * 9,
        "links.1.inertia: 10 numbers are needed, not a list of 9; write a list of 10 numbers",
    ),
    "inertia nan": (
        ["links", 0, "inertia", 3],
        float("nan"),
        "links.1.inertia.4: nan is not a finite number; write a number, or null for a limit that is not known",
    ),
    "inertia text": (["links", 0, "inertia", 3], "1", "links.1.inertia.4: a number is needed, not '1'; write a number"),
    "inertia boolean": (
        ["links", 0, "inertia", 3],
        True,
        "links.1.inertia.4: a number is needed, not True; write a number",
    ),
    "inertia huge": (
        ["links", 0, "inertia", 3],
        10**400,
        "links.1.inertia.4: a whole number of hundreds of digits is too large; write a number in SI units",
    ),
    "fixed": (["links", 0, "fixed"], "a", "links.1.fixed: 'a' is no list of names; write a list of texts"),
    "kind": (
        ["joints", 0, "kind"],
        "ball",
        "joints.1.kind: 'ball' is not known here; choose one of: revolute, prismatic",
    ),
    "parent later": (
        ["joints", 1, "parent"],
        1,
        (
            "joints.2.parent: 1 is no index of a link that stands before (-1 to 0); write the index, from 0, "
            "or -1 for the base"
        ),
    ),
    "parent float": (
        ["joints", 1, "parent"],
        0.0,
        (
            "joints.2.parent: 0.0 is no index of a link that stands before (-1 to 0); write the index, from "
            "0, or -1 for the base"
        ),
    ),
    "rotation": (
        ["joints", 0, "rotation", 0, 0],
        0.5,
        "joints.1.rotation: the matrix is no rotation; write an orthogonal matrix, determinant 1",
    ),
    "rotation rows": (
        ["joints", 0, "rotation"],
        [[1, 0, 0]],
        "joints.1.rotation: 3 rows are needed, not a list of 1; write 3 lists of 3 numbers",
    ),
    "reflection": (
        ["joints", 0, "rotation", 2, 2],
        -1.0,
        "joints.1.rotation: the matrix is no rotation; write an orthogonal matrix, determinant 1",
    ),
    "axis": (["joints", 0, "axis"], [0, 0, 2.0], "joints.1.axis: the axis has length 2; write a unit vector"),
    "limits crossed": (
        ["joints", 0, "limits", "lower"],
        5.0,
        "joints.1.limits: the lower limit 5 is above the upper limit 2.3; exchange or correct them",
    ),
    "limit infinite": (
        ["joints", 0, "limits", "lower"],
        float("-inf"),
        ("joints.1.limits.lower: -inf is not a finite number; write a number, or null for a limit that is not known"),
    ),
    "ratio": (
        ["joints", 0, "drive", "gear_ratio"],
        0.0,
        "joints.1.drive.gear_ratio: is zero; write the value, negative where the motor turns the other way",
    ),
    "mimic unknown": (
        ["joints", 1, "mimic"],
        {"joint": "x", "multiplier": 1.0, "offset": 0.0},
        "joints.2.mimic.joint: 'x' is no joint that moves on its own; name one that does",
    ),
    "mimic itself": (
        ["joints", 1, "mimic"],
        {"joint": "elbow", "multiplier": 1.0, "offset": 0.0},
        "joints.2.mimic.joint: 'elbow' is no joint that moves on its own; name one that does",
    ),
    "mimic key": (
        ["joints", 1, "mimic"],
        {"joint": "shoulder", "multiplier": 1.0},
        "joints.2.mimic.offset: is missing; add it",
    ),
    "joint twice": (
        ["joints", 1, "name"],
        "shoulder",
        "joints.2.name: a second joint is called 'shoulder'; rename one",
    ),
    "joint missing": (["joints"], [], "joints: 4 links and 0 joints; write one joint for each link, at least one"),
    "frames list": (["frames"], [], "frames: [] is no mapping; write frames by name"),
    "frame link": (
        ["frames", "tool", "link"],
        4,
        (
            "frames.tool.link: 4 is no index of a link that stands before (-1 to 3); write the index, from "
            "0, or -1 for the base"
        ),
    ),
    "frame name": (
        ["frames", "a\n"],
        {},
        "frames: a frame name 'a\\n' has characters that cannot be printed; use plain letters",
    ),
    "tool": (["tool"], "gripper", "tool: no frame is called 'gripper'; name one of 'frames', or nothing"),
    "coupling": (["coupling"], [[1.0]], "coupling: 4 rows are needed, not a list of 1; write 4 lists of 4 numbers"),
    "coupling huge": (["coupling", 1, 0], 1e7, "coupling: an entry is 1e+07; write ratios of up to 1e+06"),
    "coupling singular": (
        ["coupling"],
        [[0.0] * 4] * 4,
        "coupling: the coupling matrix is singular; write motor speed = coupling @ joint speed",
    ),
    "gravity": (["gravity"], None, "gravity: is missing; add it"),
}
TEXTS: dict[str, tuple[bytes, str]] = {
    "not JSON": (b'{"a": }', "line 1: not JSON (Expecting value); give a robot that dynident has written"),
    "NaN": (b'{"a": NaN}', "NaN is no number in JSON; write null for a limit that is not known"),
    "twice": (b'{"a": 1, "a": 2}', "the key 'a' is there twice; keep one of the two"),
    "list": (b"[]", "a mapping (key: value) is needed, not a list of 0; write 'key: value' lines"),
    "deep": (b"[" * 100_000, "not JSON (nested too deep); give a robot that dynident has written"),
    "digits": (
        b'{"a": ' + b"1" * 10_000 + b"}",
        "not JSON (a number of too many digits); give a robot that dynident has written",
    ),
    "not text": (b'{"a": "\xff"}', "not JSON (not UTF-8 text); give a robot that dynident has written"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_message(fault: str) -> None:
    data = copy.deepcopy(robot_to_dict(read_robot("generic-scara")))
    path, value, message = FAULTS[fault]
    inner: Any = data
    for key in path[:-1]:
        inner = inner[key]
    if value is MISSING:
        del inner[path[-1]]
    else:
        inner[path[-1]] = value
    with pytest.raises(DescriptionError) as caught:
        robot_from_dict(data, "arm.json")
    assert str(caught.value) == f"arm.json: {message}"


@pytest.mark.parametrize("fault", TEXTS)
def test_message_of_json(fault: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    text, message = TEXTS[fault]
    Path("bad.json").write_bytes(text)
    with pytest.raises(DescriptionError) as caught:
        read_robot("bad.json")
    assert str(caught.value) == f"bad.json: {message}"
