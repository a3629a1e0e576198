"""The text of an SDF model, with the elements of Drake for rotor inertia."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from xml.sax.saxutils import escape, quoteattr

import numpy as np

from dynident.arrays import Array
from dynident.errors import BadOption
from dynident.exports.models.subject.drives import Drives
from dynident.exports.models.subject.identified import Identified
from dynident.exports.models.writing.xml_text import along, checked_names, number, numbers, roll_pitch_yaw, unused_name
from dynident.model.inertia import Inertia
from dynident.model.joint import Joint
from dynident.model.robot import Robot
from dynident.model.shapes import Box, Capsule, Cylinder, Shape, Sphere

#: SDF of libsdformat 10 and later: poses relative to named frames (1.7); read unchanged by later ones.
VERSION = "1.7"

_ENTRIES = (("ixx", 0, 0), ("ixy", 0, 1), ("ixz", 0, 2), ("iyy", 1, 1), ("iyz", 1, 2), ("izz", 2, 2))


def sdf_text(subject: Identified, drives: Drives) -> bytes:
    """Return the SDF of a model; the frame of the model is that of its base link.

    Raises:
        BadOption: A name that XML or SDF cannot have, or two links or joints of one name.
    """
    robot = subject.model.robot
    names = checked_names("link", [base_name(robot), *(link.name for link in robot.links)])
    joints = checked_names("joint", [joint.name for joint in robot.joints])
    _check_apart(names, joints)
    checked_names("robot", [robot.name])
    _check_sdf([robot.name, *names, *joints])
    lines = [
        '<?xml version="1.0" encoding="utf-8"?>',
        f'<sdf version="{VERSION}" xmlns:drake="http://drake.mit.edu">',
        f"  <model name={quoteattr(robot.name)}>",
        f"    <link name={quoteattr(names[0])}>",
        *_shapes(robot.base_shapes),
        "    </link>",
    ]
    armature, damping, dry = drives.at_joints()
    for i, (link, joint) in enumerate(zip(robot.links, robot.joints, strict=True)):
        column = robot.joint_names.index(joint.name) if joint.mimic is None else -1
        values = (armature[column], damping[column], dry[column]) if column >= 0 else (0.0, 0.0, 0.0)
        lines += _joint(joint, names[joint.parent + 1], link.name, values)
        lines += [f"    <link name={quoteattr(link.name)}>"]
        lines += [f"      <pose relative_to={quoteattr(joint.name)}>0 0 0 0 0 0</pose>"]
        lines += [*_inertial(subject.bodies[i]), *_shapes(link.shapes), "    </link>"]
    lines += _frames(robot, names)
    return ("\n".join([*lines, "  </model>", "</sdf>"]) + "\n").encode("utf-8")


def base_name(robot: Robot) -> str:
    """Return what the base link is called in SDF, where ``world`` and the names of joints are not free."""
    joints = {joint.name for joint in robot.joints}
    if not _is_reserved(robot.base) and robot.base not in joints:
        return robot.base
    return unused_name("base", {*(link.name for link in robot.links), *joints})


def base_note(subject: Identified) -> list[str]:
    """Return what is to be said where the base link has another name in SDF."""
    own, name = subject.model.robot.base, base_name(subject.model.robot)
    why = "SDF keeps that name for itself" if _is_reserved(own) else "in SDF no link has the name of a joint"
    return [] if name == own else [f"the base link '{own}' is '{name}' here: {why}"]


def _is_reserved(name: str) -> bool:
    return name == "world" or "::" in name or (len(name) > 3 and name.startswith("__") and name.endswith("__"))


def _check_apart(links: Sequence[str], joints: Sequence[str]) -> None:
    """Refuse a link and a joint of one name: both are frames of one room."""
    for name in links:
        if name in joints:
            step = "a link and a joint have this name, which SDF does not allow; rename one in the robot model"
            raise BadOption("link", name, step)


def _check_sdf(names: Sequence[str]) -> None:
    for name in names:
        if _is_reserved(name):
            step = "SDF keeps 'world', names between two '__' and '::' for itself; rename it in the robot model"
            raise BadOption("name", name, step)


def _joint(joint: Joint, parent: str, child: str, values: Sequence[float]) -> Iterator[str]:
    kind = "revolute" if joint.kind == "revolute" else "prismatic"
    yield f'    <joint name={quoteattr(joint.name)} type="{kind}">'
    yield f"      <pose relative_to={quoteattr(parent)}>{_pose(joint.rotation, joint.translation)}</pose>"
    yield f"      <parent>{escape(parent)}</parent>"
    yield f"      <child>{escape(child)}</child>"
    yield f"      <axis><xyz>{numbers(joint.axis)}</xyz>"
    limits = joint.limits
    known = (
        ("lower", limits.lower), ("upper", limits.upper), ("effort", limits.effort), ("velocity", limits.velocity)
    )  # fmt: skip
    bounds = "".join(f"<{name}>{number(value)}</{name}>" for name, value in known if np.isfinite(value))
    yield f"        <limit>{bounds}</limit>" if bounds else "        <limit/>"
    yield f"        <dynamics><damping>{number(values[1])}</damping><friction>{number(values[2])}</friction></dynamics>"
    yield "      </axis>"
    if values[0]:
        yield f"      <drake:rotor_inertia>{number(values[0])}</drake:rotor_inertia>"
        yield "      <drake:gear_ratio>1</drake:gear_ratio>"
    yield "    </joint>"


def _inertial(body: Inertia) -> Iterator[str]:
    tensor = "".join(f"<{name}>{number(body.about_centre[i, j])}</{name}>" for name, i, j in _ENTRIES)
    yield "      <inertial>"
    yield f"        <pose>{numbers(body.centre_of_mass)} 0 0 0</pose>"
    yield f"        <mass>{number(body.mass)}</mass>"
    yield f"        <inertia>{tensor}</inertia>"
    yield "      </inertial>"


def _frames(robot: Robot, names: Sequence[str]) -> Iterator[str]:
    taken = {*names, *(joint.name for joint in robot.joints)}
    for name, frame in robot.frames.items():
        if name not in taken and name.isprintable() and name.strip() and not _is_reserved(name):
            pose = _pose(frame.rotation, frame.translation)
            yield f"    <frame name={quoteattr(name)} attached_to={quoteattr(names[frame.link + 1])}>"
            yield f"      <pose>{pose}</pose>"
            yield "    </frame>"


def _pose(rotation: Array, translation: Array) -> str:
    return f"{numbers(translation)} {numbers(roll_pitch_yaw(rotation))}"


def _shapes(shapes: Sequence[Shape]) -> Iterator[str]:
    for number_, shape in enumerate(shapes, start=1):
        if isinstance(shape, Sphere):
            pose, text = _pose(np.eye(3), shape.centre), f"<sphere><radius>{number(shape.radius)}</radius></sphere>"
        elif isinstance(shape, Box):
            pose = _pose(shape.rotation, shape.translation)
            text = f"<box><size>{numbers(shape.size)}</size></box>"
        elif isinstance(shape, Cylinder):
            pose = _pose(shape.rotation, shape.translation)
            size = f"<radius>{number(shape.radius)}</radius><length>{number(shape.length)}</length>"
            text = f"<cylinder>{size}</cylinder>"
        elif isinstance(shape, Capsule) and shape.length > 0 and shape.radius > 0:
            pose = _pose(along(shape), 0.5 * (shape.start + shape.end))
            size = f"<radius>{number(shape.radius)}</radius><length>{number(shape.length)}</length>"
            text = f"<capsule>{size}</capsule>"
        else:
            continue
        yield f'      <collision name="shape{number_}"><pose>{pose}</pose><geometry>{text}</geometry></collision>'
