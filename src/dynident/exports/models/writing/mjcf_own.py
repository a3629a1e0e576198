"""The user's own MJCF with other masses, inertias, armature, damping and friction loss; every other byte is kept."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path, PurePath

import numpy as np

from dynident.arrays import Array
from dynident.errors import DescriptionError
from dynident.exports.models.subject.drives import Drives
from dynident.exports.models.subject.identified import Identified
from dynident.exports.models.subject.source import OwnDescription
from dynident.exports.models.writing.mjcf_files import MjcfFiles
from dynident.exports.models.writing.placement import Placement, Shares, kept_notes, place, shared
from dynident.exports.models.writing.urdf import joint_tags
from dynident.exports.models.writing.xml_edit import (
    ByteEdit,
    PlacedElement,
    added_child,
    number,
    numbers,
    quaternion,
    without_attributes,
)
from dynident.model.inertia import Inertia
from dynident.model.parameters import to_mujoco_fullinertia
from dynident.model.robot import Robot
from dynident.robot_files.mjcf.bodies import MjcfTree
from dynident.robot_files.mjcf.document import CompilerSettings
from dynident.robot_files.mjcf.model import MjcfModel, read_mjcf_model
from dynident.robot_files.mjcf.poses import ORIENTATIONS
from dynident.robot_files.tree import Connection, some, weightless
from dynident.robot_files.xml_elements import Element

_SIX = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
#: Settings of the compiler under which a stated inertia is not the one that counts, and what ends that.
_NEUTRAL = {
    "inertiafromgeom": ("true", "auto"),
    "settotalmass": (None, "-1"),
    "boundmass": (None, "0"),
    "boundinertia": (None, "0"),
    "balanceinertia": ("true", "false"),
}


@dataclass(frozen=True)
class PatchedMjcf:
    """The MJCF of a user with a model in it.

    Attributes:
        texts: Bytes of each changed file by its path beside the user's main file: that one under its own name, changed
            includes and attached models under new names, which the files that name them have.
        before: What the user's files say.
        after: What the changed files say.
        placement: Bodies of the file on the links of the model.
        tags: Armature, damping and friction loss that were set, by joint; None keeps what the file states.
        notes: What the reader has to know.
    """

    texts: Mapping[str, bytes]
    before: MjcfModel
    after: MjcfModel
    placement: Placement
    tags: Mapping[str, tuple[float, float | None, float | None]]
    notes: tuple[str, ...]


#: What MuJoCo needs of a body that only carries another one.
_BETWEEN = 'the first with <inertial pos="0 0 0" mass="1e-6" diaginertia="1e-9 1e-9 1e-9"/>'


def patched_mjcf(subject: Identified, drives: Drives, source: OwnDescription, lump: bool, output: Path) -> PatchedMjcf:
    """Return the files of an MJCF with the inertias and drives of a model.

    Args:
        subject: The model.
        drives: Its drives.
        source: The user's MJCF.
        lump: Whether bodies fixed to a moving one lose their inertia to it.
        output: The file that is written, after which changed includes are named.

    Raises:
        DescriptionError: It is faulty or of another robot, or what was identified has no place of its own in it.
    """
    before = read_mjcf_model(source.path, source.data)
    robot = subject.model.robot
    placement, shares, bodies = own_bodies(before, robot, subject.bodies, lump)
    writer = _Writer(before)
    for name, body in bodies.items():
        writer.inertial(name, body)
    tags, left = _tags(subject, drives, before)
    for name, values in tags.items():
        writer.joint(name, values)
    tilt = writer.gravity(robot.gravity)
    is_elsewhere = output.resolve().parent != source.path.resolve().parent
    files = writer.files()
    edited, renamed = files.texts(output, is_elsewhere)
    here, _ = files.found_from(source.path, edited)
    after = read_mjcf_model(source.path, here[str(source.path)], here)
    texts, folders = files.found_from(output, edited)
    notes = [*tilt, *kept_notes(shares, placement, left)]
    if renamed:
        what = "other files are copied to" if is_elsewhere else "what changed in other files is in"
        notes.append(f"your own files stay as they are: {what} {some(renamed)}")
    if folders:
        notes.append(f"meshes and textures are found where they are: {some(folders)}")
    if any(_changes(one.compiler, before) for one in before.tree.sources.values()):
        notes.append("all bodies state their inertia now: <compiler> had settings that change what is stated")
    return PatchedMjcf(texts, before, after, placement, tags, tuple(notes))


def own_bodies(
    model: MjcfModel, robot: Robot, bodies: Sequence[Inertia], lump: bool
) -> tuple[Placement, Shares, dict[str, Inertia | None]]:
    """Return where the bodies of an MJCF stand, what each gets, and what is written of them, about their links' frames.

    Args:
        model: The file.
        robot: The robot that was identified.
        bodies: Inertia of each of its links, about its frame.
        lump: Whether bodies fixed to a moving one lose their inertia to it.

    Raises:
        DescriptionError: It is of another robot, or what was identified has no place of its own in it.
    """
    tree = model.tree
    placement = place(model.document.path, robot, tree.bodies, _joints(model, robot))
    shares = shared(robot, bodies, placement, lump, tree.bodies.keys() - tree.sources.keys())
    return placement, shares, _bodies(model, shares.inertias)


def _joints(model: MjcfModel, robot: Robot) -> list[Connection]:
    """Return the joints of a file; those that an equality holds move in it, and are locked in the robot."""
    moving = {joint.name for joint in robot.joints}
    pairs = zip(model.tree.connections, model.connections, strict=True)
    return [found if found.name in moving else written for written, found in pairs]


def _bodies(model: MjcfModel, new: Mapping[str, Inertia | None]) -> dict[str, Inertia | None]:
    """Return the bodies that are written: the new ones, and all where the compiler changes what is stated.

    Raises:
        DescriptionError: A body between two joints of one body has an inertia that counts, which MJCF cannot say.
    """
    light = weightless(new)
    sources = model.tree.sources
    pinned = {name: model.tree.bodies[name] for name, one in sources.items() if _changes(one.compiler, model)}
    found: dict[str, Inertia | None] = {}
    for name, body in {**pinned, **new}.items():
        if name in model.tree.sources:
            found[name] = body
        elif name in new and body is not None and name not in light:
            evidence = "the model has an inertia between two joints of one body, which MJCF cannot say"
            step = f"identify with --estimator consistent, which keeps it 0, or write a body for each joint, {_BETWEEN}"
            raise DescriptionError(model.document.path, f"body '{name}'", evidence, step)
    return {name: body for name, body in found.items() if body is not None or name in new}


def _tags(
    subject: Identified, drives: Drives, before: MjcfModel
) -> tuple[dict[str, tuple[float, float | None, float | None]], list[str]]:
    """Return armature, damping and friction loss of each joint, and the joints of which the model has no friction.

    Where a leader has the armature of the file, it and its followers keep their own.
    """
    armature, _, _ = drives.at_joints()
    friction = joint_tags(subject, drives)
    stated = {one.name: one.drive.reflected_inertia for one in before.connections}
    together = {one.name: one.drive.reflected_inertia for one in before.robot().joints}
    tags: dict[str, tuple[float, float | None, float | None]] = {}
    for joint in subject.model.robot.joints:
        leader = joint.name if joint.mimic is None else joint.mimic.joint
        rotor = float(armature[drives.joints.index(leader)])
        is_kept = bool(np.isclose(rotor, together.get(leader, np.nan), rtol=1e-12, atol=0.0))
        rotor = stated[joint.name] if is_kept else rotor if leader == joint.name else 0.0
        damping, dry = friction.get(joint.name, (None, None))
        tags[joint.name] = (rotor, damping, dry)
    return tags, [name for name in subject.model.robot.joint_names if name not in friction]


def _changes(compiler: CompilerSettings, model: MjcfModel) -> bool:
    """Return whether a stated inertia may not be the one that counts, by the settings for a body or for all."""
    return compiler.changes_inertia or model.document.compiler.total_mass > 0.0


class _Writer:
    """Writes into the elements of a model; of one that stands for several bodies or joints, what is the same in all."""

    def __init__(self, model: MjcfModel) -> None:
        self._model = model
        tree = self._tree = model.tree
        self._files = MjcfFiles(model.document)
        self._copies = Counter(_key(one.element) for one in (*tree.sources.values(), *tree.joints.values()))
        self._written: dict[tuple[str, int], list[tuple[str, dict[str, str]]]] = {}
        whole = model.document.compiler  # its total mass is that of attached models too
        compilers = [source.compiler for source in tree.sources.values()] + [whole] * (whole.total_mass > 0.0)
        settings = {_key(one): one for compiler in compilers for one in compiler.elements}
        for element in settings.values():
            self._neutralise(element)

    def files(self) -> MjcfFiles:
        """Return the files with all edits.

        Raises:
            DescriptionError: An element stands for several bodies or joints, which are not the same any more.
        """
        for key, written in self._written.items():
            if not all(_are_same(values, written[0][1]) for _, values in written) or len(written) < self._copies[key]:
                evidence = f"its element stands for {self._copies[key]}, by a replica or a model attached several times"
                step = f"{_written_apart(self._tree, key[0])}, and identify again"
                raise DescriptionError(self._model.document.path, written[0][0], evidence, step)
        return self._files

    def inertial(self, name: str, body: Inertia | None) -> None:
        """Give a body another inertia about the origin of its link, or none."""
        source = self._tree.sources[name]
        element = source.element
        stated = element.all("inertial")
        if body is None and not stated and not element.all("geom"):
            return
        values = _inertial_values(body, source.origin)
        text = " ".join(f'{key}="{value}"' for key, value in values.items())
        data, place = self._files.of(element)
        if place.tag != element.tag:
            evidence, step = "it is the world of an attached model", "attach the body in it, and identify again"
            raise DescriptionError(self._model.document.path, f"body '{name}'", evidence, step)
        if self._is_written(f"body '{name}'", element, values):
            return
        if not stated:
            self._files.add(element, _first_child(data, place, f"<inertial {text}/>".encode("ascii")))
            return
        _, own = self._files.of(stated[0])
        gone = [key for key in ("diaginertia", "fullinertia", *ORIENTATIONS) if key not in values]
        self._files.add(stated[0], without_attributes(data, own, gone, values))

    def joint(self, name: str, values: tuple[float, float | None, float | None]) -> None:
        """Give a joint another armature, damping and friction loss; None keeps that of the file."""
        tree = self._tree
        if name not in tree.joints:
            return
        joint = next(one for one in self._model.connections if one.name == name)
        stated = (joint.drive.reflected_inertia, joint.damping or 0.0, joint.friction or 0.0)
        keys = ("armature", "damping", "frictionloss")
        changed = {
            key: number(new)
            for key, new, old in zip(keys, values, stated, strict=True)
            if new is not None and new != old and not np.isclose(new, old, rtol=1e-14, atol=0.0)
        }
        if name in tree.curved and values[1] is not None:  # the model has no other order of damping
            changed["damping"] = f"{number(values[1])} 0 0"
        for key, flag in (("damping", "damper"), ("frictionloss", "frictionloss")):
            if key in changed and (element := self._model.document.disabled.get(flag)):
                evidence = f"it switches {key} off, and joint '{name}' has {changed[key]} now, which would do nothing"
                raise element.place.error(evidence, "enable it in your file, and export with --description FILE")
        source = tree.joints[name]
        if name in tree.notes.get("springdamper of joints", ()) and "damper" not in self._model.document.disabled:
            evidence = f"springdamper of joint '{name}' sets its damping, whatever is identified"
            step = "write stiffness and damping in place of it in your file, and export with --description FILE"
            raise source.element.place.error(evidence, step)
        for motor, states in tree.motors.get(name, ()):
            if gone := [key for key in states if key in changed]:
                self._files.set(motor, dict.fromkeys(gone, "0"))
        if changed and not self._is_written(f"joint '{name}'", source.element, changed):
            self._files.set(source.element, changed)

    def gravity(self, gravity: Array) -> list[str]:
        """Give the world another gravity, shape (3,) in m/s^2, where it is another; return what the reader has to know.

        Raises:
            DescriptionError: Gravity is switched off in the file.
        """
        document = self._model.document
        if np.allclose(gravity, document.gravity, rtol=0.0, atol=1e-9):
            return []
        if element := document.disabled.get("gravity"):
            evidence = f"it switches gravity off, and the model was identified under ({numbers(gravity)}) m/s^2"
            raise element.place.error(evidence, "enable it in your file, and export with --description FILE")
        stated = [one for one in document.sections.get("option", []) if "gravity" in one.attributes]
        if stated:
            self._files.set(stated[-1], {"gravity": numbers(gravity)})
        else:
            self._files.append(f'<option gravity="{numbers(gravity)}"/>'.encode("ascii"))
        now, before = numbers(gravity), numbers(document.gravity)
        return [
            f"gravity is ({now}) m/s^2, as the model was identified, for ({before}): all else in the world has it too"
        ]

    def _is_written(self, where: str, element: Element, values: dict[str, str]) -> bool:
        """Return whether an element has been written for another of its bodies or joints."""
        written = self._written.setdefault(_key(element), [])
        written.append((where, values))
        return len(written) > 1

    def _neutralise(self, element: Element) -> None:
        given = element.attributes
        values = {
            key: new for key, (old, new) in _NEUTRAL.items() if key in given and (old is None or given[key] == old)
        }
        if values:
            self._files.set(element, values)


def _written_apart(tree: MjcfTree, path: str) -> str:
    """Return what to do so that each body or joint of a file has an element of its own."""
    inside = [scope for scope in tree.scopes if path in scope.document.texts]
    own = min(inside, key=lambda scope: len(scope.document.texts)).document
    first, *others = {scope.prefix: scope for scope in inside if scope.document is own}.values()
    if not others:
        return "write replicas as bodies of their own"
    other = others[0]
    while (one := first.outer) and (two := other.outer) and one.prefix != two.prefix and one.document is two.document:
        first, other = one, two
    outer, file = other.outer, PurePath(str(other.document.path))
    assert outer is not None
    prefix = other.prefix.removeprefix(outer.prefix)
    worlds = outer.document.sections["worldbody"]
    attaches = (one for world in worlds for one in world.below() if one.tag == "attach")
    attach = next(one for one in attaches if one.attributes.get("prefix") == prefix)
    copy, name = f"{file.stem}-2{file.suffix}", f"{attach.attributes['model']}-2"
    files = "" if len(other.document.texts) == 1 else ", and likewise the files that it includes or attaches"
    place = f"line {attach.line} of {PurePath(str(attach.path)).name}"
    return (
        f"copy {file.name} to {copy} beside it{files}, add <model name='{name}' file='.../{copy}'/> to <asset>, "
        f"write model='{name}' in the <attach> with prefix='{prefix}' ({place})"
    )


def _key(element: Element) -> tuple[str, int]:
    """Return what an element of the files is known by."""
    return str(element.path), element.number


def _are_same(one: Mapping[str, str], other: Mapping[str, str]) -> bool:
    """Return whether attributes of numbers differ by rounding alone."""
    if one.keys() != other.keys():
        return False
    pairs = (np.array([one[key].split(), other[key].split()], dtype=np.float64) for key in one)
    return all(bool(np.allclose(*pair, rtol=0.0, atol=1e-12 * np.abs(pair).max())) for pair in pairs)


def _first_child(data: bytes, parent: PlacedElement, text: bytes) -> ByteEdit:
    """Return the edit that puts an element before the others in ``parent``, on a line of its own where those are."""
    if not parent.children:
        return added_child(data, parent, text)
    first = replace(parent, children=parent.children[:1])
    edit = added_child(data, first, text)
    indent = edit.text[: len(edit.text) - len(text)]
    start = parent.children[0].start
    return ByteEdit(start, start, text + indent)


def _inertial_values(body: Inertia | None, origin: Array) -> dict[str, str]:
    """Return the attributes of an ``<inertial>`` for a body about the origin of its link."""
    own = None if body is None else body.moved(np.eye(3), -origin)
    if own is None or not own.vector.any():
        return {"pos": "0 0 0", "mass": "0", "diaginertia": "0 0 0"}
    where = {"pos": numbers(own.centre_of_mass), "mass": number(own.mass)}
    tensor = np.asarray(own.about_centre)
    if not np.any(tensor - np.diag(np.diag(tensor))):
        return {**where, "diaginertia": numbers(np.diag(tensor))}
    moments, axes = np.linalg.eigh(tensor)
    if moments[0] > 0.0:
        return {**where, "fullinertia": numbers(to_mujoco_fullinertia(np.array([tensor[a] for a in _SIX])))}
    axes[:, 2] *= np.sign(np.linalg.det(axes))  # a thin rod: MuJoCo takes no full inertia that is not above zero
    return {**where, "quat": numbers(quaternion(axes)), "diaginertia": numbers(np.maximum(moments, 0.0))}


def beside(path: Path, source: OwnDescription, patched: PatchedMjcf) -> dict[Path, bytes]:
    """Return the changed files at the places where they are written: the main one at ``path``, the others beside it."""
    main = str(source.path)
    others = {path.with_name(Path(key).name): data for key, data in patched.texts.items() if key != main}
    return {path: patched.texts[main], **others}
