"""The workspace of a case file: every key, names that are checked, faults that are named with line and key."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dynident.case.case import read_case
from dynident.errors import BadOption, DescriptionError, FileError
from dynident.excitation.collision.clearance import clearance_of
from dynident.excitation.collision.workspace import HalfSpace, Tool, Workspace
from dynident.model.documents.robot_data import robot_to_dict
from dynident.model.joint import rotation_about
from dynident.model.robot import Frame, Robot
from dynident.model.shapes import Box, Capsule, Mesh

Write = Callable[..., Path]


@pytest.fixture
def write(tmp_path: Path, spatial_3r: Robot) -> Write:
    """Write a case file with a workspace beside a robot of three joints with a flange, and return its path."""
    robot = replace(spatial_3r, frames={"flange": Frame(2, np.eye(3), np.array([0.4, 0.0, 0.0]))})
    (tmp_path / "arm.json").write_text(json.dumps(robot_to_dict(robot)))
    (tmp_path / "meshes").mkdir()

    def make(*lines: str, locked: str = "null") -> Path:
        path = tmp_path / "case.yaml"
        body = [f"  {line}" for line in lines]
        path.write_text("\n".join(["case: 1", "robot: arm.json", f"locked: {locked}", "workspace:", *body]) + "\n")
        return path

    return make


def workspace_of(path: Path) -> Workspace:
    workspace = read_case(path).workspace
    assert workspace is not None
    return workspace


def test_a_case_without_the_key_has_no_workspace(write: Write) -> None:
    assert read_case(write()).workspace is None  # a key without a value


def test_every_key(write: Write, tmp_path: Path) -> None:
    workspace = workspace_of(
        write(
            "floor: -0.1",
            "half_spaces: {wall: {normal: [0, -2, 0], offset: -0.7}}",
            "boxes:",
            "  table: {min: [0, 0, 0], max: [1, 2, 3]}",
            "  rack: {min: [-1, -1, -1], max: [1, 1, 1], xyz: [5, 0, 0], rpy: [0, 0, pi/2]}",
            "region: {min: [-1, -1, 0], max: [1, 1, 2]}",
            "tool: {link: flange, offset: [0, 0, 0.1], radius: 0.04}",
            "tool_speed: 0.5",
            "clearance: {self: 0.01, environment: 0.1}",
            "ignore: [[link1, link3], [flange, table], [base, floor]]",
            "joint_radius: 0.07",
            "shapes:",
            "  link2: [{start: [0, 0, 0], end: [0.5, 0, 0], radius: 0.06}]",
            "  flange: [{start: [0, 0, 0.1], radius: 0.05}]",
            "  link1: null",
            "mesh_folders: meshes",
        )
    )
    assert workspace.half_spaces["floor"].normal.tolist() == [0, 0, 1]
    assert workspace.half_spaces["floor"].offset == -0.1
    assert workspace.half_spaces["wall"].normal.tolist() == [0, -1, 0]
    assert workspace.boxes["table"].size.tolist() == [1, 2, 3]
    assert workspace.boxes["table"].translation.tolist() == [0.5, 1, 1.5]
    assert workspace.boxes["rack"].rotation == pytest.approx(rotation_about(np.array([0.0, 0.0, 1.0]), np.pi / 2))
    assert workspace.boxes["rack"].translation.tolist() == [5, 0, 0]
    assert workspace.region is not None and workspace.region.size.tolist() == [2, 2, 2]
    assert workspace.tool is not None
    assert (workspace.tool.link, workspace.tool.offset.tolist(), workspace.tool.radius) == ("flange", [0, 0, 0.1], 0.04)
    assert (workspace.tool_speed, workspace.self_clearance, workspace.clearance) == (0.5, 0.01, 0.1)
    assert workspace.ignore == (("link1", "link3"), ("flange", "table"), ("base", "floor"))
    assert workspace.joint_radius == 0.07
    assert workspace.shapes["link2"][0].end.tolist() == [0.5, 0, 0]
    assert workspace.shapes["flange"][0].length == 0 and workspace.shapes["link1"] == ()
    assert workspace.mesh_folders == (str(tmp_path), str(tmp_path / "meshes"))


def test_the_defaults(write: Write) -> None:
    workspace = workspace_of(write("joint_radius: 0.05"))
    assert (workspace.self_clearance, workspace.clearance, workspace.tool_speed) == (0.02, 0.05, np.inf)
    assert not workspace.obstacles and workspace.region is None and workspace.tool is None


def test_what_is_read_is_what_is_checked(write: Write) -> None:
    """The pair of a frame that is ignored is that of the link that carries it."""
    case = read_case(write("floor: 0.1", "joint_radius: 0.05", "ignore: [[flange, floor]]"))
    assert case.workspace is not None
    clearance = clearance_of(case.robot, case.workspace)
    assert clearance.ignored["link3 | floor"] == "listed under ignore"
    assert "link2 | floor" in clearance.names


def test_names_of_locked_links_are_known_and_stand_for_what_carries_them(write: Write) -> None:
    case = read_case(write("floor: -1", "joint_radius: 0.05", "tool: {link: link3}", locked="{joint3: 0.5}"))
    assert case.workspace is not None
    assert case.workspace.tool_frame(case.robot).link == 1
    assert set(clearance_of(case.robot, case.workspace).capsules) == {"base", "link1", "link2"}


FAULTS = {
    "unknown key": (["flor: 0"], "line 5, workspace: unknown key 'flor'; known keys: floor, .*did you mean 'floor'"),
    "floor": (["floor: low"], "line 5, workspace.floor: 'low' is not a number"),
    "no mapping": (["boxes: [1]"], r"workspace.boxes: a mapping \(name: ...\) is needed"),
    "normal": (
        ["half_spaces: {wall: {normal: [0, 0, 0], offset: 0}}"],
        r"workspace.half_spaces.wall: normal = \[0.0, 0.0, 0.0\] is not possible; give a direction",
    ),
    "no offset": (["half_spaces: {wall: {normal: [0, 0, 1]}}"], "workspace.half_spaces.wall.offset: is missing"),
    "floor twice": (
        ["floor: 0", "half_spaces: {floor: {normal: [0, 0, 1], offset: 0}}"],
        "half_spaces.floor: the floor has that name",
    ),
    "name twice": (["floor: 0", "boxes: {floor: {min: [0, 0, 0], max: [1, 1, 1]}}"], "the half-spaces have that name"),
    "corners": (
        ["boxes: {a: {min: [0, 0, 0], max: [1, 0, 1]}}"],
        r"workspace.boxes.a: min \[0.0, 0.0, 0.0\] is not below max \[1.0, 0.0, 1.0\]; write two opposite corners",
    ),
    "corner": (["region: {min: [0, 0, 0]}"], "workspace.region.max: is missing"),
    "box key": (["boxes: {a: {mni: [0, 0, 0]}}"], "unknown key 'mni'; known keys: min, max, .*did you mean 'min'"),
    "tool": (["tool: {link: flang}"], "workspace.tool.link: no link or frame called 'flang'.*did you mean 'flange'"),
    "radius": (["tool: {radius: -1}"], "workspace.tool.radius: -1 is negative"),
    "speed": (["tool_speed: 0"], "workspace: tool_speed = 0.0 is not possible; give a speed in m/s above 0"),
    "clearance": (["clearance: {self: -0.1}"], "workspace.clearance.self: -0.1 is negative"),
    "clearance key": (["clearance: 0.1"], "workspace.clearance: a mapping"),
    "joint radius": (["joint_radius: 0"], "joint_radius = 0.0 is not possible; give a radius in m above 0"),
    "ignored": (
        ["ignore: [[link1, lnik3]]"],
        "line 5, workspace.ignore.1: no link, frame, half-space or box called 'lnik3'; .*did you mean 'link3'",
    ),
    "no pair": (["ignore: [[link1]]"], r"workspace.ignore.1: \['link1'\] is no pair of names; write \[a, b\]"),
    "no list": (["ignore: link1"], "workspace.ignore: 'link1' is no list"),
    "shape": (["shapes: {lnik1: []}"], "workspace.shapes.lnik1: no link or frame called 'lnik1'.*did you mean 'link1'"),
    "shapes": (["shapes: []"], "workspace.shapes: a mapping"),
    "capsule": (["shapes: {link1: [{start: [0, 0, 0]}]}"], "workspace.shapes.link1.1.radius: is missing"),
    "folder": (["mesh_folders: [nowhere]"], "workspace.mesh_folders: no folder .*nowhere"),
    "folders": (["mesh_folders: {a: b}"], "workspace.mesh_folders: neither a text nor a list of texts"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_faults(fault: str, write: Write) -> None:
    lines, message = FAULTS[fault]
    with pytest.raises(DescriptionError, match=message):
        read_case(write(*lines))


def test_meshes_are_looked_for_beneath_the_stated_folders_only(write: Write, tmp_path: Path) -> None:
    """A mesh beside the robot model is read; one above it is not."""
    case = read_case(write("floor: -1"))
    assert case.workspace is not None
    corners = Box(np.array([0.5, 0.1, 0.1])).corners
    lines = [f"vertex {x} {y} {z}" for x, y, z in [*corners, corners[0]]]
    (tmp_path / "meshes" / "arm.stl").write_text("\n".join(["solid a", *lines]))
    (tmp_path.parent / "outside.stl").write_text("\n".join(["solid a", *lines]))
    for file, is_read in (("meshes/arm.stl", True), ("../outside.stl", False)):
        links = tuple(replace(link, shapes=(Mesh(file),)) for link in case.robot.links)
        robot = replace(case.robot, links=links)
        if is_read:
            (capsule,) = clearance_of(robot, case.workspace).capsules["link3"]
            assert np.all(capsule.distances(corners) <= 1e-12)
        else:
            with pytest.raises(FileError, match=r"3 mesh files are not beneath .*: \.\./outside\.stl of link1, "):
                clearance_of(robot, case.workspace)


def test_values_refuse_what_cannot_be() -> None:
    with pytest.raises(BadOption, match="offset = nan"):
        HalfSpace(np.ones(3), np.nan)
    with pytest.raises(BadOption, match="radius = -1"):
        Tool(radius=-1)
    with pytest.raises(BadOption, match="self_clearance = inf"):
        Workspace(self_clearance=np.inf)
    assert Capsule(np.zeros(3), np.ones(3), 0.0).length == pytest.approx(np.sqrt(3))
