"""Workspace: the room that a robot moves in, as a frozen value: floor, obstacles, tool, distances to be kept.

All is in the base frame. What follows from it for one robot is worked out by
:mod:`dynident.excitation.collision.clearance`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from dynident.arrays import Array, frozen
from dynident.errors import BadOption, UnknownChoice
from dynident.model.robot import Frame, Robot
from dynident.model.shapes import Box, Capsule

#: Distances that are kept where none are stated, in m: between two links, and to what stands around.
SELF_CLEARANCE, CLEARANCE = 0.02, 0.05


@dataclass(frozen=True)
class HalfSpace:
    """The free side of a plane: normal . x >= offset.

    Attributes:
        normal: Direction into the free side, shape (3,); made a unit vector.
        offset: Distance of the plane from the base origin along the unit normal, in m.
    """

    normal: Array
    offset: float

    def __post_init__(self) -> None:
        normal = np.array(self.normal, dtype=float)
        length = float(np.linalg.norm(normal))
        if normal.shape != (3,) or not (np.isfinite(length) and length > 1e-9):
            raise BadOption("normal", normal.tolist(), "give a direction of three numbers")
        object.__setattr__(self, "normal", frozen(normal / length))
        if not np.isfinite(self.offset):
            raise BadOption("offset", self.offset, "give a length in m")
        object.__setattr__(self, "offset", float(self.offset))


@dataclass(frozen=True)
class Tool:
    """What the last link carries: a capsule from the origin of a frame to the tool point.

    Attributes:
        link: Name of a link or frame; empty for the tool frame of the robot, else its last link.
        offset: The tool point in that frame, shape (3,), in m.
        radius: Radius about the way to the tool point, in m.
    """

    link: str = ""
    offset: Array = field(default_factory=lambda: np.zeros(3))
    radius: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "offset", frozen(self.offset, (3,), "offset"))
        if not 0 <= self.radius < np.inf:
            raise BadOption("radius", self.radius, "give a radius in m, 0 or more")


@dataclass(frozen=True)
class Workspace:
    """The room of a robot and the distances that its motions must keep there.

    Attributes:
        half_spaces: Floor and walls by name.
        boxes: Boxes to keep out of, by name, in the base frame.
        region: Box that the tool point, with the tool's radius, must stay in; None for anywhere.
        tool: What the robot carries; None for nothing: the tool point is then the robot's tool frame or last link.
        self_clearance: Distance to be kept between two links, in m.
        clearance: Distance to be kept from half-spaces and boxes, in m.
        ignore: Pairs of names that are not checked: two links, or a link and a half-space or box.
        joint_radius: Radius, in m, of the capsules from joint to joint that stand for links without shapes; None where
            there are none.
        shapes: Capsules by link, in place of the robot model's; by frame, in addition to those of its link.
        tool_speed: Largest speed of the tool point, in m/s.
        mesh_folders: Folders beneath which mesh files are looked for.

    Raises:
        BadOption: A distance that is negative or not finite, or a name that stands for two things.
    """

    half_spaces: Mapping[str, HalfSpace] = field(default_factory=dict)
    boxes: Mapping[str, Box] = field(default_factory=dict)
    region: Box | None = None
    tool: Tool | None = None
    self_clearance: float = SELF_CLEARANCE
    clearance: float = CLEARANCE
    ignore: tuple[tuple[str, str], ...] = ()
    joint_radius: float | None = None
    shapes: Mapping[str, tuple[Capsule, ...]] = field(default_factory=dict)
    tool_speed: float = np.inf
    mesh_folders: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name in ("self_clearance", "clearance"):
            if not 0 <= getattr(self, name) < np.inf:
                raise BadOption(name, getattr(self, name), "give a distance in m, 0 or more")
        if self.joint_radius is not None and not 0 < self.joint_radius < np.inf:
            raise BadOption("joint_radius", self.joint_radius, "give a radius in m above 0")
        if not self.tool_speed > 0:
            raise BadOption("tool_speed", self.tool_speed, "give a speed in m/s above 0")
        twice = sorted(self.half_spaces.keys() & self.boxes.keys())
        if twice:
            raise BadOption("boxes", twice, "the half-spaces have that name; give each a name of its own")

    @property
    def obstacles(self) -> tuple[str, ...]:
        """Names of the half-spaces and boxes."""
        return (*self.half_spaces, *self.boxes)

    def tool_frame(self, robot: Robot) -> Frame:
        """Return the link that carries the tool, and the tool frame in it.

        Raises:
            UnknownChoice: No such link or frame.
        """
        name = self.tool.link if self.tool is not None else ""
        return frame_of(robot, name or robot.tool or robot.links[-1].name)


def frame_of(robot: Robot, name: str) -> Frame:
    """Return where a link or frame is by its name: the link that carries it, -1 for the base, and its pose there.

    Raises:
        UnknownChoice: No such link or frame.
    """
    names = link_names(robot)
    if name in names:
        return Frame(names.index(name) - 1, np.eye(3), np.zeros(3))
    if name in robot.frames:
        return robot.frames[name]
    raise UnknownChoice("link or frame", name, (*names, *robot.frames))


def link_names(robot: Robot) -> tuple[str, ...]:
    """Return the names of the base and of the l moving links, shape (1 + l)."""
    return (robot.base, *(link.name for link in robot.links))


def body_of(robot: Robot, workspace: Workspace, name: str) -> str:
    """Return what a name stands for: a half-space or box, or the link (or base) that carries a frame of that name.

    Raises:
        UnknownChoice: No such thing.
    """
    names = link_names(robot)
    if name in workspace.obstacles:
        return name
    if name in names or name in robot.frames:
        return names[frame_of(robot, name).link + 1]
    raise UnknownChoice("link, frame, half-space or box", name, (*names, *robot.frames, *workspace.obstacles))
