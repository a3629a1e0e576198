"""The robot as plain data, exactly: the form in which files of dynident carry it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Any, Final, Literal

import numpy as np

from dynident.errors import DescriptionError
from dynident.file_versions import FileVersions
from dynident.model.documents.numbers import check_name, shown
from dynident.model.documents.sections import LIMITS, Section, read_coupling, read_drive, read_limits
from dynident.model.documents.shape_data import read_rotation, read_shapes, shapes_to_list
from dynident.model.inertia import Inertia
from dynident.model.joint import Drive, Joint, Mimic
from dynident.model.robot import Frame, Link, Robot

SCHEMA: Final = "dynident-robot"
VERSIONS: Final = FileVersions("a robot", key="version")

_ROBOT: Final = (
    "schema", "version", "name", "base", "gravity", "links", "joints", "frames", "tool", "coupling", "note",
    "base_shapes", "held",
)  # fmt: skip
_LINK: Final = ("name", "inertia", "fixed", "shapes", "visuals", "impossible")
_JOINT: Final = (
    "name", "kind", "parent", "rotation", "translation", "axis", "limits", "drive", "mimic", "damping", "friction",
)  # fmt: skip
_DRIVE: Final = tuple(item.name for item in fields(Drive))
_MIMIC: Final = tuple(item.name for item in fields(Mimic))
_FRAME: Final = ("link", "rotation", "translation")


def robot_to_dict(robot: Robot) -> dict[str, Any]:
    """Return the robot as plain data for JSON; :func:`robot_from_dict` gives back the same numbers, bit by bit."""
    return {
        "schema": SCHEMA,
        "version": VERSIONS.current,
        "name": robot.name,
        "base": robot.base,
        "gravity": robot.gravity.tolist(),
        "links": [
            {
                "name": link.name,
                "inertia": None if link.inertia is None else link.inertia.vector.tolist(),
                "fixed": list(link.fixed),
                **({"shapes": shapes_to_list(link.shapes)} if link.shapes else {}),
                **({"visuals": shapes_to_list(link.visuals)} if link.visuals else {}),
                **({"impossible": link.impossible} if link.impossible else {}),
            }
            for link in robot.links
        ],
        "joints": [_joint_to_dict(joint) for joint in robot.joints],
        "frames": {
            name: {"link": frame.link, "rotation": frame.rotation.tolist(), "translation": frame.translation.tolist()}
            for name, frame in robot.frames.items()
        },
        "tool": robot.tool,
        "coupling": np.asarray(robot.coupling).tolist(),
        "note": robot.note,
        **({"base_shapes": shapes_to_list(robot.base_shapes)} if robot.base_shapes else {}),
        **({"held": dict(robot.held)} if robot.held else {}),
    }


def robot_from_dict(data: object, path: object = "robot") -> Robot:
    """Return the robot that :func:`robot_to_dict` has written.

    Args:
        data: The mapping.
        path: The file that carries it, for messages.

    Raises:
        DescriptionError: Another schema or version, or any fault; the message names the key path, items of lists
            counted from 1.
    """
    if isinstance(data, Mapping) and data.get("schema") != SCHEMA:
        key = next((key for key in ("schema", "kind") if key in data), "")
        evidence = f"{key} is {shown(data[key])}, not {shown(SCHEMA)}" if key else "it states no schema"
        step = "give a case, or a robot that dynident has written; validate, predict, report and export read estimates"
        raise DescriptionError(path, "", evidence, step)
    if isinstance(data, Mapping):
        data = VERSIONS.migrated(data, lambda evidence, step: DescriptionError(path, "", evidence, step))
    top = Section.top(path, data, _ROBOT)
    links = tuple(_link(section) for section in top.sections("links", _LINK))
    sections = top.sections("joints", _JOINT)
    if len(sections) != len(links) or not links:
        evidence = f"{len(links)} links and {len(sections)} joints"
        raise top.place("joints").error(evidence, "write one joint for each link, at least one")
    joints = tuple(_joint(section, i) for i, section in enumerate(sections))
    _check_names(top, joints)
    dof = sum(joint.mimic is None for joint in joints)
    coupling = read_coupling(top, dof)
    frames = _frames(top, len(links))
    tool = top.text("tool", "")
    if tool and tool not in frames:
        raise top.place("tool").error(f"no frame is called {shown(tool)}", "name one of 'frames', or nothing")
    return Robot(
        top.name("name"),
        links,
        joints,
        top.numbers("gravity", 3),
        base=top.name("base"),
        frames=frames,
        tool=tool,
        coupling=coupling,
        note=top.text("note", ""),
        base_shapes=read_shapes(top, "base_shapes"),
        held=_held(top),
    )


def _joint_to_dict(joint: Joint) -> dict[str, Any]:
    limits = {name: getattr(joint.limits, name) for name in LIMITS}
    return {
        "name": joint.name,
        "kind": joint.kind,
        "parent": joint.parent,
        "rotation": joint.rotation.tolist(),
        "translation": joint.translation.tolist(),
        "axis": joint.axis.tolist(),
        "limits": {name: float(value) if np.isfinite(value) else None for name, value in limits.items()},
        "drive": {name: _plain(getattr(joint.drive, name)) for name in _DRIVE},
        "mimic": (own := joint.mimic)
        and {"joint": own.joint, "multiplier": float(own.multiplier), "offset": float(own.offset)},
        "damping": _plain(joint.damping),
        "friction": _plain(joint.friction),
    }


def _plain(value: float | None) -> float | None:
    return None if value is None else float(value)


def _link(section: Section) -> Link:
    inertia = Inertia.from_vector(section.numbers("inertia", 10)) if section.has("inertia") else None
    fixed = section.value("fixed")
    if not isinstance(fixed, list) or not all(isinstance(name, str) for name in fixed):
        raise section.place("fixed").error(f"{shown(fixed)} is no list of names", "write a list of texts")
    shapes, visuals = (read_shapes(section, key) for key in ("shapes", "visuals"))
    return Link(section.name("name"), inertia, tuple(fixed), shapes, visuals, section.text("impossible", ""))


def _joint(section: Section, i: int) -> Joint:
    kind: Literal["revolute", "prismatic"] = (
        "prismatic" if section.choice("kind", ("revolute", "prismatic")) == "prismatic" else "revolute"
    )
    axis = section.numbers("axis", 3)
    if abs(np.linalg.norm(axis) - 1.0) > 1e-9:
        raise section.place("axis").error(f"the axis has length {np.linalg.norm(axis):.4g}", "write a unit vector")
    mimic = None
    if section.has("mimic"):
        inner = section.section("mimic", _MIMIC)
        mimic = Mimic(inner.name("joint"), inner.number("multiplier"), inner.number("offset"))
    return Joint(
        section.name("name"),
        kind,
        _index(section, "parent", i),
        read_rotation(section),
        section.numbers("translation", 3),
        axis,
        read_limits(section.section("limits", LIMITS)),
        read_drive(section.section("drive", _DRIVE)),
        mimic,
        section.number("damping") if section.has("damping") else None,
        section.number("friction") if section.has("friction") else None,
    )


def _index(section: Section, key: str, end: int) -> int:
    """Return the index of a link before ``end``, -1 for the base."""
    value = section.value(key)
    if isinstance(value, bool) or not isinstance(value, int) or not -1 <= value < end:
        evidence = f"{shown(value)} is no index of a link that stands before (-1 to {end - 1})"
        raise section.place(key).error(evidence, "write the index, from 0, or -1 for the base")
    return value


def _held(top: Section) -> dict[str, float]:
    names = top.value("held") if top.has("held") else {}
    if not isinstance(names, Mapping):
        raise top.place("held").error(f"{shown(names)} is no mapping", "write positions by joint")
    inner = top.section("held", tuple(names)) if names else top
    return {name: inner.number(name) for name in names}


def _frames(top: Section, links: int) -> dict[str, Frame]:
    names = top.value("frames")
    if not isinstance(names, Mapping):
        raise top.place("frames").error(f"{shown(names)} is no mapping", "write frames by name")
    inner = top.section("frames", tuple(names))
    found: dict[str, Frame] = {}
    for name in names:
        check_name(top.place("frames"), "a frame name", name)
        frame = inner.section(name, _FRAME)
        found[name] = Frame(_index(frame, "link", links), read_rotation(frame), frame.numbers("translation", 3))
    return found


def _check_names(top: Section, joints: tuple[Joint, ...]) -> None:
    leaders = [joint.name for joint in joints if joint.mimic is None]
    seen: set[str] = set()
    for i, joint in enumerate(joints, start=1):
        if joint.name in seen:
            raise top.place(f"joints.{i}.name").error(f"a second joint is called {shown(joint.name)}", "rename one")
        seen.add(joint.name)
        if joint.mimic is not None and joint.mimic.joint not in leaders:
            evidence = f"{shown(joint.mimic.joint)} is no joint that moves on its own"
            raise top.place(f"joints.{i}.mimic.joint").error(evidence, "name one that does")
