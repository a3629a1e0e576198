"""A payload of which something is known: its mass, its centre of mass, its inertia."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dynident.arrays import Array, frozen
from dynident.errors import BadOption, UnknownChoice
from dynident.model.inertia import TEN, Inertia
from dynident.model.robot import Robot

#: More than this is no payload of an arm, in kg; a value in grams is caught by it.
HEAVIEST = 5000.0


@dataclass(frozen=True)
class CarriedBody:
    """A body fixed to the arm; what is not stated about it is found along with the gains.

    Attributes:
        mass: In kg.
        centre: Centre of mass in its frame, shape (3,), in m; None where it is not known.
        inertia: About the centre of mass, in the axes of its frame, shape (3, 3), in kg m^2; None where not known.
        frame: Name of the link or frame that it is stated in; empty for the robot's tool, if it moves, or last link.
        deviation: Standard deviation of the mass, in kg.
    """

    mass: float
    centre: Array | None = None
    inertia: Array | None = None
    frame: str = ""
    deviation: float = 0.0

    def __post_init__(self) -> None:
        if not 0 < self.mass <= HEAVIEST:
            raise BadOption("mass", self.mass, f"give the payload's mass in kg, above 0 and up to {HEAVIEST:g}")
        if not 0 <= self.deviation < 0.5 * self.mass:
            raise BadOption("deviation", self.deviation, "give the standard deviation of the mass in kg, below half")
        if self.centre is not None:
            object.__setattr__(self, "centre", frozen(self.centre, (3,), "centre of mass"))
            if not np.all(np.abs(self.centre) < 10.0):
                raise BadOption("centre", np.asarray(self.centre).tolist(), "give metres in the payload's frame")
        if self.inertia is None:
            return
        object.__setattr__(self, "inertia", frozen(self.inertia, (3, 3), "inertia"))
        if self.centre is None:
            raise BadOption("inertia", "of a payload without centre", "state its centre of mass as well")
        body = Inertia.from_centre_of_mass(self.mass, self.centre, self.inertia)
        if why := body.defect():
            raise BadOption("inertia", np.asarray(self.inertia).tolist(), f"{why}; give it about the centre of mass")

    def frame_in(self, robot: Robot) -> str:
        """Return the name of the link or frame that it is stated in."""
        tool = robot.frames.get(robot.tool)
        own = robot.tool if tool is None or tool.link >= 0 else ""
        return self.frame or own or robot.links[hand_of(robot, len(robot.links) - 1)].name

    def place(self, robot: Robot) -> tuple[int, Array, Array]:
        """Return the link that carries it, and the pose of its frame in that of the link.

        Raises:
            UnknownChoice: No such link or frame.
            BadOption: The frame does not move.
        """
        names, name = [link.name for link in robot.links], self.frame_in(robot)
        if name in names:
            return names.index(name), np.eye(3), np.zeros(3)
        if name not in robot.frames:
            raise UnknownChoice("link or frame for the payload", name, (*names, *robot.frames))
        frame = robot.frames[name]
        if frame.link < 0:
            raise BadOption("frame", name, "it stands still; name one that the arm moves")
        return frame.link, frame.rotation, frame.translation

    def parameters(self, robot: Robot) -> tuple[int, Array, Array, tuple[str, ...]]:
        """Return what it adds to the ten parameters of the link that carries it: theta = known + free x.

        Returns:
            The link, the known part (10,), the directions of what is not known (10, k), and what these k are.
        """
        link, rotation, translation = self.place(robot)
        turn = np.column_stack([Inertia.from_vector(one).moved(rotation, translation).vector for one in np.eye(10)])
        if self.centre is None:
            known, free = self.mass * np.eye(10)[9], np.eye(10)[:, :9]
        else:
            about = np.zeros((3, 3)) if self.inertia is None else self.inertia
            known = Inertia.from_centre_of_mass(self.mass, self.centre, about).vector
            free = np.eye(10)[:, : 6 if self.inertia is None else 0]
        return link, turn @ known, turn @ free, tuple(TEN[: free.shape[1]])

    def described(self, robot: Robot) -> str:
        """Return in words what is known of it on a robot."""
        text = f"{self.mass:g} kg"
        if self.deviation:
            text += f" within {self.deviation:g} kg (std)"
        frame = f"in the frame '{self.frame_in(robot)}'"
        if self.centre is None:
            return f"{text}, centre and inertia not known, {frame}"
        x, y, z = np.asarray(self.centre)
        text += f", centre {x:g}, {y:g}, {z:g} m {frame}"
        return f"{text}, inertia not known" if self.inertia is None else f"{text}, inertia known"


def hand_of(robot: Robot, link: int) -> int:
    """Return the link that carries the fingers of which a link is one; the link itself where it is no finger.

    Fingers are branches that move together: a joint of one follows that of another.
    """
    own, places = robot.carriers(link), {joint.name: i for i, joint in enumerate(robot.joints)}
    for i, joint in enumerate(robot.joints):
        if joint.mimic is not None:
            follower, leader = robot.carriers(i), robot.carriers(places[joint.mimic.joint])
            shared = next((each for each in follower if each in leader), -1)
            if shared not in (-1, leader[0]) and shared in own[1:]:
                link = min(link, shared)
    return link
