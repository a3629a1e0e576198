"""An SDF as bodies and joints: poses relative to named frames, nested models, axes expressed in other frames."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import PurePath
from typing import Final

import numpy as np

from dynident.arrays import Array
from dynident.errors import nearest
from dynident.model.documents.numbers import Place, shown
from dynident.model.inertia import Inertia
from dynident.model.robot import STANDARD_GRAVITY, Drive, Frame, JointLimits, Mimic, Robot
from dynident.model.shapes import Shape
from dynident.robot_files.sdf_elements import (
    Pose,
    drive_of_joint,
    inertia_of_link,
    kind_of_joint,
    limits_of_joint,
    model_pose,
    name_of,
    number_in,
    numbers_in,
    only_child,
    placed,
    pose_of_element,
    shape_of,
    version_of,
)
from dynident.robot_files.sdf_words import check_words
from dynident.robot_files.tree import Connection, assemble
from dynident.robot_files.xml_elements import Element, XmlLanguage, parse_xml
from dynident.robot_files.xml_values import Values

WORLD: Final = "world"


_SDF: Final = XmlLanguage("SDF", ("sdf",), "link")


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
        bodies: Inertia of each link about its frame in the robot; None where the file states none.
        links: The links of the file.
        shapes: Their shapes.
        connections: The joints, fixed ones included.
        joints: Their elements.
        gravity: In the frame of the base, shape (3,), in m/s^2.
        frames: Named frames: the link that each is fixed to, and its place there.
        notes: What has a torque in a simulator and none here.
    """

    path: object
    name: str
    bodies: dict[str, Inertia | None] = field(default_factory=dict)
    links: dict[str, SdfLink] = field(default_factory=dict)
    shapes: dict[str, list[Shape]] = field(default_factory=dict)
    connections: list[Connection] = field(default_factory=list)
    joints: dict[str, Element] = field(default_factory=dict)
    gravity: Array = field(default_factory=lambda: np.array(STANDARD_GRAVITY))
    frames: dict[str, tuple[str, Pose]] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)

    def robot(self) -> Robot:
        """Return the robot, fixed links merged.

        Raises:
            DescriptionError: No tree, or no joint moves.
        """
        left = f"; without {', '.join(self.notes)}" if self.notes else ""
        note = f"read from {PurePath(str(self.path)).name}{left}"
        found = assemble(self.path, self.name, self.bodies, self.connections, note, self.shapes)
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
    root = parse_xml(path, data, _SDF)
    check_words(root)
    holders = [root, *root.all("world")]
    models = [model for holder in holders for model in holder.all("model")]
    for holder in holders:
        _refuse_includes(holder)
        for joint in holder.all("joint"):
            raise joint.place.error("a joint of the world is not read", "write it in the <model>")
    if len(models) != 1:
        step = "give the SDF of one robot"
        raise Place(path).error(f"{len(models)} <model> elements in <sdf>", step)
    return _SdfReader(path, root, models[0]).read()


def _refuse_includes(holder: Element) -> None:
    for element in holder.all("include"):
        raise element.place.error("an included model is not read", "expand it first: gz sdf -p FILE > model.sdf")


def _inverse(pose: Pose) -> Pose:
    return pose[0].T, -pose[0].T @ pose[1]


class _SdfReader:
    """Resolves the frames of one model and those nested in it."""

    def __init__(self, path: object, root: Element, model: Element) -> None:
        self._version = version_of(root)
        self._model = model
        self._frames: dict[str, tuple[Element, str]] = {}  # element and scope of each frame by its full name
        self._poses: dict[str, Pose] = {}
        self._open: list[str] = []
        self.found = SdfModel(path, name_of(model))
        self._gravity = np.array(STANDARD_GRAVITY)
        for world in root.all("world"):
            for gravity in world.all("gravity"):
                self._gravity = numbers_in(gravity, 3)

    def read(self) -> SdfModel:
        """Return all links and joints."""
        self._collect(self._model, "")
        links = {name: element for name, (element, _) in self._frames.items() if element.tag == "link"}
        if not links:
            raise self._model.place.error("no <link> in <model>", "give the SDF of a robot")
        carried: dict[str, tuple[str, Element]] = {}
        for name, (element, scope) in self._frames.items():
            if element.tag == "joint":
                child = self._end(element, scope, "child")
                if child != WORLD:
                    carried.setdefault(child, (name, element))
        for name, element in links.items():
            self._link(name, element, carried.get(name))
        for name, (element, scope) in self._frames.items():
            if element.tag == "joint":
                self._joint(name, element, scope)
        gravity = self._gravity_at_base()
        for name, (element, _) in self._frames.items():
            if element.tag == "frame":
                self._named(name)
        return replace(self.found, gravity=gravity)

    def _collect(self, model: Element, scope: str) -> None:
        _refuse_includes(model)
        for element in model.children:
            if element.tag in ("link", "joint", "frame", "model"):
                name = scope + name_of(element)
                if name in self._frames or name == WORLD:
                    step = "give each link, joint, frame and nested model a name of its own"
                    raise element.place.error(f"the name {shown(name)} is taken", step)
                self._frames[name] = element, scope
                if element.tag == "model":
                    self._collect(element, f"{name}::")

    def _pose(self, name: str) -> Pose:
        """Return where a frame is in the frame of the model."""
        if name in self._poses:
            return self._poses[name]
        if name in self._open or len(self._open) > 200:
            ring = " -> ".join(shown(each) for each in [*self._open[:6], name])
            evidence = f"poses refer to each other in a ring: {ring}"
            raise self._frames[name][0].place.error(evidence, "correct relative_to")
        self._open.append(name)
        element, scope = self._frames[name]
        found = self._placed_element(element, scope)
        self._open.pop()
        self._poses[name] = found
        return found

    def _placed_element(self, element: Element, scope: str) -> Pose:
        poses = element.all("pose")
        given = poses[0].attributes.get("relative_to", "") if poses else ""
        own = pose_of_element(poses[0]) if poses else (np.eye(3), np.zeros(3))
        if element.tag == "model" and element.attributes.get("placement_frame"):
            step = "remove it, and write the pose of the model's own frame"
            raise element.place.error("a nested model with a placement_frame is not read", step)
        if given:
            return placed(self._frame(given, scope, poses[0]), own)
        if element.tag == "joint":
            child = self._end(element, scope, "child")
            return placed(self._frame_of(child, element), own)
        if element.tag == "frame" and element.attributes.get("attached_to"):
            return placed(self._frame(element.attributes["attached_to"], scope, element), own)
        return placed(self._frame("__model__", scope, element), own)

    def _model_in_world(self) -> Pose:
        """Return the frame of the model in the world; its pose is that of its ``placement_frame``."""
        given, name = model_pose(self._model), self._model.attributes.get("placement_frame", "")
        if name == WORLD:
            raise self._model.place.error("its placement_frame is the world", "write a frame of the model")
        return placed(given, _inverse(self._frame(name, "", self._model))) if name else given

    def _frame(self, name: str, scope: str, element: Element) -> Pose:
        """Return the frame that a name means in a model."""
        if name == "__model__":
            return self._pose(scope.removesuffix("::")) if scope else (np.eye(3), np.zeros(3))
        return self._frame_of(name if name == WORLD else scope + name, element)

    def _frame_of(self, name: str, element: Element) -> Pose:
        if name == WORLD:
            return _inverse(self._model_in_world())
        if name not in self._frames:
            step = f"correct the name{nearest(name, self._frames)}"
            raise element.place.error(f"there is no frame {shown(name)}", step)
        return self._pose(name)

    def _end(self, joint: Element, scope: str, tag: str) -> str:
        """Return the link that a joint names, behind frames that are fixed to one."""
        found = joint.all(tag)
        text = found[0].text if found else ""
        if not text:
            raise joint.place.error(f"<joint> has no <{tag}>", f"write <{tag}>LINK</{tag}>")
        name = self._link_behind(WORLD if text == WORLD else scope + text)
        if name is None:
            raise joint.place.error(f"its {tag} {shown(text)} is fixed to itself", "correct attached_to")
        if name != WORLD and (name not in self._frames or self._frames[name][0].tag != "link"):
            links = [key for key, (one, _) in self._frames.items() if one.tag == "link"]
            step = f"write the name of a link{nearest(name, links)}"
            raise joint.place.error(f"its {tag} {shown(text)} is no link", step)
        return name

    def _link_behind(self, name: str) -> str | None:
        """Return what a name is fixed to, frame behind frame: a link or the world where it is sound; None in a ring."""
        for _ in range(100):
            if name not in self._frames or self._frames[name][0].tag != "frame":
                return name
            element, scope = self._frames[name]
            attached = element.attributes.get("attached_to", "")
            if attached in ("", "__model__"):
                return name
            name = WORLD if attached == WORLD else scope + attached
        return None

    def _link(self, name: str, element: Element, carrier: tuple[str, Element] | None) -> None:
        pose, origin = self._pose(name), np.zeros(3)
        if carrier is not None and kind_of_joint(carrier[1]) != "fixed":
            anchor = self._pose(carrier[0])
            origin = pose[0].T @ (pose[1] - anchor[1])
        inertia = inertia_of_link(element)
        self.found.links[name] = SdfLink(element, pose, origin)
        self.found.bodies[name] = None if inertia is None else inertia.moved(np.eye(3), origin)
        shapes = [shape_of(collision) for collision in element.all("collision")]
        self.found.shapes[name] = [shape.moved(np.eye(3), origin) for shape in shapes if shape is not None]

    def _link_frame(self, name: str, element: Element) -> Pose:
        """Return the frame of a link of the robot in that of the model."""
        if name == WORLD:
            return self._frame_of(WORLD, element)
        link = self.found.links[name]
        return link.pose[0], link.pose[1] - link.pose[0] @ link.origin

    def _joint(self, name: str, element: Element, scope: str) -> None:
        kind = kind_of_joint(element)
        parent, child = (self._end(element, scope, tag) for tag in ("parent", "child"))
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
            limits, mimic = limits_of_joint(element, holder), self._mimic(holder, scope)
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
        if expressed:
            return self._frame(expressed, scope, joint)[0] @ axis
        if self._version < (1, 5) or (self._version < (1, 7) and in_model):
            return self._frame("__model__", scope, joint)[0] @ axis
        return self._pose(name)[0] @ axis

    def _mimic(self, holder: Element, scope: str) -> Mimic | None:
        found = holder.all("mimic")
        if not found:
            return None
        values = Values(found[0].place, found[0].attributes)
        multiplier, offset, reference = (number_in(found[0], tag, 0.0) for tag in ("multiplier", "offset", "reference"))
        if multiplier == 0.0:
            raise values.place.error("multiplier 0 holds it still", "make the joint fixed, or correct the multiplier")
        return Mimic(scope + values.name("joint"), multiplier, offset - multiplier * reference)

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
        turn = self._model_in_world()[0]
        if len(roots) > 1 and WORLD in roots:
            loose = next(name for name in roots if name != WORLD)
            step = "fix it to the world or to another link with a joint, or remove it"
            raise self.found.links[loose].element.place.error("this link floats beside the one on the world", step)
        if len(roots) != 1 or roots[0] == WORLD:
            return self._gravity
        return (turn @ self.found.links[roots[0]].pose[0]).T @ self._gravity

    def _named(self, name: str) -> None:
        """Check a named frame, and keep it on the link that it is fixed to."""
        element, scope = self._frames[name]
        own = self._pose(name)
        if element.attributes.get("attached_to"):
            self._frame(element.attributes["attached_to"], scope, element)  # an unknown one is refused
        link = self._link_behind(name)
        if link is None:
            raise element.place.error("it is attached to itself, frame behind frame", "correct attached_to")
        if link in self.found.links:
            frame = self._link_frame(link, self._frames[link][0])
            self.found.frames[name] = link, (frame[0].T @ own[0], frame[0].T @ (own[1] - frame[1]))
