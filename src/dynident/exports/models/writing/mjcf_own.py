"""The user's own MJCF with other masses, inertias, armature, damping and friction loss; every other byte is kept."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from xml.sax.saxutils import quoteattr, unescape

import numpy as np

from dynident.arrays import Array
from dynident.errors import DescriptionError
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
    preorder,
    with_attributes,
    without_attributes,
)
from dynident.exports.models.writing.xml_text import number, numbers, quaternion, unused_name
from dynident.model.inertia import Inertia
from dynident.model.parameters import to_mujoco_fullinertia
from dynident.robot_files.mjcf.bodies import BodySource
from dynident.robot_files.mjcf.model import MjcfModel, read_mjcf_model
from dynident.robot_files.mjcf.poses import ORIENTATIONS
from dynident.robot_files.tree import some, weightless
from dynident.robot_files.xml_elements import Element

_SIX = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
_INCLUDED = re.compile(r"""<include\s[^>]*?\bfile\s*=\s*["']([^"'/]+)["']""")
_STEP = "put it into the main file, with names of its own, and identify again"
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
            includes under new names, which the files that include them have.
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
    placement = place(source.path, subject.model.robot, before.tree.bodies, before.connections)
    shares = shared(subject, placement, lump)
    writer = _Writer(before)
    for name, body in _bodies(before, shares.inertias).items():
        writer.inertial(name, body)
    tags, left = _tags(subject, drives, before)
    for name, values in tags.items():
        writer.joint(name, values)
    is_elsewhere = output.resolve().parent != source.path.resolve().parent
    texts, renamed = writer.texts(output, is_elsewhere)
    after = read_mjcf_model(source.path, texts[str(source.path)], texts)
    notes = kept_notes(shares, placement, left)
    if renamed:
        what = "includes are copied to" if is_elsewhere else "what changed in includes is in"
        notes.append(f"your own files stay as they are: {what} {some(renamed)}")
    if is_elsewhere and (folders := writer.asset_folders(output)):
        main = str(source.path)
        texts = {**texts, main: _with_folders(source.path, texts[main], folders)}
        notes.append(f"meshes and textures are found where they are: {some(list(folders.values()))}")
    if before.document.compiler.changes_inertia:
        notes.append("all bodies state their inertia now: <compiler> had settings that change what is stated")
    return PatchedMjcf(texts, before, after, placement, tags, tuple(notes))


def _bodies(model: MjcfModel, new: Mapping[str, Inertia | None]) -> dict[str, Inertia | None]:
    """Return the bodies that are written: the new ones, and all where the compiler changes what is stated.

    Raises:
        DescriptionError: A body between two joints of one body has an inertia that counts, which MJCF cannot say.
    """
    light = weightless(new)
    pinned = model.tree.bodies if model.document.compiler.changes_inertia else {}
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


class _Writer:
    """Collects the edits of each file."""

    def __init__(self, model: MjcfModel) -> None:
        self._model = model
        self._placed: dict[str, list[PlacedElement]] = {}
        self._edits: dict[str, list[ByteEdit]] = {}
        if model.document.compiler.changes_inertia:
            for element in model.document.compiler.elements:
                self._neutralise(element)

    def asset_folders(self, output: Path) -> dict[str, str]:
        """Return settings of the compiler by which files of meshes and textures are found from an output's folder.

        Raises:
            DescriptionError: It has attached models, whose files MuJoCo finds from the folder of the main file alone.
        """
        document, given = self._model.document, dict[str, str]()
        for element in document.compiler.elements:
            given.update(element.attributes)
        named = {
            one.tag
            for section in ("asset", "deformable")
            for one in document.each(section)
            if one.attributes.get("file")
        }
        if "model" in named:
            evidence = "attached models are found from the folder of your file alone"
            step = f"write the output there: -o {document.folder / output.name}"
            raise DescriptionError(document.path, "<model>", evidence, step)
        found: dict[str, str] = {}
        for key, tags in (("meshdir", {"mesh", "hfield", "skin"}), ("texturedir", {"texture"})):
            own = Path(given.get(key, given.get("assetdir", "")))
            if named & tags and not own.is_absolute():
                found[key] = _from(output, document.folder / own)
        return found

    def texts(self, output: Path, is_elsewhere: bool) -> tuple[dict[str, bytes], list[str]]:
        """Return the files that changed, by path, and the names of the changed includes, which begin as the output's.

        Of an output in another folder all includes are among them.

        No name is that of a file of the model, or of one beside the output that an earlier output has not included.
        """
        document = self._model.document
        changed = {str(document.path), *(document.includes if is_elsewhere else ())}
        for path in self._edits:
            while path not in changed:  # what includes a changed file has its new name, and so changes too
                changed.add(path)
                path = str(document.includes[path].path)  # noqa: PLW2901
        names: dict[str, str] = {}
        taken = {Path(path).stem for path in document.texts} | _beside_not_of(output)
        for path in (path for path in document.includes if path in changed):
            stem = unused_name(f"{output.stem}-{Path(path).stem}", taken)
            taken.add(stem)
            names[path] = stem + Path(path).suffix
        for path, element in document.includes.items():
            name = names.get(path, Path(os.path.relpath(path, document.folder)).as_posix())
            if str(element.path) in changed and Path(name) != Path(element.attributes["file"]):
                data, place = self._of(element)
                self._add(element, with_attributes(data, place, {"file": name}))
        texts: dict[str, bytes] = {}
        for path in sorted(changed, key=list(document.texts).index):
            new = str(document.folder / names[path]) if path in names else path
            texts[new] = apply(document.texts[path], self._edits.get(path, []))
        return texts, list(names.values())

    def inertial(self, name: str, body: Inertia | None) -> None:
        """Give a body another inertia about the origin of its link, or none."""
        source = self._model.tree.sources[name]
        self._check(f"body '{name}'", source)
        element = source.element
        stated = element.all("inertial")
        if body is None and not stated and not element.all("geom"):
            return
        values = _inertial_values(body, source.origin)
        text = " ".join(f'{key}="{value}"' for key, value in values.items())
        data, place = self._of(element)
        if not stated:
            self._add(element, _first_child(data, place, f"<inertial {text}/>".encode("ascii")))
            return
        _, own = self._of(stated[0])
        gone = [key for key in ("diaginertia", "fullinertia", *ORIENTATIONS) if key not in values]
        self._add(stated[0], without_attributes(data, own, gone, values))

    def joint(self, name: str, values: tuple[float, float | None, float | None]) -> None:
        """Give a joint another armature, damping and friction loss; None keeps that of the file."""
        tree = self._model.tree
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
        if changed.keys() & {"armature", "damping"} and name in tree.motors:
            for motor in tree.motors[name]:
                data, place = self._of(motor)
                self._add(motor, with_attributes(data, place, {"armature": "0", "damping": "0"}))
            own = {key: number(new) for key, new in zip(keys[:2], values[:2], strict=True) if new is not None}
            changed = {**own, **changed}
        if changed:
            self._check(f"joint '{name}'", source)
            data, place = self._of(source.element)
            self._add(source.element, with_attributes(data, place, changed))

    def _neutralise(self, element: Element) -> None:
        given = element.attributes
        values = {
            key: new for key, (old, new) in _NEUTRAL.items() if key in given and (old is None or given[key] == old)
        }
        if values:
            data, place = self._of(element)
            self._add(element, with_attributes(data, place, values))

    def _check(self, where: str, source: BodySource | object) -> None:
        if not getattr(source, "is_own", True):
            evidence = "it comes from an attached model or a replica, whose elements stand for several"
            raise DescriptionError(self._model.document.path, where, evidence, _STEP)

    def _of(self, element: Element) -> tuple[bytes, PlacedElement]:
        key = str(element.path)
        data = self._model.document.texts[key]
        if key not in self._placed:
            self._placed[key] = list(preorder(elements(element.path, data)))
        return data, self._placed[key][element.number]

    def _add(self, element: Element, edit: ByteEdit) -> None:
        self._edits.setdefault(str(element.path), []).append(edit)


def _from(output: Path, place: Path) -> str:
    """Return the name of a place as seen from the folder of an output."""
    try:
        return Path(os.path.relpath(place.resolve(), output.resolve().parent)).as_posix()
    except ValueError:  # on another drive
        return place.resolve().as_posix()


def _with_folders(path: Path, data: bytes, folders: Mapping[str, str]) -> bytes:
    """Return a main file with settings of the compiler that count more than all others in it."""
    text = " ".join(f"{key}={quoteattr(name)}" for key, name in folders.items())
    root = elements(path, data)
    return apply(data, [added_child(data, root, f"<compiler {text}/>".encode())])


def _first_child(data: bytes, parent: PlacedElement, text: bytes) -> ByteEdit:
    """Return the edit that puts an element before the others in ``parent``, on a line of its own where those are."""
    if not parent.children:
        return added_child(data, parent, text)
    first = replace(parent, children=parent.children[:1])
    edit = added_child(data, first, text)
    indent = edit.text[: len(edit.text) - len(text)]
    start = parent.children[0].start
    return ByteEdit(start, start, text + indent)


def _beside_not_of(output: Path) -> set[str]:
    """Return the names, without endings, of files beside an output that it does not include as it is now."""
    folder = output.absolute().parent
    own, waiting = set[str](), [output.name]
    while waiting:
        name = waiting.pop()
        if name not in own and (folder / name).is_file():
            own.add(name)
            words = _INCLUDED.findall((folder / name).read_text("utf-8", errors="replace"))
            waiting += [unescape(word, {"&quot;": '"', "&apos;": "'"}) for word in words]
    return {file.stem for file in folder.iterdir() if file.name not in own} if folder.is_dir() else set()


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
