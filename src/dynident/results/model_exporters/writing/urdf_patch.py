"""A model written into the URDF of the user: inertias, damping and friction change, every other byte stays."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from dynident.model.descriptions.urdf import read_urdf_bodies
from dynident.model.inertia import Inertia
from dynident.results.model_exporters.subject.drives import Drives
from dynident.results.model_exporters.subject.identified import Identified
from dynident.results.model_exporters.subject.source import Source
from dynident.results.model_exporters.writing.lumps import shared, some
from dynident.results.model_exporters.writing.placement import Placement, place
from dynident.results.model_exporters.writing.urdf_text import inertia_tags, number
from dynident.results.model_exporters.writing.xml_edit import (
    Edit,
    Element,
    added_child,
    apply,
    elements,
    indent_of,
    removed,
    with_attributes,
)


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


def patched(subject: Identified, drives: Drives, source: Source, lump: bool) -> Patched:
    """Return the URDF with the inertias and joint friction of a model.

    Raises:
        DescriptionError: It is faulty, in UTF-16, or of another robot.
    """
    bodies, joints = read_urdf_bodies(source.path, source.data)
    placement = place(source.path, subject.model.robot, bodies, joints)
    shares = shared(subject, placement, lump)
    root = elements(source.path, source.data)
    edits: list[Edit] = []
    for link in root.all("link"):
        name = link.attributes["name"]
        if name in shares.inertias:
            edits += _inertial(source.data, link, shares.inertias[name])
    tags = joint_tags(subject, drives)
    for joint in root.all("joint"):
        if joint.attributes["name"] in tags:
            edits += _dynamics(source.data, joint, *tags[joint.attributes["name"]])
    left = [name for name in subject.model.robot.joint_names if name not in tags]
    notes = list(shares.notes)
    if left:
        notes.append(f"the model has no friction of {', '.join(left)}: their damping and friction are as in the file")
    if placement.locked:
        at = some([f"{name} at {position:.6g}" for name, position in placement.locked.items()])
        notes.append(f"identified with locked joints ({at}): their friction and what hangs on them are as in the file")
    return Patched(apply(source.data, edits), placement, tuple(notes))


def joint_tags(subject: Identified, drives: Drives) -> Mapping[str, tuple[float, float]]:
    """Return damping and dry friction of each joint that the model says something about; 0 for followers."""
    _, damping, dry = drives.at_joints()
    known = np.any((drives.coupling != 0) & drives.has_friction[:, None], axis=0)
    tags = {name: (float(damping[j]), float(dry[j])) for j, name in enumerate(drives.joints) if known[j]}
    for joint in subject.model.robot.joints:
        if joint.mimic is not None and joint.mimic.joint in tags:
            tags[joint.name] = (0.0, 0.0)  # the leader's friction is that of both
    return tags


def _inertial(data: bytes, link: Element, body: Inertia | None) -> Iterator[Edit]:
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
        yield Edit(origins[0].start, origins[0].end, origin)
        yield from (removed(data, other) for other in origins[1:])
    else:
        first = min(masses.start, tensors.start)
        yield Edit(first, first, origin + indent_of(data, first))
    yield Edit(masses.start, masses.end, mass)
    yield Edit(tensors.start, tensors.end, tensor)


def _dynamics(data: bytes, joint: Element, damping: float, dry: float) -> Iterator[Edit]:
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
