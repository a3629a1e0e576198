"""The bytes of a URDF: that of the user with other inertias and joint friction, every other byte kept, or a new one."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from xml.sax.saxutils import quoteattr

import numpy as np

from dynident.arrays import Array, vector_text
from dynident.errors import BadOption
from dynident.exports.models.subject.drives import Drives
from dynident.exports.models.subject.identified import Identified
from dynident.exports.models.subject.source import OwnDescription, anew_note
from dynident.exports.models.writing.placement import Placement, Shares, kept_notes, place, shared
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
    removed,
    roll_pitch_yaw,
    unused_name,
    with_attributes,
)
from dynident.model.inertia import Inertia
from dynident.model.joint import Joint
from dynident.model.robot import STANDARD_GRAVITY, Robot
from dynident.model.shapes import Box, Capsule, Cylinder, Shape, Sphere
from dynident.robot_files.formats.urdf import read_urdf_bodies
from dynident.robot_files.tree import some

#: A link between two joints of one body: twice the least mass in kg and moment in kg m^2 of a URDF that MuJoCo takes.
LEAST_MASS, LEAST_MOMENT = 2e-15, 2e-14


def written_urdf(subject: Identified, drives: Drives, lump: bool) -> tuple[bytes, tuple[str, ...]]:
    """Return a URDF of a model and what the reader has to know about it.

    Raises:
        DescriptionError: The user's URDF is of another robot.
        BadOption: A name that XML cannot have.
    """
    source = subject.source
    if source is not None and source.is_urdf:
        found = patched(subject, drives, source, lump)
        return found.data, (*([source.note] if source.note else []), *gravity_note(subject, "a URDF"), *found.notes)
    other = "the robot model is no URDF: the URDF is new, without meshes"
    note = anew_note(subject.source, subject.estimate, "URDF") or (other,)
    return new_urdf(subject, drives), (*note, *gravity_note(subject, "a URDF"), *between_note(subject, "URDF"))


def gravity_note(subject: Identified, noun: str) -> list[str]:
    """Return what is to be said where gravity is another than readers of a format take, which does not state it."""
    gravity = subject.model.robot.gravity
    if np.array_equal(gravity, STANDARD_GRAVITY):
        return []
    return [f"gravity is ({vector_text(gravity)}) m/s², which {noun} cannot say: set it where it is loaded"]


def between_note(subject: Identified, noun: str) -> list[str]:
    """Return what is to be said about links between two joints of one body in a format that has none of these."""
    links = [subject.model.robot.links[i].name for i in sorted(subject.between)]
    if not links:
        return []
    told = f"of next to no mass, between joints of one body, for which {noun} has no other way"
    return [f"{some(links)}: {told}; MuJoCo and Pinocchio take such links, other simulators may want more mass"]


@dataclass(frozen=True)
class Patched:
    """The URDF of a user with a model in it.

    Attributes:
        data: Its bytes.
        placement: Its links on those of the model.
        notes: What the reader has to know.
    """

    data: bytes
    placement: Placement
    notes: tuple[str, ...]


def patched(subject: Identified, drives: Drives, source: OwnDescription, lump: bool) -> Patched:
    """Return the URDF with the inertias and joint friction of a model.

    Raises:
        DescriptionError: It is faulty, in UTF-16, or of another robot.
    """
    edits, placement, shares = _body_edits(source.path, source.data, subject.model.robot, subject.bodies, lump)
    root = elements(source.path, source.data)
    tags = joint_tags(subject, drives)
    for joint in root.all("joint"):
        if joint.attributes["name"] in tags:
            edits += _dynamics(source.data, joint, *tags[joint.attributes["name"]])
    left = [name for name in subject.model.robot.joint_names if name not in tags]
    notes = kept_notes(shares, placement, left)
    return Patched(apply(source.data, edits), placement, tuple(notes))


def urdf_with_bodies(path: object, data: bytes, robot: Robot, bodies: Sequence[Inertia]) -> bytes:
    """Return a URDF with other inertias, every other byte as it was.

    Args:
        path: The file.
        data: Its bytes.
        robot: The robot that was identified.
        bodies: Inertia of each of its links, about its frame.

    Raises:
        DescriptionError: It is faulty, in UTF-16, or of another robot.
    """
    return apply(data, _body_edits(path, data, robot, bodies, lump=False)[0])


def _body_edits(
    path: object, data: bytes, robot: Robot, bodies: Sequence[Inertia], lump: bool
) -> tuple[list[ByteEdit], Placement, Shares]:
    """Return the edits that give the links of a URDF other inertias, where they stand, and what each gets."""
    placement = place(path, robot, *read_urdf_bodies(path, data))
    shares, edits = shared(robot, bodies, placement, lump), list[ByteEdit]()
    for link in elements(path, data).all("link"):
        name = link.attributes["name"]
        if name in shares.inertias:
            edits += _inertial(data, link, shares.inertias[name])
    return edits, placement, shares


def joint_tags(subject: Identified, drives: Drives) -> Mapping[str, tuple[float, float]]:
    """Return damping and Coulomb friction of each joint that the model says something about; 0 for followers."""
    _, damping, dry = drives.at_joints()
    known = np.any((drives.coupling != 0) & drives.has_friction[:, None], axis=0)
    tags = {name: (float(damping[j]), float(dry[j])) for j, name in enumerate(drives.joints) if known[j]}
    for joint in subject.model.robot.joints:
        if joint.mimic is not None and joint.mimic.joint in tags:
            tags[joint.name] = (0.0, 0.0)  # the leader's friction is that of both
    return tags


def inertia_tags(body: Inertia) -> tuple[str, str, str]:
    """Return the elements origin, mass and inertia of a body: ``rpy="0 0 0"``, so that every reader agrees."""
    tensor = body.about_centre
    names = (("ixx", 0, 0), ("ixy", 0, 1), ("ixz", 0, 2), ("iyy", 1, 1), ("iyz", 1, 2), ("izz", 2, 2))
    entries = " ".join(f'{name}="{number(tensor[i, j])}"' for name, i, j in names)
    return (
        f'<origin xyz="{numbers(np.asarray(body.centre_of_mass))}" rpy="0 0 0"/>',
        f'<mass value="{number(body.mass)}"/>',
        f"<inertia {entries}/>",
    )


def _inertial(data: bytes, link: PlacedElement, body: Inertia | None) -> Iterator[ByteEdit]:
    """Yield the edits that give a link another inertia, or none."""
    found = link.all("inertial")
    if body is None:
        yield from (removed(data, element) for element in found)
        return
    origin, mass, tensor = (text.encode("ascii") for text in inertia_tags(body))
    if not found:
        yield added_child(data, link, b"<inertial>" + origin + mass + tensor + b"</inertial>")
        return
    element = found[0]
    origins = element.all("origin")
    masses = element.all("mass")[0]
    tensors = element.all("inertia")[0]
    if origins:
        yield ByteEdit(origins[0].start, origins[0].end, origin)
        yield from (removed(data, other) for other in origins[1:])
    else:
        first = min(masses.start, tensors.start)
        yield ByteEdit(first, first, origin + indent_of(data, first))
    yield ByteEdit(masses.start, masses.end, mass)
    yield ByteEdit(tensors.start, tensors.end, tensor)


def _dynamics(data: bytes, joint: PlacedElement, damping: float, dry: float) -> Iterator[ByteEdit]:
    """Yield the edit that sets damping and friction of a joint; none where both are 0 and nothing is stated."""
    values = {"damping": number(damping), "friction": number(dry)}
    found = joint.all("dynamics")
    if found:
        stated = found[0].attributes
        wanted = {k: v for k, v in values.items() if k in stated or float(v) != 0.0}
        changed = {k: v for k, v in wanted.items() if k not in stated or float(stated[k]) != float(v)}
        if changed:
            yield with_attributes(data, found[0], changed)
    elif damping or dry:
        text = " ".join(f'{name}="{value}"' for name, value in values.items())
        yield added_child(data, joint, f"<dynamics {text}/>".encode("ascii"))


def new_urdf(subject: Identified, drives: Drives) -> bytes:
    """Return the URDF of a model, written anew; meshes are left out.

    Raises:
        BadOption: A name that XML cannot have, or two links of one name.
    """
    robot = subject.model.robot
    links = checked_names("link", [robot.base, *(link.name for link in robot.links)])
    checked_names("joint", [joint.name for joint in robot.joints])
    checked_names("robot", [robot.name])
    for name in (robot.name, *links, *robot.frames, *(joint.name for joint in robot.joints)):
        if "${" in name or "$(" in name:
            raise BadOption("name", name, "xacro would take it for an expression; rename it in the robot model")
    lines = ['<?xml version="1.0" encoding="utf-8"?>', f"<robot name={quoteattr(robot.name)}>"]
    lines += [f"  <link name={quoteattr(robot.base)}>", *_shapes(robot.base_shapes), "  </link>"]
    tags = joint_tags(subject, drives)
    for i, (link, joint) in enumerate(zip(robot.links, robot.joints, strict=True)):
        lines += [f"  <link name={quoteattr(link.name)}>", "    <inertial>"]
        body = subject.bodies[i]
        if i in subject.between:
            lines += ["      <!-- next to no mass: it only carries the next joint -->"]
            mass, tensor = max(body.mass, LEAST_MASS), body.about_centre + LEAST_MOMENT * np.eye(3)
            body = Inertia.from_centre_of_mass(mass, body.centre_of_mass, tensor)
        lines += [f"      {tag}" for tag in inertia_tags(body)]
        lines += ["    </inertial>", *_shapes(link.shapes), "  </link>"]
        lines += _joint(robot, joint, links[joint.parent + 1], links[i + 1], tags.get(joint.name, (0.0, 0.0)))
    lines += _frames(robot, links)
    return ("\n".join([*lines, "</robot>"]) + "\n").encode("utf-8")


def _joint(robot: Robot, joint: Joint, parent: str, child: str, tags: tuple[float, float]) -> Iterator[str]:
    limits = joint.limits
    bounded = np.isfinite([limits.lower, limits.upper]).all()
    kind = joint.kind if bounded or joint.kind == "prismatic" else "continuous"
    yield f'  <joint name={quoteattr(joint.name)} type="{kind}">'
    yield f"    {_origin(joint.rotation, joint.translation)}"
    yield f"    <parent link={quoteattr(parent)}/>"
    yield f"    <child link={quoteattr(child)}/>"
    yield f'    <axis xyz="{numbers(joint.axis)}"/>'
    lower, upper = (v if np.isfinite(v) else np.sign(v) * 1e9 for v in (limits.lower, limits.upper))
    position = "" if kind == "continuous" else f'lower="{number(lower)}" upper="{number(upper)}" '
    effort, velocity = (v if np.isfinite(v) else 1e9 for v in (limits.effort, limits.velocity))
    yield f'    <limit {position}effort="{number(effort)}" velocity="{number(velocity)}"/>'
    if any(tags):
        yield f'    <dynamics damping="{number(tags[0])}" friction="{number(tags[1])}"/>'
    if joint.mimic is not None:
        ratio, offset = number(joint.mimic.multiplier), number(joint.mimic.offset)
        yield f'    <mimic joint={quoteattr(joint.mimic.joint)} multiplier="{ratio}" offset="{offset}"/>'
    yield "  </joint>"


def _frames(robot: Robot, links: Sequence[str]) -> Iterator[str]:
    """Yield a massless link and a fixed joint for each named frame."""
    taken = {*links}
    joints = {joint.name for joint in robot.joints}
    for name, frame in robot.frames.items():
        if name in taken:
            continue
        checked_names("frame", [name])
        taken.add(name)
        joint = unused_name(f"{name}_fixed", joints)
        joints.add(joint)
        yield f"  <link name={quoteattr(name)}/>"
        yield f'  <joint name={quoteattr(joint)} type="fixed">'
        yield f"    {_origin(frame.rotation, frame.translation)}"
        yield f"    <parent link={quoteattr(links[frame.link + 1])}/>"
        yield f"    <child link={quoteattr(name)}/>"
        yield "  </joint>"


def _origin(rotation: Array, translation: Array) -> str:
    return f'<origin xyz="{numbers(translation)}" rpy="{numbers(roll_pitch_yaw(rotation))}"/>'


def _shapes(shapes: Sequence[Shape]) -> Iterator[str]:
    """Yield collision elements; a capsule, which few readers of URDF know, as its cylinder and two spheres."""
    for shape in shapes:
        if isinstance(shape, Capsule) and shape.length > 0 and shape.radius > 0:
            middle = Cylinder(shape.radius, shape.length, along(shape), 0.5 * (shape.start + shape.end))
            yield from _shapes([middle, Sphere(shape.radius, shape.start), Sphere(shape.radius, shape.end)])
            continue
        if isinstance(shape, Sphere):
            origin, text = _origin(np.eye(3), shape.centre), f'<sphere radius="{number(shape.radius)}"/>'
        elif isinstance(shape, Box):
            origin, text = _origin(shape.rotation, shape.translation), f'<box size="{numbers(shape.size)}"/>'
        elif isinstance(shape, Cylinder):
            size = f'radius="{number(shape.radius)}" length="{number(shape.length)}"'
            origin, text = _origin(shape.rotation, shape.translation), f"<cylinder {size}/>"
        else:
            continue
        yield f"    <collision>{origin}<geometry>{text}</geometry></collision>"
