"""The tree of bodies of an MJCF: joints, frames, replicas and attached models, with the elements they come from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Final, Literal

import numpy as np

from dynident.arrays import Array
from dynident.errors import DescriptionError
from dynident.model.documents.numbers import shown
from dynident.model.inertia import Inertia
from dynident.model.joint import Drive, JointLimits, rotation_about
from dynident.model.robot import Frame
from dynident.model.shapes import Shape
from dynident.robot_files.mjcf.body_inertia import inertia_of_body, stated_body
from dynident.robot_files.mjcf.document import CompilerSettings, MjcfDocument
from dynident.robot_files.mjcf.poses import IDENTITY, Pose, placed, pose_of
from dynident.robot_files.mjcf.scope import Expansion, MjcfScope, Placed
from dynident.robot_files.tree import Connection, between_joints, numbered
from dynident.robot_files.xml_elements import MAX_LINKS, Element, Values

WORLD: Final = "world"

#: What a note calls a robot that floats; its joints have the torques of one on a fixed base.
LOOPS: Final = "loops of bodies are not read: a parallel robot, such as a Delta, cannot be identified"
FLOATING: Final = "the motion of floating bases, which are held still"

_FLEXIBLE: Final = {"composite": "a flexible body", "flexcomp": "a flexible body"}


@dataclass(frozen=True)
class JointSource:
    """A joint and where it is written.

    Attributes:
        element: Its element.
        armature: Rotor inertia that counts, in kg m^2 or kg.
        ref: Position at which the bodies are placed as written, in rad or m.
    """

    element: Element
    armature: float
    ref: float


@dataclass(frozen=True)
class BodySource:
    """A body and where it is written.

    Attributes:
        element: Its element.
        origin: Origin of the body's own frame in the frame of its link, shape (3,), in m.
        compiler: What holds for its inertia.
    """

    element: Element
    origin: Array
    compiler: CompilerSettings


@dataclass(frozen=True)
class MjcfTree:
    """What the elements of the world are.

    Attributes:
        bodies: Inertia of each body by name, about the origin of its link; None where nothing states one.
        shapes: Their shapes that touch.
        visuals: Those that touch nothing.
        connections: Their joints, fixed ones included.
        sites: Named frames: the body, rotation and translation in the frame of its link.
        joints: The joints that move, by name.
        sources: The bodies of the file, by name.
        motors: The actuators that give a joint armature or damping, by joint, with which of these each gives.
        driven: The joints that an actuator drives.
        scopes: Of the model and of those attached to it.
        curved: The joints with damping of second or third order.
        notes: What has a torque in MuJoCo and none here.
    """

    bodies: dict[str, Inertia | None] = field(default_factory=lambda: {WORLD: None})
    shapes: dict[str, list[Shape]] = field(default_factory=lambda: {WORLD: []})
    visuals: dict[str, list[Shape]] = field(default_factory=lambda: {WORLD: []})
    connections: list[Connection] = field(default_factory=list)
    sites: dict[str, tuple[str, Pose]] = field(default_factory=dict)
    joints: dict[str, JointSource] = field(default_factory=dict)
    sources: dict[str, BodySource] = field(default_factory=dict)
    motors: dict[str, list[tuple[Element, list[str]]]] = field(default_factory=dict)
    driven: set[str] = field(default_factory=set)
    scopes: list[MjcfScope] = field(default_factory=list)
    curved: set[str] = field(default_factory=set)
    notes: dict[str, list[str]] = field(default_factory=dict)

    def note(self, what: str, name: str) -> None:
        """Keep that a thing has something that is not read."""
        self.notes.setdefault(what, []).append(name)

    def frames(self, links: Mapping[str, Frame]) -> dict[str, Frame]:
        """Return the sites as frames, from the place of each body on a link."""
        on = [(name, links[body], pose) for name, (body, pose) in self.sites.items()]
        return {name: Frame(link.link, *placed((link.rotation, link.translation), pose)) for name, link, pose in on}


@dataclass(frozen=True)
class _Carrier:
    """The body that elements stand in.

    Attributes:
        name: Its name.
        origin: Origin of its frame in the frame of its link, shape (3,), in m.
    """

    name: str
    origin: Array


def read_tree(document: MjcfDocument) -> MjcfTree:
    """Return the bodies and joints of a model.

    Raises:
        DescriptionError: Any fault; the message names the file, the line and the element.
    """
    return _TreeReader(document).tree


class _TreeReader:
    """Walks through the world from the top."""

    def __init__(self, document: MjcfDocument) -> None:
        self._document, self._expansion = document, Expansion(document)
        self.tree = MjcfTree()
        self._moving = 0
        self._loose: list[DescriptionError] = []
        self._given = {
            one.attributes.get("name", "") for world in document.sections["worldbody"] for one in world.below()
        }
        self._inside(self._expansion.world(), _Carrier(WORLD, np.zeros(3)))
        self.tree.scopes.extend(self._expansion.scopes)
        if self._loose and not self.tree.joints:
            raise self._loose[0]

    def _inside(self, children: list[Placed], carrier: _Carrier) -> None:
        """Read what stands in a body beside its joints and inertia."""
        for child, frame, scope in children:
            if child.tag in _FLEXIBLE:
                step = "remove it, or write rigid bodies: arms of rigid links are read"
                raise child.place.error(f"<{child.tag}> is {_FLEXIBLE[child.tag]}", step)
            if child.tag == "body":
                self._body(child, frame, scope, carrier)
            elif child.tag == "site":
                self._site(child, frame, scope, carrier)
            elif child.tag == "geom":
                shape, touches = scope.geoms.shape(child, scope.childclass, frame)
                if shape is not None:
                    held = (self.tree.shapes if touches else self.tree.visuals)[carrier.name]
                    held.append(shape.moved(np.eye(3), carrier.origin))
            elif carrier.name == WORLD and child.tag in ("joint", "freejoint", "inertial"):
                raise child.place.error("it stands in the world, which does not move", "put it into a <body>")

    def _site(self, element: Element, frame: Pose, scope: MjcfScope, carrier: _Carrier) -> None:
        values = scope.defaults.values(element, scope.childclass)
        if not element.attributes.get("name"):
            return
        name = scope.named(values.name("name"))
        scope.keep("site", name)
        if "fromto" in values:
            return
        rotation, translation = placed(frame, pose_of(values, scope.document.compiler))
        self.tree.sites.setdefault(name, (carrier.name, (rotation, translation + carrier.origin)))

    def _body(self, element: Element, frame: Pose, scope: MjcfScope, carrier: _Carrier) -> None:
        values = Values(element.place, element.attributes)
        scope = scope.inner(element)
        name = self._named(values, scope, "body", len(self.tree.sources))
        if name in self.tree.bodies:
            step = "give each body a name of its own"
            raise values.place.error(f"a second body is called {shown(name)}", step)
        if len(self.tree.bodies) > MAX_LINKS:
            raise values.place.error(f"more than {MAX_LINKS} bodies", "give the MJCF of one robot")
        if values.number("gravcomp", 0.0):
            self.tree.note("gravity compensation of bodies", name)
        children = list(self._expansion.flat(element, IDENTITY, scope))
        self._check_free(element, children, name, carrier)
        rotation, translation = placed(frame, pose_of(values, scope.document.compiler))
        joints = [one for one in children if one[0].tag == "joint" and _kind(one) != "free"]
        inertia = self._inertia(element, children, scope)
        origin = self._connect(name, joints, (rotation, translation + carrier.origin), carrier, inertia)
        self.tree.bodies[name] = None if inertia is None else inertia.moved(np.eye(3), origin)
        self.tree.shapes[name], self.tree.visuals[name] = [], []
        self.tree.sources[name] = BodySource(element, origin, scope.document.compiler)
        self._inside(children, _Carrier(name, origin))

    def _named(self, values: Values, scope: MjcfScope, word: str, before: int) -> str:
        """Return the name of an element; one without a name gets the word with the first free number."""
        if values.text("name", ""):
            name = scope.named(values.name("name"))
            scope.keep(word, name)
            return name
        taken = {*self._given, *self.tree.bodies, *self.tree.joints}
        return numbered(word, before + 1, taken)

    def _check_free(self, body: Element, children: list[Placed], name: str, carrier: _Carrier) -> None:
        """Refuse a ball joint; what floats freely, the base of a robot or an object beside it, is held where it is."""
        for child in children:
            kind, place = _kind(child), child[0].place
            if kind == "free":
                step = "remove the joint to fix the base, or remove the body if it is no part of the robot"
                error = place.error(f"body {shown(name)} floats freely: arms on a fixed base are read", step)
                if carrier.name != WORLD:
                    raise error
                self._loose.append(error)
                self._moving += 1
                inside = {one.tag for one in body.below() if one is not child[0]}
                self.tree.note(FLOATING if {"joint", "attach"} & inside else "bodies that float freely", name)
            if kind == "ball":
                ties = [one for one in self._document.each("equality") if one.tag in ("connect", "weld")]
                if any(one.attributes.get("active", "true") != "false" for one in ties):
                    raise place.error(
                        f"a ball joint in a robot with an equality <{ties[0].tag}>, a loop of bodies", LOOPS
                    )
                raise place.error("a ball joint has three degrees of freedom", "replace it by three hinges")

    def _inertia(self, body: Element, children: list[Placed], scope: MjcfScope) -> Inertia | None:
        compiler = scope.document.compiler
        inertials = [child for child, _, _ in children if child.tag == "inertial"]
        if len(inertials) > 1:
            raise inertials[1].place.error("a second <inertial> in one body", "keep one of the two")
        if inertials and inertials[0] not in body.children:
            raise inertials[0].place.error("an <inertial> in a frame", "move it out of the <frame>, with its pos")
        stated = stated_body(inertials[0], compiler) if inertials else None
        geoms: list[Inertia] = []
        if compiler.from_geoms == "true" or (compiler.from_geoms == "auto" and stated is None):
            for child, frame, inner in children:
                if child.tag == "geom":
                    found = inner.geoms.body(child, inner.childclass, frame, compiler.groups)
                    geoms += [] if found is None else [found]
        place = Values(body.place, body.attributes)
        return inertia_of_body(stated, geoms, compiler, place.numbers("pos", 3) if "pos" in place else np.zeros(3))

    def _connect(self, body: str, joints: list[Placed], pose: Pose, carrier: _Carrier, own: Inertia | None) -> Array:
        """Add the joints of a body, and return where its origin is in the frame of its link."""
        rotation, translation = pose
        if not joints:
            fixed = np.array([0.0, 0.0, 1.0])
            name = f"{body} (fixed)"
            joint = Connection(name, "fixed", carrier.name, body, rotation, translation, fixed, JointLimits())
            self.tree.connections.append(joint)
            return np.zeros(3)
        parent, at = carrier.name, np.zeros(3)
        for number, (element, frame, scope) in enumerate(joints):
            is_last = number == len(joints) - 1
            joint, anchor = self._joint(element, frame, scope, (rotation, translation, at))
            child = body if is_last else f"{body} before joint {len(self.tree.joints) + 1}"
            if not is_last:
                self.tree.bodies[child] = between_joints(own)
            self.tree.connections.append(replace(joint, parent=parent, child=child))
            parent, rotation, translation, at = child, np.eye(3), np.zeros(3), anchor
        return -at

    def _joint(
        self, element: Element, frame: Pose, scope: MjcfScope, place: tuple[Array, Array, Array]
    ) -> tuple[Connection, Array]:
        """Return a joint without its bodies, and its anchor in the frame of its body."""
        values = scope.defaults.values(element, scope.childclass)
        self._moving += 1
        name = self._named(values, scope, "joint", self._moving - 1)
        if name in self.tree.joints:
            raise values.place.error(f"a second joint is called {shown(name)}", "give each joint a name of its own")
        kind: Literal["revolute", "prismatic"] = "revolute"
        if values.choice("type", ("hinge", "slide"), "hinge") == "slide":
            kind = "prismatic"
        unit = scope.document.compiler.unit if kind == "revolute" else 1.0
        anchor = frame[1] + frame[0] @ (values.numbers("pos", 3) if "pos" in values else np.zeros(3))
        axis = values.numbers("axis", 3) if "axis" in values else np.array([0.0, 0.0, 1.0])
        if np.linalg.norm(axis) < 1e-9:
            raise values.place.error(f"axis {shown(values.text('axis'))} has no direction", "write it as '0 0 1'")
        axis = frame[0] @ axis / np.linalg.norm(axis)
        ref = unit * values.number("ref", 0.0)
        rotation, translation, at = place
        translation = translation + rotation @ (anchor - at)
        if kind == "revolute":
            rotation = rotation @ rotation_about(axis, -ref)
        else:
            translation = translation - ref * rotation @ axis
        self.tree.joints[name] = JointSource(element, values.at_least_zero("armature", 0.0), ref)
        joint = Connection(
            name, kind, "", "", rotation, translation, axis, _limits(values, scope, unit),
            damping=self._damping(values, name), friction=values.at_least_zero("frictionloss", 0.0),
            drive=Drive(rotor_inertia=values.at_least_zero("armature", 0.0)),
        )  # fmt: skip
        return joint, anchor

    def _damping(self, values: Values, name: str) -> float:
        """Return the viscous damping; what follows another law is noted."""
        if "stiffness" in values and np.any(values.numbers("stiffness", 1, 3)):
            self.tree.note("springs of joints", name)
        if "springdamper" in values and np.all(values.numbers("springdamper", 2) > 0.0):
            self.tree.note("springdamper of joints", name)
            return 0.0
        damping = values.numbers("damping", 1, 3) if "damping" in values else np.zeros(1)
        if np.any(damping < 0.0):
            raise values.place.error(f"damping {shown(values.text('damping'))} is negative", "write 0 or more")
        if np.any(damping[1:]):
            self.tree.curved.add(name)
            self.tree.note("damping of second and third order", name)
        return float(damping[0])


def _kind(child: Placed) -> str:
    """Return what kind of joint an element is, empty for another."""
    element, _, scope = child
    if element.tag == "joint":
        return scope.defaults.values(element, scope.childclass).text("type", "hinge")
    return "free" if element.tag == "freejoint" else ""


def _limits(values: Values, scope: MjcfScope, unit: float) -> JointLimits:
    """Return the limits of position and torque that a joint states."""
    lower, upper = -np.inf, np.inf
    if is_limited(values, scope, "limited", "range"):
        lower, upper = unit * values.numbers("range", 2)
        if not lower < upper:
            step = "exchange the two numbers"
            raise values.place.error(f"range {shown(values.text('range'))} ends below its start", step)
    effort = np.inf
    if is_limited(values, scope, "actuatorfrclimited", "actuatorfrcrange"):
        effort = float(np.abs(values.numbers("actuatorfrcrange", 2)).max())
    return JointLimits(lower=float(lower), upper=float(upper), effort=effort)


def is_limited(values: Values, scope: MjcfScope, flag: str, bounds: str) -> bool:
    """Return whether a range is a limit, by the flag for it or by itself.

    Raises:
        DescriptionError: It has no flag, and a range alone makes no limit by the settings of the model.
    """
    word = values.choice(flag, ("true", "false", "auto"), "auto")
    if word == "auto" and bounds in values and not scope.document.compiler.autolimits:
        if np.any(values.numbers(bounds, 2)):
            step = f'write {flag}="true", or autolimits="true" in <compiler>'
            raise values.place.error(f"{bounds} without {flag} where autolimits is false", step)
        return False
    if word == "auto" and bounds in values:
        lower, upper = values.numbers(bounds, 2)
        return bool(lower < upper)  # as MuJoCo has it: a range that ends below its start is none
    return word == "true"
