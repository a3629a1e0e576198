"""SDF: a new one of a model, and the user's own with other inertias and friction, every other byte kept."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from xml.sax.saxutils import escape, quoteattr

import numpy as np

from dynident.arrays import Array
from dynident.errors import BadOption
from dynident.exports.models.subject.drives import Drives
from dynident.exports.models.subject.identified import Identified
from dynident.exports.models.subject.source import OwnDescription
from dynident.exports.models.writing.placement import Placement, kept_notes, place, shared
from dynident.exports.models.writing.urdf import joint_tags
from dynident.exports.models.writing.xml_edit import (
    ByteEdit,
    PlacedElement,
    added_child,
    along,
    apply,
    checked_names,
    elements,
    indent_of,
    number,
    numbers,
    preorder,
    removed,
    roll_pitch_yaw,
    unused_name,
)
from dynident.model.inertia import Inertia
from dynident.model.joint import Joint
from dynident.model.robot import Robot
from dynident.model.shapes import Box, Capsule, Cylinder, Shape, Sphere
from dynident.robot_files.sdf_model import SdfModel, read_sdf_model
from dynident.robot_files.xml_elements import Element

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


@dataclass(frozen=True)
class PatchedSdf:
    """The SDF of a user with a model in it.

    Attributes:
        data: Its bytes.
        before: What the user's file says.
        placement: Its links on those of the model.
        tags: Damping and Coulomb friction that were set, by joint.
        rotors: Reflected rotor inertia by joint, in kg m^2 or kg.
        notes: What the reader has to know.
    """

    data: bytes
    before: SdfModel
    placement: Placement
    tags: dict[str, tuple[float, float]]
    rotors: dict[str, float]
    notes: tuple[str, ...]


def patched_sdf(subject: Identified, drives: Drives, source: OwnDescription, lump: bool) -> PatchedSdf:
    """Return the SDF with the inertias and joint friction of a model; rotor inertias by Drake's own elements.

    Raises:
        DescriptionError: It is faulty, in UTF-16, of another robot, or what changes is in a file that it includes.
    """
    before = read_sdf_model(source.path, source.data)
    placement = place(source.path, subject.model.robot, before.bodies, before.connections)
    shares = shared(subject.model.robot, subject.bodies, placement, lump)
    placed = _Own(source)
    edits: list[ByteEdit] = []
    for name, body in shares.inertias.items():
        link = before.links[name]
        own = None if body is None else body.moved(np.eye(3), -link.origin)
        edits += _inertial_edits(source.data, placed.of(link.element), own)
    tags = dict(joint_tags(subject, drives))
    for joint in before.connections:
        if joint.name in tags and (joint.damping or 0.0, joint.friction or 0.0) != tags[joint.name]:
            edits.append(_dynamics(source.data, placed.of(before.joints[joint.name]), tags[joint.name]))
    rotors = dict(zip(drives.joints, map(float, drives.at_joints()[0]), strict=True))
    notes = kept_notes(shares, placement, [name for name in subject.model.robot.joint_names if name not in tags])
    for joint in before.connections:
        rotor = rotors.get(joint.name, 0.0)
        if not np.isclose(rotor, joint.drive.reflected_inertia, rtol=1e-14, atol=0.0):
            element = placed.of(before.joints[joint.name])
            edits.append(_rotor(source.data, element, rotor / joint.drive.gear_ratio**2))
            notes += [_PASSED_OVER] if _PASSED_OVER not in notes else []
    return PatchedSdf(apply(source.data, edits), before, placement, tags, rotors, tuple(notes))


class _Own:
    """The elements of the user's file by those that were read."""

    def __init__(self, source: OwnDescription) -> None:
        self._path = str(source.path)
        self._placed = list(preorder(elements(source.path, source.data)))

    def of(self, element: Element) -> PlacedElement:
        """Return where an element stands."""
        if str(element.path) != self._path:
            whole = f"expand the includes (gz sdf -p {self._path} > whole.sdf) and export with --description whole.sdf"
            step = f"export with --description {element.path}, where the robot is in that file alone, else {whole}"
            raise element.place.error("what was identified of it would change an included file", step)
        return self._placed[element.number]


def _inertial_edits(data: bytes, link: PlacedElement, body: Inertia | None) -> Iterator[ByteEdit]:
    """Yield the edits that give a link another inertia, or none."""
    found = link.all("inertial")
    if body is None:
        yield from (removed(data, element) for element in found)
        return
    moments = {tag: f"<{tag}>{number(body.about_centre[i, j])}</{tag}>".encode("ascii") for tag, i, j in _ENTRIES}
    parts = {
        "pose": f"<pose>{numbers(np.asarray(body.centre_of_mass))} 0 0 0</pose>".encode("ascii"),
        "mass": f"<mass>{number(body.mass)}</mass>".encode("ascii"),
        "inertia": b"<inertia>" + b"".join(moments.values()) + b"</inertia>",
    }
    if not found:
        yield added_child(data, link, b"<inertial>" + b"".join(parts.values()) + b"</inertial>")
        return
    if not found[0].children:
        whole = b"<inertial>" + b"".join(parts.values()) + b"</inertial>"
        yield ByteEdit(found[0].start, found[0].end, whole)
        return
    for holder in found[0].all("inertia"):
        del parts["inertia"]
        yield from _children(data, holder, moments)
    for tag, text in parts.items():
        given = found[0].all(tag)
        if given:
            yield ByteEdit(given[0].start, given[0].end, text)
        else:
            first = found[0].children[0].start
            yield ByteEdit(first, first, text + indent_of(data, first))


def _children(data: bytes, holder: PlacedElement, texts: dict[str, bytes]) -> Iterator[ByteEdit]:
    """Yield the edits that set children of an element; what stands between them is kept."""
    for tag, text in texts.items():
        given = holder.all(tag)
        yield ByteEdit(given[0].start, given[0].end, text) if given else added_child(data, holder, text)


def _dynamics(data: bytes, joint: PlacedElement, tags: tuple[float, float]) -> ByteEdit:
    """Return the edit that sets damping and friction of a joint; other elements of ``<dynamics>`` stay."""
    texts = {tag: f"<{tag}>{number(value)}</{tag}>".encode("ascii") for tag, value in zip(_TAGS, tags, strict=True)}
    axis = joint.all("axis")[0]
    found = axis.all("dynamics")
    if not found:
        return added_child(data, axis, b"<dynamics>" + b"".join(texts.values()) + b"</dynamics>")
    element = found[0]
    if element.is_empty:
        return ByteEdit(element.start, element.end, b"<dynamics>" + b"".join(texts.values()) + b"</dynamics>")
    inner = [
        ByteEdit(child.start - element.start, child.end - element.start, texts.pop(child.tag))
        for child in element.children
        if child.tag in texts
    ]
    end = element.close - element.start
    inner.append(ByteEdit(end, end, b"".join(texts.values())))
    return ByteEdit(element.start, element.end, apply(data[element.start : element.end], inner))


def _rotor(data: bytes, joint: PlacedElement, rotor: float) -> ByteEdit:
    """Return the edit that sets the rotor inertia of a joint before its gear; a gear ratio stays."""
    text = f"<{_ROTOR}>{number(rotor)}</{_ROTOR}>".encode("ascii")
    found = joint.all(_ROTOR)
    return ByteEdit(found[0].start, found[0].end, text) if found else added_child(data, joint, text)


_TAGS = ("damping", "friction")
_ROTOR = "drake:rotor_inertia"
_PASSED_OVER = "rotor inertias are in Drake's own elements, which Gazebo passes over"
