"""URDF <-> Robot: a strict reader of its own, so that no fault of the file reaches an engine unseen."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import PurePath
from typing import ClassVar, Final, Literal, TypeAlias, final

import numpy as np

from dynident.arrays import Array
from dynident.errors import DescriptionError, nearest
from dynident.model.documents.numbers import Place, check_name, check_order, decimal, shown
from dynident.model.inertia import Inertia
from dynident.model.joint import JointLimits, Mimic
from dynident.model.robot import Robot
from dynident.model.shapes import Box, Capsule, Cylinder, Mesh, Shape, Sphere
from dynident.robot_files.formats.base import Description
from dynident.robot_files.rotations import rotation_from_quaternion, rotation_from_rpy
from dynident.robot_files.tree import Connection, assemble, some
from dynident.robot_files.xml_elements import Element, XmlLanguage, parse_xml

_Shapes: TypeAlias = dict[str, list[Shape]]
_KINDS: Final[dict[str, Literal["fixed", "revolute", "prismatic"]]] = {
    "fixed": "fixed",
    "revolute": "revolute",
    "continuous": "revolute",
    "prismatic": "prismatic",
}
_UNREAD_KINDS: Final = ("planar", "floating")
_GEOMETRIES: Final = ("box", "sphere", "cylinder", "capsule", "mesh")
_TENSOR: Final = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")


@final
@dataclass(frozen=True)
class Urdf(Description):
    """URDF, the robot model of ROS (specification 1.0 to 1.2).

    Read: links with ``<inertial>``, ``<collision>`` and ``<visual>`` (box, sphere, cylinder, capsule, name of a mesh),
    joints (fixed, revolute, continuous, prismatic), ``<origin>`` with rpy or quat_xyzw, ``<axis>``, ``<limit>`` with
    acceleration, deceleration and jerk, ``<dynamics>``, ``<mimic>``. The rest is passed over
    (gazebo, transmission, ...).

    Choices where the format leaves room:

    * The inertia of a link and of all that is fixed to it are added up; a link is of unknown inertia (None) where
      none of them has ``<inertial>``. What is fixed to the base does not move and is a frame only. Shapes go with
      the link or the base that carries them.
    * An inertia tensor that no body can have is kept: ``Inertia.defect`` says why it is none.
    * The position limits of a continuous joint are passed over; a missing bound of the others is 0 when one is
      stated (specification 1.0). Where none is, the joint has no position limits, and ``Robot.note`` names it. Other
      missing limits are infinite, not zero.
    * The acceleration limit is the smaller of acceleration and deceleration.
    * Of two ``<origin>`` in one joint or inertial the first counts, as urdfdom reads it; ``Robot.note``
      says so. Any other element that is there twice is an error.
    """

    suffixes: ClassVar[tuple[str, ...]] = (".urdf", ".xacro")
    opening: ClassVar[bytes] = b"<"
    roots: ClassVar[tuple[str, ...]] = ("robot",)

    def read(self, path: object, data: bytes) -> Robot:
        return _Reader(path).robot(parse_urdf(path, data))


def read_urdf(path: object, data: bytes) -> Robot:
    """Return the robot of the URDF text ``data``; ``path`` is what messages call it.

    Raises:
        DescriptionError: Any fault; the message names the line, the link or the joint.
    """
    return Urdf().read(path, data)


def read_urdf_bodies(path: object, data: bytes) -> tuple[dict[str, Inertia | None], list[Connection]]:
    """Return the bodies of a URDF by name, none merged, with their own inertia, and all its joints in file order.

    Raises:
        DescriptionError: Any fault of the file.
    """
    _, bodies, *_, connections = _Reader(path).parts(parse_urdf(path, data))
    return bodies, connections


class _Reader:
    """Reads the elements of one file; collects what the note must say."""

    def __init__(self, path: object) -> None:
        self._path = path
        self._notes: list[str] = []
        self._unbounded: list[str] = []

    def robot(self, root: Element) -> Robot:
        """Return the robot of the ``<robot>`` element."""
        name, bodies, shapes, visuals, connections = self.parts(root)
        notes = [f"read from {PurePath(str(self._path)).name}", *self._notes]
        if self._unbounded:
            notes.append(f"no position limits of {some(self._unbounded)}: neither lower nor upper in <limit>")
        note = "; ".join(notes)
        return assemble(self._path, name, bodies, connections, note, shapes, visuals)

    def parts(self, root: Element) -> tuple[str, dict[str, Inertia | None], _Shapes, _Shapes, list[Connection]]:
        """Return the name of the ``<robot>`` element, its bodies with inertias, shapes and visuals, and its joints."""
        name = self._attribute(Place(self._path, f"line {root.line}"), root, "name")
        bodies: dict[str, Inertia | None] = {}
        shapes: _Shapes = {}
        visuals: _Shapes = {}
        for element in root.all("link"):
            link = self._attribute(Place(self._path, f"line {element.line}"), element, "name")
            if link in bodies:
                raise self._twice("link", link, element.line)
            place = Place(self._path, f"link {shown(link)}")
            bodies[link] = self._inertia(place, element)
            shapes[link] = [self._shape(place, collision) for collision in element.all("collision")]
            visuals[link] = [shape for one in element.all("visual") if (shape := self._visual(place, one)) is not None]
        if not bodies:
            raise Place(self._path).error("no <link> in <robot>", "give the URDF of a robot")
        connections = [self._joint(element, bodies) for element in root.all("joint")]
        seen: set[str] = set()
        for joint, element in zip(connections, root.all("joint"), strict=True):
            if joint.name in seen:
                raise self._twice("joint", joint.name, element.line)
            seen.add(joint.name)
        return name, bodies, shapes, visuals, connections

    def _twice(self, what: str, name: str, line: int) -> Exception:
        place = Place(self._path, f"line {line}")
        return place.error(f"a second {what} is called {shown(name)}", f"give each {what} a name of its own")

    def _inertia(self, place: Place, link: Element) -> Inertia | None:
        """Return the inertia of a link about its frame's origin in its axes, None where the file has none."""
        inertial = self._only(place, link, "inertial")
        if inertial is None:
            return None
        mass = self._number(place, self._needed(place, inertial, "mass"), "value")
        if mass < 0:
            raise place.error(f"mass value {mass:g} is negative", "write the mass in kg, 0 or more")
        tensor_element = self._needed(place, inertial, "inertia")
        ixx, ixy, ixz, iyy, iyz, izz = (self._number(place, tensor_element, name) for name in _TENSOR)
        tensor = np.array([[ixx, ixy, ixz], [ixy, iyy, iyz], [ixz, iyz, izz]])
        rotation, centre = self._pose(place, inertial)
        return Inertia.from_centre_of_mass(mass, centre, rotation @ tensor @ rotation.T)

    def _shape(self, place: Place, collision: Element) -> Shape:
        """Return the shape of a ``<collision>`` in the frame of its link."""
        geometry = self._needed(place, collision, "geometry")
        kinds = ", ".join(f"<{kind}>" for kind in _GEOMETRIES)
        if len(geometry.children) != 1:
            evidence = (
                f"the <geometry> of a <collision> has {len(geometry.children)} known shapes (line {geometry.line})"
            )
            raise place.error(evidence, f"write one of {kinds} in it, or remove the <collision>")
        (element,) = geometry.children
        rotation, translation = self._pose(place, collision)
        if element.tag == "mesh":
            scale = self._numbers(place, element, "scale", 3) if "scale" in element.attributes else np.ones(3)
            if np.any(scale == 0.0):
                raise place.error(f"mesh scale {shown(element.attributes['scale'])} has a zero", "write three factors")
            return Mesh(self._attribute(place, element, "filename"), scale, rotation, translation)
        if element.tag == "box":
            size = self._numbers(place, element, "size", 3)
            if np.any(size <= 0.0):
                text = shown(element.attributes["size"])
                raise place.error(f"box size {text} has an edge that is not above 0", "write three lengths in m")
            return Box(size, rotation, translation)
        radius = self._above_zero(place, element, "radius")
        if element.tag == "sphere":
            return Sphere(radius, translation)
        length = self._above_zero(place, element, "length")
        if element.tag == "cylinder":
            return Cylinder(radius, length, rotation, translation)
        tip = 0.5 * length * rotation[:, 2]
        return Capsule(translation - tip, translation + tip, radius)

    def _visual(self, place: Place, visual: Element) -> Shape | None:
        """Return the shape of a ``<visual>``; None for a faulty one: nothing moves or stops by it."""
        try:
            return self._shape(place, visual)
        except DescriptionError:
            return None

    def _joint(self, element: Element, bodies: dict[str, Inertia | None]) -> Connection:
        name = self._attribute(Place(self._path, f"line {element.line}"), element, "name")
        place = Place(self._path, f"joint {shown(name)}")
        word = self._attribute(place, element, "type")
        if word in _UNREAD_KINDS:
            raise place.error(
                f"type {shown(word)} has more than one degree of freedom",
                "replace it by revolute and prismatic joints, or that of a base by a fixed one: the base has to rest "
                "in the logs",
            )
        if word not in _KINDS:
            step = f"choose one of: {', '.join(_KINDS)}{nearest(word.lower(), _KINDS)}"
            raise place.error(f"type {shown(word)} is not known", step)
        ends = []
        for tag in ("parent", "child"):
            link = self._attribute(place, self._needed(place, element, tag), "link")
            if link not in bodies:
                step = f"add the link, or correct the name{nearest(link, bodies)}"
                raise place.error(f"its {tag} link {shown(link)} is not in the file", step)
            ends.append(link)
        kind = _KINDS[word]
        damping, friction = self._dynamics(place, element)
        rotation, translation = self._pose(place, element)
        return Connection(
            name, kind, ends[0], ends[1], rotation, translation, self._axis(place, element, kind),
            self._limits(place, element, word, name), self._mimic(place, element, kind), damping, friction,
        )  # fmt: skip

    def _axis(self, place: Place, joint: Element, kind: str) -> Array:
        element = self._only(place, joint, "axis")
        if kind == "fixed" or element is None:
            return np.array([1.0, 0.0, 0.0])  # the default of the format
        axis = self._numbers(place, element, "xyz", 3)
        if np.linalg.norm(axis) < 1e-9:
            raise place.error(f"axis xyz {shown(element.attributes['xyz'])} has no direction", "write it as '0 0 1'")
        return axis  # the joint normalises it

    def _limits(self, place: Place, joint: Element, word: str, name: str) -> JointLimits:
        element = self._only(place, joint, "limit")
        if word == "fixed":
            return JointLimits()
        given = {} if element is None else element.attributes
        lower, upper = -math.inf, math.inf
        if word != "continuous" and "lower" not in given and "upper" not in given:
            self._unbounded.append(name)
        elif word != "continuous" and element is not None:
            lower = self._number(place, element, "lower", "0", unbounded=True)
            upper = self._number(place, element, "upper", "0", unbounded=True)
            check_order(place, lower, upper)
        if element is None:
            return JointLimits()
        rest = {
            name: self._at_least_zero(place, element, name, "inf", unbounded=True)
            for name in ("velocity", "acceleration", "deceleration", "jerk", "effort")
        }
        acceleration = min(rest["acceleration"], rest["deceleration"])
        return JointLimits(lower, upper, rest["velocity"], acceleration, rest["jerk"], rest["effort"])

    def _dynamics(self, place: Place, joint: Element) -> tuple[float | None, float | None]:
        element = self._only(place, joint, "dynamics")
        damping, friction = (
            None if element is None or name not in element.attributes else self._at_least_zero(place, element, name)
            for name in ("damping", "friction")
        )
        return damping, friction

    def _mimic(self, place: Place, joint: Element, kind: str) -> Mimic | None:
        element = self._only(place, joint, "mimic")
        if element is None or kind == "fixed":
            return None
        multiplier = self._number(place, element, "multiplier", "1")
        if multiplier == 0:
            raise place.error("mimic multiplier 0 holds it still", "make the joint fixed, or correct the multiplier")
        return Mimic(self._attribute(place, element, "joint"), multiplier, self._number(place, element, "offset", "0"))

    def _pose(self, place: Place, element: Element) -> tuple[Array, Array]:
        """Return rotation and translation of the ``<origin>`` of a joint or inertial; identity without one."""
        origins = element.all("origin")
        if not origins:
            return np.eye(3), np.zeros(3)
        if len(origins) > 1:
            self._notes.append(f"{place.where}: the first of {len(origins)} <origin> counts")
        origin = origins[0]
        translation = self._numbers(place, origin, "xyz", 3) if "xyz" in origin.attributes else np.zeros(3)
        if "quat_xyzw" in origin.attributes:
            if "rpy" in origin.attributes:
                raise place.error("origin has both rpy and quat_xyzw", "keep one of the two")
            return self._quaternion(place, origin), translation
        if "rpy" in origin.attributes:
            return rotation_from_rpy(self._numbers(place, origin, "rpy", 3)), translation
        return np.eye(3), translation

    def _quaternion(self, place: Place, origin: Element) -> Array:
        quaternion = self._numbers(place, origin, "quat_xyzw", 4)
        length = float(np.linalg.norm(quaternion))
        if abs(length - 1.0) > 1e-3:
            text = shown(origin.attributes["quat_xyzw"])
            raise place.error(
                f"origin quat_xyzw {text} has length {length:.4g}, not 1", "write a unit quaternion x y z w"
            )
        x, y, z, w = quaternion / length
        return rotation_from_quaternion([w, x, y, z])

    def _only(self, place: Place, element: Element, tag: str) -> Element | None:
        found = element.all(tag)
        if len(found) > 1:
            raise place.error(f"{len(found)} <{tag}> elements (lines {_lines(found)})", "keep one of them")
        return found[0] if found else None

    def _needed(self, place: Place, element: Element, tag: str) -> Element:
        found = self._only(place, element, tag)
        if found is None:
            raise place.error(f"<{element.tag}> has no <{tag}>", f"add <{tag} .../> (line {element.line})")
        return found

    def _attribute(self, place: Place, element: Element, name: str) -> str:
        text = element.attributes.get(name)
        if text is None:
            raise place.error(f"<{element.tag}> has no attribute '{name}'", f'write <{element.tag} {name}="...">')
        return check_name(place, f"{element.tag} {name}", text)

    def _text(self, place: Place, element: Element, name: str, default: str | None) -> str:
        text = element.attributes.get(name, default)
        if text is None:
            raise place.error(f"<{element.tag}> has no attribute '{name}'", f'write <{element.tag} {name}="...">')
        return text

    def _number(
        self, place: Place, element: Element, name: str, default: str | None = None, *, unbounded: bool = False
    ) -> float:
        text = self._text(place, element, name, default)
        return decimal(place, f"{element.tag} {name}", text, unbounded=unbounded)

    def _at_least_zero(
        self, place: Place, element: Element, name: str, default: str | None = None, *, unbounded: bool = False
    ) -> float:
        value = self._number(place, element, name, default, unbounded=unbounded)
        if value < 0:
            raise place.error(f"{element.tag} {name} {value:g} is negative", "write 0 or more")
        return value

    def _above_zero(self, place: Place, element: Element, name: str) -> float:
        value = self._number(place, element, name)
        if value <= 0:
            raise place.error(f"{element.tag} {name} {value:g} is not above 0", "write a length in m")
        return value

    def _numbers(self, place: Place, element: Element, name: str, count: int) -> Array:
        text = self._text(place, element, name, None)
        words = text.split()
        if len(words) != count:
            step = f"write {count} numbers with spaces between them"
            raise place.error(f"{element.tag} {name} {shown(text)} is not {count} numbers", step)
        return np.array([decimal(place, f"{element.tag} {name}", word) for word in words])


def _lines(elements: Sequence[Element]) -> str:
    return ", ".join(str(element.line) for element in elements)


#: What is read of each element. Everything else (gazebo, transmission, ...) is passed over.
_CHILDREN: Final[Mapping[str, frozenset[str]]] = {
    "robot": frozenset({"link", "joint"}),
    "link": frozenset({"inertial", "collision", "visual"}),
    "collision": frozenset({"origin", "geometry"}),
    "visual": frozenset({"origin", "geometry"}),
    "geometry": frozenset({"box", "sphere", "cylinder", "capsule", "mesh"}),
    "inertial": frozenset({"origin", "mass", "inertia"}),
    "joint": frozenset({"origin", "parent", "child", "axis", "limit", "dynamics", "mimic"}),
    # Values that some writers put into elements of their own, where no reader sees them.
    "mass": frozenset({"value"}),
    "axis": frozenset({"xyz"}),
    "limit": frozenset({"lower", "upper", "effort", "velocity", "acceleration", "deceleration", "jerk"}),
    "dynamics": frozenset({"damping", "friction"}),
    "mimic": frozenset({"multiplier", "offset"}),
}
_STEP_XACRO: Final = "expand it first: xacro file.xacro > file.urdf"


def parse_urdf(path: object, data: bytes) -> Element:
    """Return the ``<robot>`` element of a URDF with the elements that are read.

    Raises:
        DescriptionError: No XML, a document type or entity, a xacro file, another root element, too deep, too many
            links.
    """
    return parse_xml(path, data, _URDF)


def _check_name(place: Place, name: str) -> None:
    if name.startswith("xacro:"):
        raise place.error(f"<{name}> makes this a xacro file, not a URDF", _STEP_XACRO)


def _check_element(place: Place, element: Element, parent: Element | None) -> None:
    for name, text in element.attributes.items():
        if "${" in text or "$(" in text:
            raise place.error(f"{name}={shown(text)} makes this a xacro file, not a URDF", _STEP_XACRO)
    if parent is not None and parent.tag in ("mass", "axis", "limit", "dynamics", "mimic"):
        step = f'write an attribute: <{parent.tag} {element.tag}="...">'
        raise place.error(f"<{element.tag}> is an element of <{parent.tag}>, which no reader sees", step)


_URDF: Final = XmlLanguage("URDF", ("robot",), "link", _CHILDREN, _check_name, _check_element)
