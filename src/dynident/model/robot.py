"""Robot, Link, Frame: frozen values that say what the robot is, free of any file format."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from dynident.arrays import Array, frozen
from dynident.errors import BadOption, UnknownChoice
from dynident.methods import ShortText, check_held
from dynident.model.chain import PRISMATIC, REVOLUTE, Chain
from dynident.model.inertia import Inertia, impossible_parts
from dynident.model.joint import Drive, Joint, Mimic, joint_pose
from dynident.model.shapes import Shape

STANDARD_GRAVITY = (0.0, 0.0, -9.81)


@dataclass(frozen=True)
class Link:
    """A moving link with everything that is fixed to it.

    Attributes:
        name: Name of the link whose frame is used.
        inertia: Nominal inertia of the robot model, with its fixed links; None where it states none.
        fixed: Names of the links merged into it.
        shapes: What can touch, with its fixed links, in its frame; empty where the robot model states none.
        visuals: What only shows it and touches nothing: it bounds the link's body as its shapes do.
        impossible: Which of several links of the file that are one here state an inertia that no body has, and why.
        quadrics: Q with (x, 1)' Q (x, 1) >= 0 in all its shapes, shape (4, 4) each; where one ellipsoid is too coarse.
        solids: Bodies of one density that fill what touches, and what shows it, as far as their files are read.
    """

    name: str
    inertia: Inertia | None = None
    fixed: tuple[str, ...] = ()
    shapes: tuple[Shape, ...] = ()
    visuals: tuple[Shape, ...] = ()
    impossible: str = ""
    quadrics: tuple[Array, ...] = ()
    solids: tuple[Inertia, ...] = ()


@dataclass(frozen=True)
class Frame:
    """A named frame fixed to a link: ``link`` is an index (-1 the base), then its pose in that link."""

    link: int
    rotation: Array
    translation: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "rotation", frozen(self.rotation, (3, 3), "rotation"))
        object.__setattr__(self, "translation", frozen(self.translation, (3,), "translation"))


@dataclass(frozen=True, repr=False)
class Robot(ShortText):
    """A tree of moving links; link i is moved by joint i; a parent stands before its children.

    Attributes:
        name: Name of the robot.
        links: The moving links, fixed ones merged into them.
        joints: The joint that moves each link, in the same order.
        gravity: Gravity in the base frame, shape (3,), in m/s^2; a tilted mounting turns it.
        base: Name of the base link.
        frames: Named frames on the links (merged links, tool).
        tool: Name of the frame in ``frames`` that tool paths show; empty for the last link's frame.
        coupling: Motor speed = coupling @ joint speed, shape (n, n); identity where each motor moves one joint.
        note: Where the numbers come from.
        base_shapes: The space that the base and all that is fixed to it take up, in the base frame.
        held: Positions of locked joints that carry joints which move, by name, in rad or m.
    """

    name: str
    links: tuple[Link, ...]
    joints: tuple[Joint, ...]
    gravity: Array = field(default_factory=lambda: np.array(STANDARD_GRAVITY))
    base: str = "base"
    frames: Mapping[str, Frame] = field(default_factory=dict)
    tool: str = ""
    coupling: Array | None = None
    note: str = ""
    base_shapes: tuple[Shape, ...] = ()
    held: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "gravity", frozen(self.gravity, (3,), "gravity"))
        if len(self.links) != len(self.joints):
            raise ValueError(f"{len(self.links)} links and {len(self.joints)} joints: each joint moves one link")
        if any(joint.parent >= i for i, joint in enumerate(self.joints)):
            raise ValueError("a parent must stand before its children")
        names = [joint.name for joint in self.joints]
        if len(set(names)) != len(names):
            raise ValueError(f"two joints share a name: {names}")
        coupling = np.eye(self.dof) if self.coupling is None else self.coupling
        object.__setattr__(self, "coupling", frozen(coupling, (self.dof, self.dof), "coupling"))
        if np.linalg.matrix_rank(np.asarray(self.coupling)) < self.dof:
            raise ValueError("the coupling matrix is singular")

    @cached_property
    def active(self) -> tuple[Joint, ...]:
        """The joints that move on their own (not mimic), in order; n of them."""
        return tuple(joint for joint in self.joints if joint.mimic is None)

    @property
    def dof(self) -> int:
        """n: the number of joints that move on their own."""
        return len(self.active)

    @cached_property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the n joints that move on their own."""
        return tuple(joint.name for joint in self.active)

    @property
    def units(self) -> tuple[str, ...]:
        """Unit of each joint's effort: N m or N."""
        return tuple(joint.unit for joint in self.active)

    @property
    def tips(self) -> tuple[int, ...]:
        """Places of the links that carry no other, the ends of the branches."""
        parents = {joint.parent for joint in self.joints}
        return tuple(i for i in range(len(self.links)) if i not in parents)

    def carriers(self, link: int) -> list[int]:
        """Return the place of a link, and those of the links that carry it in the order of the way to the base."""
        found = [link]
        while (parent := self.joints[found[-1]].parent) >= 0:
            found.append(parent)
        return found

    @cached_property
    def is_coupled(self) -> bool:
        """Whether a motor moves more than its own joint."""
        return not np.array_equal(np.asarray(self.coupling), np.eye(self.dof))

    @cached_property
    def reflected_inertia(self) -> Array:
        """Known rotor inertia reflected to the joints, C' diag(r^2 J) C, shape (n, n), in kg m^2."""
        coupling = np.asarray(self.coupling)
        return frozen(coupling.T @ np.diag([joint.drive.reflected_inertia for joint in self.active]) @ coupling)

    @cached_property
    def bias(self) -> Array:
        """Known constant torque of each joint beside its drive, shape (n,), in N m or N; see :class:`Drive`."""
        return frozen([joint.drive.bias for joint in self.active])

    @cached_property
    def chain(self) -> Chain:
        """The robot as flat arrays for the kernels."""
        column = {name: i for i, name in enumerate(self.joint_names)}
        mimics = [joint.mimic or Mimic(joint.name) for joint in self.joints]
        return Chain(
            parent=np.array([joint.parent for joint in self.joints], dtype=np.int64),
            kind=np.array([PRISMATIC if joint.kind == "prismatic" else REVOLUTE for joint in self.joints], np.int64),
            rotation=np.array([joint.rotation for joint in self.joints]).reshape(-1, 3, 3),
            translation=np.array([joint.translation for joint in self.joints]).reshape(-1, 3),
            axis=np.array([joint.axis for joint in self.joints]).reshape(-1, 3),
            joint=np.array([column[mimic.joint] for mimic in mimics], dtype=np.int64),
            multiplier=np.array([mimic.multiplier for mimic in mimics], dtype=float),
            offset=np.array([mimic.offset for mimic in mimics], dtype=float),
            gravity=np.array(self.gravity),
            joints=self.dof,
        )

    @cached_property
    def nominal(self) -> Array | None:
        """Inertial parameters of the robot model, 10 per link in the order of TEN, shape (10 l,); None if any lacks."""
        if any(link.inertia is None for link in self.links):
            return None
        return np.concatenate([link.inertia.vector for link in self.links if link.inertia is not None])

    def with_gravity(self, gravity: npt.ArrayLike) -> Robot:
        """Return the robot with another gravity vector in its base frame, shape (3,), in m/s^2."""
        return replace(self, gravity=np.asarray(gravity, dtype=float))

    def with_drives(self, drives: Mapping[str, Drive], coupling: npt.ArrayLike | None = None) -> Robot:
        """Return the robot with other drives by joint name, and another coupling matrix if one is given."""
        self.check_names(drives)
        joints = tuple(replace(j, drive=drives.get(j.name, j.drive)) for j in self.joints)
        return replace(self, joints=joints, coupling=self.coupling if coupling is None else np.asarray(coupling, float))

    def locked(self, positions: Mapping[str, float]) -> Robot:
        """Return the robot with some joints fixed at the given positions, their links merged into their parents.

        Joints that follow a locked one are locked where it puts them.

        Args:
            positions: Position by joint name, in rad or m.

        Raises:
            UnknownChoice: No such joint.
            BadOption: All joints locked, or one whose motor turns with a free joint.
        """
        self.check_names(positions)
        check_held(self.active, positions)
        followers = {
            joint.name: joint.mimic.multiplier * positions[joint.mimic.joint] + joint.mimic.offset
            for joint in self.joints
            if joint.mimic is not None and joint.mimic.joint in positions
        }
        keep = [i for i, name in enumerate(self.joint_names) if name not in positions]
        if not keep:
            raise BadOption("locked", list(positions), "leave at least one joint free")
        coupling = np.asarray(self.coupling)
        for i, j in ((i, j) for i, name in enumerate(self.joint_names) if name in positions for j in keep):
            if coupling[i, j]:
                held, moved = self.joint_names[i], self.joint_names[j]
                step = f"the motor of '{held}' turns with '{moved}' too (coupling): leave it free, or lock both"
                raise BadOption("locked", held, step)
        return _merge(self, {**positions, **followers}, coupling[np.ix_(keep, keep)])

    def check_names(self, names: Iterable[str]) -> None:
        """Refuse a name that no joint which moves on its own has, by UnknownChoice."""
        for name in (name for name in names if name not in self.joint_names):
            raise UnknownChoice("joint", name, self.joint_names)


def _merge(robot: Robot, positions: Mapping[str, float], coupling: Array) -> Robot:
    """Fix the joints in ``positions`` and carry inertias, children and frames over to the links they now belong to."""
    place: dict[int, tuple[int, Array, Array]] = {-1: (-1, np.eye(3), np.zeros(3))}  # old link -> new link and pose
    links: list[Link] = []
    joints: list[Joint] = []
    frames: dict[str, Frame] = {}
    still = list(robot.base_shapes)
    for i, (link, joint) in enumerate(zip(robot.links, robot.joints, strict=True)):
        target, turn, shift = place[joint.parent]
        if joint.name not in positions:
            moved = replace(
                joint, parent=target, rotation=turn @ joint.rotation, translation=turn @ joint.translation + shift
            )
            place[i] = (len(links), np.eye(3), np.zeros(3))
            links.append(link)
            joints.append(moved)
            continue
        rotation, translation = joint_pose(joint, float(positions[joint.name]))
        rotation, translation = turn @ rotation, turn @ translation + shift
        place[i] = (target, rotation, translation)
        frames[link.name] = Frame(target, rotation, translation)
        if target >= 0:
            links[target] = _joined(links[target], link, rotation, translation)
        else:
            still += [shape.moved(rotation, translation) for shape in link.shapes]
    for name, frame in robot.frames.items():
        target, turn, shift = place[frame.link]
        frames[name] = Frame(target, turn @ frame.rotation, turn @ frame.translation + shift)
    tool = robot.tool or _last_link(robot, frames)
    return replace(
        robot,
        links=tuple(links),
        joints=tuple(joints),
        frames=frames,
        tool=tool,
        coupling=coupling,
        base_shapes=tuple(still),
        held={**robot.held, **_carrying(robot, positions)},
    )


def _carrying(robot: Robot, positions: Mapping[str, float]) -> dict[str, float]:
    """Return the positions of locked joints beyond which a joint still moves."""
    carrying = {-1}
    for i in reversed(range(len(robot.joints))):  # parents stand before their children
        if i in carrying or robot.joints[i].name not in positions:
            carrying.add(robot.joints[i].parent)
    names = [robot.joints[i].name for i in sorted(carrying - {-1})]
    return {name: float(positions[name]) for name in names if name in positions}


def _joined(parent: Link, child: Link, rotation: Array, translation: Array) -> Link:
    inertia = None  # unknown where either is
    if parent.inertia is not None and child.inertia is not None:
        inertia = parent.inertia + child.inertia.moved(rotation, translation)
    pairs = (parent.shapes, child.shapes), (parent.visuals, child.visuals)
    solid, shown = ((*own, *(one.moved(rotation, translation) for one in more)) for own, more in pairs)
    whys = (one.impossible or impossible_parts({one.name: one.inertia}) for one in (parent, child))
    fixed = (*parent.fixed, child.name, *child.fixed)
    return Link(parent.name, inertia, fixed, solid, shown, "; ".join(filter(None, whys)))


def _last_link(robot: Robot, frames: Mapping[str, Frame]) -> str:
    """Return the frame of the last link of the unlocked robot where locking turned it into a frame.

    Of links that branch, as fingers do, it is that of the link which carries them.
    """
    at = last = len(robot.links) - 1
    while at >= 0 and robot.links[at].name in frames:
        at = robot.joints[at].parent
        last = at if at >= 0 and sum(joint.parent == at for joint in robot.joints) > 1 else last
    name = robot.links[last].name
    return name if name in frames else ""
