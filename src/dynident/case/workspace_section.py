"""The keys ``limits`` and ``workspace`` of a case file, what a motion must keep; docs/case-file.md describes them."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from dynident.case.case_values import guarded
from dynident.excitation.collision.workspace import (
    CLEARANCE,
    SELF_CLEARANCE,
    HalfSpace,
    Tool,
    Workspace,
    body_of,
    frame_of,
)
from dynident.files import expanded
from dynident.model.documents.numbers import check_name, shown
from dynident.model.documents.sections import Section
from dynident.model.robot import Robot
from dynident.model.shapes import Box, Capsule
from dynident.robot_files.meshes import mesh_places
from dynident.robot_files.rotations import rotation_from_rpy

KEYS = (
    "floor",
    "half_spaces",
    "boxes",
    "region",
    "tool",
    "tool_speed",
    "clearance",
    "ignore",
    "joint_radius",
    "shapes",
)
KEYS += ("mesh_folders",)

#: The bounds of a joint, by the names they have in the model.
QUANTITIES = ("lower", "upper", "velocity", "acceleration", "jerk", "effort", "effort_rate")
_HALF_SPACE = ("normal", "offset")
_BOX = ("min", "max", "xyz", "rpy")
_TOOL = ("link", "offset", "radius")
_CLEARANCE = ("self", "environment")
_CAPSULE = ("start", "end", "radius")


def read_workspace(top: Section, robot: Robot, robot_path: str) -> Workspace | None:
    """Return the workspace of a case file; None where it states none.

    Mesh files are looked for beneath the folder of the robot model, those under ``mesh_folders``, and the ROS packages
    that the robot model names.

    Args:
        top: The whole case.
        robot: The robot, its locked joints locked; names are checked against it.
        robot_path: Its robot model.

    Raises:
        DescriptionError: A fault in the section, with its key.
    """
    if not top.has("workspace"):
        return None
    section = top.section("workspace", KEYS)
    half_spaces = (
        {"floor": HalfSpace(np.array([0.0, 0.0, 1.0]), section.number("floor"))} if section.has("floor") else {}
    )
    for name, own in _named(section, "half_spaces", _HALF_SPACE).items():
        if name in half_spaces:
            raise own.place().error("the floor has that name", "give the half-space another one")
        half_spaces[name] = guarded(
            own.place(), lambda own=own: HalfSpace(own.numbers("normal", 3), own.number("offset"))
        )
    boxes = {name: _box(own) for name, own in _named(section, "boxes", _BOX).items()}
    distances = section.section("clearance", _CLEARANCE)
    found = guarded(
        section.place(),
        lambda: Workspace(
            half_spaces,
            boxes,
            _box(section.section("region", _BOX)) if section.has("region") else None,
            _tool(section.section("tool", _TOOL), robot) if section.has("tool") else None,
            distances.at_least_zero("self", SELF_CLEARANCE),
            distances.at_least_zero("environment", CLEARANCE),
            _pairs(section),
            section.number("joint_radius") if section.has("joint_radius") else None,
            _shapes(section, robot),
            section.number("tool_speed", np.inf, unbounded=True),
            _folders(section, str(top.path), robot, robot_path),
        ),
    )
    for i, pair in enumerate(found.ignore, start=1):
        for name in pair:
            guarded(section.place(f"ignore.{i}"), lambda name=name: body_of(robot, found, name))
    return found


def _named(section: Section, key: str, keys: tuple[str, ...]) -> dict[str, Section]:
    """Return the mappings under the names that stand under a key."""
    if not section.has(key):
        return {}
    values = section.value(key)
    if not isinstance(values, Mapping):
        raise section.place(key).error("a mapping (name: ...) is needed", "write 'name: {...}' lines")
    names = tuple(check_name(section.place(key), "a name", str(name)) for name in values)
    inner = section.section(key, names)
    return {name: inner.section(name, keys) for name in names}


def _box(section: Section) -> Box:
    lower, upper = section.numbers("min", 3), section.numbers("max", 3)
    if not np.all(lower < upper):
        evidence = f"min {lower.tolist()} is not below max {upper.tolist()}"
        raise section.place().error(evidence, "write two opposite corners, each coordinate of min the smaller one")
    rotation = rotation_from_rpy(section.numbers("rpy", 3, (0.0, 0.0, 0.0)))
    return Box.between(lower, upper).moved(rotation, section.numbers("xyz", 3, (0.0, 0.0, 0.0)))


def _tool(section: Section, robot: Robot) -> Tool:
    name = section.text("link", "")
    if name:
        guarded(section.place("link"), lambda: frame_of(robot, name))
    return Tool(name, section.numbers("offset", 3, (0.0, 0.0, 0.0)), section.at_least_zero("radius", 0.0))


def _shapes(section: Section, robot: Robot) -> dict[str, tuple[Capsule, ...]]:
    if not section.has("shapes"):
        return {}
    values = section.value("shapes")
    if not isinstance(values, Mapping):
        raise section.place("shapes").error("a mapping (link: list) is needed", "write capsules by link")
    inner = section.section("shapes", tuple(values))
    found = {}
    for name in values:
        guarded(inner.place(name), lambda name=name: frame_of(robot, name))
        found[name] = tuple(_capsule(item) for item in inner.sections(name, _CAPSULE)) if inner.has(name) else ()
    return found


def _capsule(section: Section) -> Capsule:
    start = section.numbers("start", 3)
    end = section.numbers("end", 3) if section.has("end") else start
    return Capsule(start, end, section.at_least_zero("radius"))


def _pairs(section: Section) -> tuple[tuple[str, str], ...]:
    if not section.has("ignore"):
        return ()
    values = section.value("ignore")
    if not isinstance(values, list):
        raise section.place("ignore").error(f"{shown(values)} is no list", "write a list of pairs [a, b]")
    found = []
    for i, pair in enumerate(values, start=1):
        if not isinstance(pair, list) or len(pair) != 2 or not all(isinstance(name, str) for name in pair):
            raise section.place(f"ignore.{i}").error(f"{shown(pair)} is no pair of names", "write [a, b]")
        found.append((str(pair[0]), str(pair[1])))
    return tuple(found)


def _folders(section: Section, case: str, robot: Robot, robot_path: str) -> tuple[str, ...]:
    """Return the folders of mesh files: that of the robot model, the stated ones, those of ROS packages it names."""
    found = [str(folder) for folder in mesh_places(robot, robot_path)]
    if not section.has("mesh_folders"):
        return tuple(found)
    value = section.value("mesh_folders")
    for name in [value] if isinstance(value, str) else value if isinstance(value, list) else [None]:
        if not isinstance(name, str):
            raise section.place("mesh_folders").error("neither a text nor a list of texts", "write folders")
        folder = Path(case).parent / expanded(name)
        if not os.path.isdir(folder):
            raise section.place("mesh_folders").error(f"no folder {folder}", "write it beside the case file")
        found.append(str(folder))
    return tuple(found)


def robot_with_limits(top: Section, robot: Robot, moving: Sequence[str]) -> Robot:
    """Return the robot with the bounds that the case states: a number, numbers by name, or one per joint.

    Args:
        top: The whole case.
        robot: With all its joints.
        moving: Those that are not locked; a list may be of these alone.

    Raises:
        DescriptionError: A key that is no bound, another number of numbers than joints, or a bound that cannot be.
    """
    section = top.section("limits", QUANTITIES)
    names = robot.joint_names
    stated = {quantity: _bounds(section, quantity, names, moving) for quantity in QUANTITIES if section.has(quantity)}

    def bounded() -> Robot:
        joints = []
        for joint in robot.joints:
            if joint.name in names:
                own = {quantity: values[joint.name] for quantity, values in stated.items() if joint.name in values}
                joint = replace(joint, limits=replace(joint.limits, **own))  # noqa: PLW2901 - the one that is kept
            joints.append(joint)
        return replace(robot, joints=tuple(joints))

    return guarded(section.place(), bounded)


def _bounds(section: Section, quantity: str, names: Sequence[str], moving: Sequence[str]) -> dict[str, float]:
    """Return a bound by joint."""
    value = section.value(quantity)
    if isinstance(value, Mapping):
        own = section.section(quantity, tuple(names))
        return {name: own.number(name) for name in names if own.has(name)}
    if not isinstance(value, list):
        return dict.fromkeys(names, section.number(quantity))
    if len(value) not in (len(names), len(moving)):
        joints = f"{len(names)} joints{f', {len(moving)} of them not locked' if len(moving) < len(names) else ''}"
        counts = " or ".join(map(str, sorted({len(names), len(moving)})))
        step = f"write {counts} numbers in the order of the chain, or numbers by name: {{{names[0]}: ...}}"
        raise section.place(quantity).error(f"a list of {len(value)} for a robot of {joints}", step)
    owners = names if len(value) == len(names) else moving
    return dict(zip(owners, section.numbers(quantity, len(value)).tolist(), strict=True))
