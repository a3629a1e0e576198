"""An SDF as bodies and joints: poses relative to named frames, nested models, axes expressed in other frames."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import PurePath

import numpy as np

from dynident.arrays import Array
from dynident.model.documents.numbers import Place, shown
from dynident.model.inertia import Inertia
from dynident.model.joint import Drive, JointLimits
from dynident.model.robot import STANDARD_GRAVITY, Frame, Robot
from dynident.model.shapes import Shape
from dynident.robot_files.sdf_elements import (
    SPRINGS_OF_DRAKE,
    Pose,
    drive_of_joint,
    inertia_of_link,
    kind_of_joint,
    limits_of_joint,
    mimic_of,
    name_of,
    number_in,
    numbers_in,
    only_child,
    placed,
    shape_of,
    version_note,
    visual_of,
)
from dynident.robot_files.sdf_frames import WORLD, SdfFrames
from dynident.robot_files.sdf_includes import SdfFiles, read_sdf_files
from dynident.robot_files.tree import Connection, assemble, some, with_unknown
from dynident.robot_files.xml_elements import MAX_LINKS, Element


@dataclass(frozen=True)
class SdfLink:
    """A link of the file.

    Attributes:
        element: Its element.
        pose: Its frame in the frame of the model, all joints at zero.
        origin: Its frame's origin in the frame of the link of the robot, shape (3,), in m.
    """

    element: Element
    pose: Pose
    origin: Array


@dataclass(frozen=True)
class SdfModel:
    """What a file says.

    Attributes:
        path: The file.
        name: Name of the model.
        files: The file with its includes.
        bodies: Inertia of each link about its frame in the robot; None where the file states none.
        links: The links of the file.
        shapes: Their shapes that touch.
        visuals: Those that only show them.
        connections: The joints, fixed ones included.
        joints: Their elements.
        gravity: In the frame of the base, shape (3,), in m/s^2.
        frames: Named frames: the link that each is fixed to, and its place there.
        incomplete: The links whose inertial lacks its mass or moments.
        notes: What has a torque in a simulator and none here.
        version_note: What is to be said of its version; empty for nothing.
    """

    path: object
    name: str
    files: SdfFiles
    bodies: dict[str, Inertia | None] = field(default_factory=dict)
    links: dict[str, SdfLink] = field(default_factory=dict)
    shapes: dict[str, list[Shape]] = field(default_factory=dict)
    visuals: dict[str, list[Shape]] = field(default_factory=dict)
    connections: list[Connection] = field(default_factory=list)
    joints: dict[str, Element] = field(default_factory=dict)
    gravity: Array = field(default_factory=lambda: np.array(STANDARD_GRAVITY))
    frames: dict[str, tuple[str, Pose]] = field(default_factory=dict)
    incomplete: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    version_note: str = ""

    def robot(self) -> Robot:
        """Return the robot, fixed links merged.

        Raises:
            DescriptionError: No tree, or no joint moves.
        """
        left = f"; without {', '.join(self.notes)}" if self.notes else ""
        version = f"; {self.version_note}" if self.version_note else ""
        note = f"read from {PurePath(str(self.path)).name}{version}{left}"
        found = assemble(self.path, self.name, self.bodies, self.connections, note, self.shapes, self.visuals)
        found = with_unknown(found, self.incomplete)
        places = {found.base: Frame(-1, np.eye(3), np.zeros(3)), **found.frames}
        places |= {link.name: Frame(i, np.eye(3), np.zeros(3)) for i, link in enumerate(found.links)}
        frames = dict(found.frames)
        for name, (link, pose) in self.frames.items():
            if name not in places and link in places:
                place = places[link]
                turn, shift = placed((place.rotation, place.translation), pose)
                frames[name] = Frame(place.link, turn, shift)
        return replace(found, gravity=self.gravity, frames=frames)


def read_sdf_model(path: object, data: bytes) -> SdfModel:
    """Return what an SDF says; ``path`` is what messages call it.

    Raises:
        DescriptionError: Any fault; the message names the file, the line and the element.
    """
    root, files = read_sdf_files(path, data)
    for joint in (joint for world in root.all("world") for joint in world.all("joint")):
        raise joint.place.error("a joint of the world is not read", "write it in the <model>")
    models = [model for holder in (root, *root.all("world")) for model in holder.all("model")]
    robot, objects = _robot_among(path, models)
    found = replace(_SdfReader(path, root, robot, files).read(), version_note=version_note(root))
    if objects:
        found.notes.append(f"the models beside the robot ({some(objects)})")
    return found


def _robot_among(path: object, models: list[Element]) -> tuple[Element, list[str]]:
    """Return the one model with joints that move, and the names of others that can be moved; static ones are scenery.

    Raises:
        DescriptionError: There is no such model, or several.
    """
    movable = [model for model in models if not _states(model, "static", ("true", "1"))] or models
    moved = [[model for model in among if _has_joints(model)] for among in (movable, models)]
    robots = moved[0] or moved[1] or movable  # a static robot is refused as such
    if len(robots) != 1:
        if not robots:
            raise Place(path).error("no <model> in <sdf>", "give the SDF of one robot")
        names, has_joints = some([name_of(model) for model in robots]), bool(moved[1])
        step = ", or write <static>true</static> into the others" if has_joints else ""
        evidence = f"{len(robots)} <model> with{'' if has_joints else 'out'} joints that move ({names})"
        raise Place(path).error(evidence, f"give the SDF of one robot{step}")
    return robots[0], [name_of(model) for model in movable if model is not robots[0]]


def _has_joints(model: Element) -> bool:
    """Return whether a model, or one nested in it, has a joint that moves."""
    own = any(joint.attributes.get("type") != "fixed" for joint in model.all("joint"))
    return own or any(map(_has_joints, model.all("model")))


def _states(element: Element, tag: str, words: tuple[str, ...]) -> bool:
    return any(child.text in words for child in element.all(tag))


class _SdfReader:
    """Reads the links and joints of one model and those nested in it."""

    def __init__(self, path: object, root: Element, model: Element, files: SdfFiles) -> None:
        self._files = files
        self._model = model
        self._frames = SdfFrames(model)
        self.found = SdfModel(path, name_of(model), files)
        self._gravity = np.array(STANDARD_GRAVITY)
        for world in root.all("world"):
            for gravity in world.all("gravity"):
                self._gravity = numbers_in(gravity, 3)

    def read(self) -> SdfModel:
        """Return all links and joints."""
        frames, links = self._frames, self._frames.all("link")
        if not links:
            raise self._model.place.error("no <link> in <model>", "give the SDF of a robot")
        if len(links) > MAX_LINKS:
            raise self._model.place.error(f"more than {MAX_LINKS} links", "give the SDF of one robot")
        joints = {
            name: (element, scope) for name, (element, scope) in frames.elements.items() if element.tag == "joint"
        }
        carried: dict[str, tuple[str, Element]] = {}
        for name, (element, scope) in joints.items():
            carried.setdefault(frames.end(element, scope, "child"), (name, element))
        models = (self._model, *frames.all("model").values())
        for model in models:
            if _states(model, "static", ("true", "1")):
                raise model.place.error("a static model, whose joints do not move", "remove <static> from it")
        for name, element in links.items():
            self._link(name, element, carried.get(name))
        for name, (element, scope) in joints.items():
            self._joint(name, element, scope)
        gravity = self._gravity_at_base()
        for name in frames.all("frame"):
            self._named(name)
        self.found.notes.extend(tag for tag in SPRINGS_OF_DRAKE if any(model.all(tag) for model in models))
        floating = [name for name, element in links.items() if _states(element, "gravity", ("false", "0"))]
        if len(floating) == len(links):
            gravity = np.zeros(3)
        elif floating:
            self.found.notes.append(f"<gravity>false</gravity> of links ({some(floating)})")
        return replace(self.found, gravity=gravity)

    def _link(self, name: str, element: Element, carrier: tuple[str, Element] | None) -> None:
        pose, origin = self._frames.pose(name), np.zeros(3)
        if carrier is not None and kind_of_joint(carrier[1]) != "fixed":
            anchor = self._frames.pose(carrier[0])
            origin = pose[0].T @ (pose[1] - anchor[1])
        inertia, missing = inertia_of_link(element)
        if missing:
            self.found.incomplete.append(name)
            self.found.notes.append(f"the incomplete <inertial> of {name} (no <{missing}>)")
        self.found.links[name] = SdfLink(element, pose, origin)
        self.found.bodies[name] = None if inertia is None else inertia.moved(np.eye(3), origin)
        pairs = (self.found.shapes, "collision", shape_of), (self.found.visuals, "visual", visual_of)
        for held, tag, reader in pairs:
            shapes = [reader(one) for one in element.all(tag)]
            held[name] = [shape.moved(np.eye(3), origin) for shape in shapes if shape is not None]

    def _link_frame(self, name: str, element: Element) -> Pose:
        """Return the frame of a link of the robot in that of the model."""
        if name == WORLD:
            return self._frames.frame(WORLD, "", element)
        link = self.found.links[name]
        return link.pose[0], link.pose[1] - link.pose[0] @ link.origin

    def _joint(self, name: str, element: Element, scope: str) -> None:
        kind = kind_of_joint(element)
        parent, child = (self._frames.end(element, scope, tag) for tag in ("parent", "child"))
        if child == WORLD:
            raise element.place.error("the world is its child", "exchange <parent> and <child>")
        if parent == WORLD:
            self.found.bodies.setdefault(WORLD, None)
        outer, inner = self._link_frame(parent, element), self._link_frame(child, element)
        rotation, translation = outer[0].T @ inner[0], outer[0].T @ (inner[1] - outer[1])
        axis, limits, mimic = np.array([0.0, 0.0, 1.0]), JointLimits(), None
        damping = friction = None
        drive = Drive()
        if kind != "fixed":
            holder = only_child(element, "axis", "write <axis><xyz>0 0 1</xyz></axis>")
            axis = inner[0].T @ self._axis(name, element, holder, scope)
            limits, mimic = limits_of_joint(element, holder), mimic_of(element, holder, scope)
            damping, friction = self._dynamics(name, holder)
            drive = drive_of_joint(element)
        self.found.joints[name] = element
        self.found.connections.append(
            Connection(name, kind, parent, child, rotation, translation, axis, limits, mimic, damping, friction, drive)
        )

    def _axis(self, name: str, joint: Element, holder: Element, scope: str) -> Array:
        """Return the axis in the frame of the model."""
        written = holder.all("xyz")
        axis = numbers_in(written[0], 3) if written else np.array([0.0, 0.0, 1.0])
        if np.linalg.norm(axis) < 1e-9:
            raise written[0].place.error(f"axis {shown(written[0].text)} has no direction", "write it as 0 0 1")
        expressed = written[0].attributes.get("expressed_in", "") if written else ""
        in_model = any(flag.text in ("true", "1") for flag in holder.all("use_parent_model_frame"))
        version = self._files.versions[str(joint.path)]
        if expressed:
            return self._frames.frame(expressed, scope, joint)[0] @ axis
        if version < (1, 5) or (version < (1, 7) and in_model):
            return self._frames.frame("__model__", scope, joint)[0] @ axis
        return self._frames.pose(name)[0] @ axis

    def _dynamics(self, name: str, holder: Element) -> tuple[float | None, float | None]:
        found = holder.all("dynamics")
        if not found:
            return None, None
        if number_in(found[0], "spring_stiffness", 0.0):
            self.found.notes.append(f"springs of joints ({name})")
        values: list[float | None] = []
        for tag in ("damping", "friction"):
            value = number_in(found[0], tag, 0.0)
            if value < 0.0:
                raise found[0].place.error(f"{tag} {value:g} is negative", "write 0 or more")
            values.append(value if found[0].all(tag) else None)
        return values[0], values[1]

    def _gravity_at_base(self) -> Array:
        """Return gravity in the frame of the base."""
        carried = {joint.child for joint in self.found.connections}
        roots = [name for name in self.found.bodies if name not in carried]
        turn = self._frames.in_world()[0]
        if len(roots) > 1 and WORLD in roots:
            loose = next(name for name in roots if name != WORLD)
            step = "fix it to the world or to another link with a joint, or remove it"
            raise self.found.links[loose].element.place.error("this link floats beside the one on the world", step)
        if len(roots) != 1 or roots[0] == WORLD:
            return self._gravity
        return (turn @ self.found.links[roots[0]].pose[0]).T @ self._gravity

    def _named(self, name: str) -> None:
        """Check a named frame, and keep it on the link that it is fixed to."""
        element, scope = self._frames.elements[name]
        own = self._frames.pose(name)
        if element.attributes.get("attached_to"):
            self._frames.frame(element.attributes["attached_to"], scope, element)  # an unknown one is refused
        link = self._frames.link_behind(name)
        if link is None:
            raise element.place.error("it is attached to itself, frame behind frame", "correct attached_to")
        if link in self.found.links:
            frame = self._link_frame(link, self._frames.elements[link][0])
            self.found.frames[name] = link, (frame[0].T @ own[0], frame[0].T @ (own[1] - frame[1]))
