"""Denavit-Hartenberg tables in YAML: standard (distal) or modified (proximal, Craig), never guessed which."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Final, Literal, final

import numpy as np

from dynident.arrays import Array
from dynident.model.documents.sections import LIMITS, Section, read_coupling, read_drive, read_limits
from dynident.model.inertia import Inertia
from dynident.model.joint import Joint
from dynident.model.robot import STANDARD_GRAVITY, Frame, Link, Robot
from dynident.robot_files.formats.base import Description
from dynident.robot_files.rotations import rotation_from_rpy
from dynident.robot_files.strict_yaml import load_yaml

_ROBOT: Final = ("name", "convention", "gravity", "joints", "tool", "coupling", "note")
_JOINT: Final = (
    "name", "kind", "a", "alpha", "d", "theta", "offset", "limits", "drive", "damping", "friction", "link",
)  # fmt: skip
_DRIVE: Final = ("gear_ratio", "rotor_inertia", "gain", "bias", "gain_std", "gain_deviation")
_LINK: Final = ("name", "inertia")
_INERTIA: Final = ("mass", "centre_of_mass", "about_centre", "parameters")
_TOOL: Final = ("name", "translation", "rpy")
_CONVENTIONS: Final = (
    "write 'convention: standard' (a, alpha after the joint) or 'convention: modified' (before it, Craig)"
)

Pose = tuple[Array, Array]


@final
@dataclass(frozen=True)
class DenavitHartenberg(Description):
    """A serial arm as a DH table in YAML, in SI units and rad; products such as ``-pi/2`` are numbers.

    Keys: ``name``, ``convention`` (no default), ``joints``, and where wanted ``gravity`` (in frame 0), ``tool``
    (``name``, ``translation``, ``rpy`` in the last DH frame), ``coupling``, ``note``. A joint has ``name``, ``kind``
    (revolute or prismatic), ``a``, ``alpha``, ``d``, ``theta``, ``offset``, ``limits``, ``drive``, ``damping``,
    ``friction`` and ``link`` (``name``, ``inertia``). ``a``, ``alpha`` and the constant one of ``d`` and ``theta`` must
    be there; the one that the joint moves is the value at q = 0 and defaults to 0. ``offset`` is added to it.

    Modified (Craig 2005, (3.6)): frame i stands in frame i-1 at Rx(alpha) Tx(a) Rz(theta) Tz(d); joint i moves
    about or along its z axis. The frame of link i is DH frame i.

    Standard (Spong, Hutchinson and Vidyasagar 2006, (3.10)): Rz(theta) Tz(d) Tx(a) Rx(alpha); joint i moves about or
    along z of frame i-1, so DH frame i is not on the axis of joint i. The frame of link i is therefore the frame i-1
    as joint i carries it along, at q = 0 equal to DH frame i-1. DH frame i is fixed to link i and is kept as the frame
    ``<link>_dh``. Inertia in the file is about DH frame i and is carried over; identified parameters are about the
    link frame.

    Inertia: either ``mass``, ``centre_of_mass`` and ``about_centre`` (Ixx Ixy Ixz Iyy Iyz Izz about the centre of
    mass, in the axes of DH frame i), or ``parameters``, ten numbers about the origin of DH frame i in the order of
    ``TEN``. The latter may be of no possible body, since identified ones may be.
    """

    suffixes: ClassVar[tuple[str, ...]] = (".yaml", ".yml")

    def read(self, path: object, data: bytes) -> Robot:
        value, lines = load_yaml(path, data)
        return _robot(Section.top(path, value, _ROBOT, lines))


def read_dh(path: object, data: bytes) -> Robot:
    """Return the robot of the DH table ``data`` in YAML; ``path`` is what messages call it.

    Raises:
        DescriptionError: Any fault; the message names the line and the key path.
    """
    return DenavitHartenberg().read(path, data)


def modified_pose(a: float, alpha: float, d: float, theta: float) -> Pose:
    """Return rotation and translation of Rx(alpha) Tx(a) Rz(theta) Tz(d) (Craig 2005, (3.6))."""
    ca, sa, ct, st = np.cos(alpha), np.sin(alpha), np.cos(theta), np.sin(theta)
    rotation = np.array([[ct, -st, 0.0], [st * ca, ct * ca, -sa], [st * sa, ct * sa, ca]])
    return rotation, np.array([a, -d * sa, d * ca])


def standard_pose(a: float, alpha: float, d: float, theta: float) -> Pose:
    """Return rotation and translation of Rz(theta) Tz(d) Tx(a) Rx(alpha) (Spong et al. 2006, (3.10))."""
    ca, sa, ct, st = np.cos(alpha), np.sin(alpha), np.cos(theta), np.sin(theta)
    rotation = np.array([[ct, -st * ca, st * sa], [st, ct * ca, -ct * sa], [0.0, sa, ca]])
    return rotation, np.array([a * ct, a * st, d])


def _robot(table: Section) -> Robot:
    table.value("convention", _CONVENTIONS)
    modified = table.choice("convention", ("standard", "modified"), step=_CONVENTIONS) == "modified"
    rows = table.sections("joints", _JOINT)
    if not rows:
        raise table.place("joints").error("the list is empty", "write one item for each joint")
    joints: list[Joint] = []
    links: list[Link] = []
    frames: dict[str, Frame] = {}
    before: Pose = (np.eye(3), np.zeros(3))  # where the next joint stands in the link before it
    for i, row in enumerate(rows):
        own = row.section("link", _LINK)
        name = own.name("name", f"link{i + 1}")
        pose = (modified_pose if modified else standard_pose)(*_row(row))
        inertia = _inertia(own.section("inertia", _INERTIA)) if own.has("inertia") else None
        if modified:
            joints.append(_joint(row, i, pose))
        else:
            joints.append(_joint(row, i, before))
            before = pose
            frames[f"{name}_dh"] = Frame(i, *pose)
            inertia = None if inertia is None else inertia.moved(*pose)
        links.append(Link(name, inertia))
    _check_unique(table, [joint.name for joint in joints], [link.name for link in links])
    end: Pose = (np.eye(3), np.zeros(3)) if modified else before
    tool = "" if modified else f"{links[-1].name}_dh"
    if table.has("tool"):
        tool = _tool(table.section("tool", _TOOL), len(links) - 1, end, frames, links)
    return Robot(
        table.name("name"),
        tuple(links),
        tuple(joints),
        table.numbers("gravity", 3, STANDARD_GRAVITY),
        frames=frames,
        tool=tool,
        coupling=read_coupling(table, len(joints)) if table.has("coupling") else None,
        note=table.text("note", "").strip(),
    )


def _row(row: Section) -> tuple[float, float, float, float]:
    """Return a, alpha, d and theta at q = 0."""
    prismatic = _kind(row) == "prismatic"
    a, alpha = row.number("a"), row.number("alpha")
    offset = row.number("offset", 0.0)
    if prismatic:
        return a, alpha, row.number("d", 0.0) + offset, row.number("theta")
    return a, alpha, row.number("d"), row.number("theta", 0.0) + offset


def _kind(row: Section) -> Literal["revolute", "prismatic"]:
    return "prismatic" if row.choice("kind", ("revolute", "prismatic"), "revolute") == "prismatic" else "revolute"


def _joint(row: Section, i: int, pose: Pose) -> Joint:
    return Joint(
        row.name("name", f"joint{i + 1}"),
        _kind(row),
        i - 1,
        *pose,
        axis=np.array([0.0, 0.0, 1.0]),
        limits=read_limits(row.section("limits", LIMITS)),
        drive=read_drive(row.section("drive", _DRIVE)),
        damping=row.at_least_zero("damping") if row.has("damping") else None,
        friction=row.at_least_zero("friction") if row.has("friction") else None,
    )


def _inertia(section: Section) -> Inertia:
    """Return the inertia that a section states, about the origin of its DH frame."""
    if section.has("parameters"):
        for key in _INERTIA[:3]:
            if section.has(key):
                raise section.place(key).error("'parameters' states it already", "keep one of the two")
        return Inertia.from_vector(section.numbers("parameters", 10))
    mass = section.at_least_zero("mass")
    centre = section.numbers("centre_of_mass", 3)
    ixx, ixy, ixz, iyy, iyz, izz = section.numbers("about_centre", 6)
    return Inertia.from_centre_of_mass(mass, centre, [[ixx, ixy, ixz], [ixy, iyy, iyz], [ixz, iyz, izz]])


def _tool(section: Section, last: int, end: Pose, frames: dict[str, Frame], links: list[Link]) -> str:
    """Put the tool into ``frames`` and return its name."""
    name = section.name("name", "tool")
    if name in frames or name in [link.name for link in links]:
        raise section.place("name").error(f"a link or frame is called '{name}' already", "choose another name")
    turn, shift = end
    rotation = rotation_from_rpy(section.numbers("rpy", 3, (0.0, 0.0, 0.0)))
    translation = section.numbers("translation", 3, (0.0, 0.0, 0.0))
    frames[name] = Frame(last, turn @ rotation, shift + turn @ translation)
    return name


def _check_unique(table: Section, joints: list[str], links: list[str]) -> None:
    for what, names, key in (("joint", joints, "name"), ("link", links, "link.name")):
        for i, name in enumerate(names):
            if name in names[:i]:
                step = f"give each {what} a name of its own"
                raise table.place(f"joints.{i + 1}.{key}").error(f"a second {what} is called '{name}'", step)
