"""The user's own SDF with other inertias, joint friction and rotor inertias; every other byte is kept."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from dynident.exports.models.subject.drives import Drives
from dynident.exports.models.subject.identified import Identified
from dynident.exports.models.subject.source import OwnDescription
from dynident.exports.models.writing.placement import Placement, kept_notes, place, shared
from dynident.exports.models.writing.urdf import joint_tags
from dynident.exports.models.writing.xml_edit import (
    ByteEdit,
    PlacedElement,
    added_child,
    apply,
    elements,
    indent_of,
    preorder,
    removed,
)
from dynident.exports.models.writing.xml_text import number, numbers
from dynident.model.inertia import Inertia
from dynident.robot_files.sdf_model import SdfModel, read_sdf_model
from dynident.robot_files.xml_elements import Element

_ENTRIES = (("ixx", 0, 0), ("ixy", 0, 1), ("ixz", 0, 2), ("iyy", 1, 1), ("iyz", 1, 2), ("izz", 2, 2))


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
        edits += _inertial(source.data, placed.of(link.element), own)
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


def _inertial(data: bytes, link: PlacedElement, body: Inertia | None) -> Iterator[ByteEdit]:
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
