"""ROS 2: trajectory_msgs/JointTrajectory as YAML for ``ros2 topic pub`` and for action goals."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

from dynident.arrays import Array
from dynident.errors import BadOption
from dynident.exports.motions._messages import NANO, Points, approach_points, points_of
from dynident.exports.motions._motion import DrivenMotion
from dynident.exports.motions._printed import Decimals, Printed
from dynident.exports.motions.base import MotionContent, MotionExporter
from dynident.exports.names_in_files import ros_names

#: Digits after the point of all signals, in SI units.
PLACES = 9


@dataclass(frozen=True)
class JointTrajectory(MotionExporter):
    """YAML of trajectory_msgs/JointTrajectory with q, dq and ddq, so that ros2_control interpolates by quintics.

    The approach is a trajectory of its own in NAME-approach; joint names must be those of the controller.

    Attributes:
        goal: Whether the message stands under ``trajectory:``, as a goal of FollowJointTrajectory has it.
        most_points: Points that a trajectory may have.
    """

    goal: bool = False
    most_points: int = 20000

    suffix: ClassVar = ".yaml"
    rate: ClassVar = 100.0
    moves_itself: ClassVar = True

    def __post_init__(self) -> None:
        if self.most_points < 2:
            raise BadOption("most_points", self.most_points, "give 2 or more")

    def content(self, subject: DrivenMotion, path: Path) -> MotionContent:
        names = ros_names(subject.joints)
        files: dict[Path, bytes] = {}
        before = approach_points(subject, self.most_points)
        if before is not None:
            files[path.with_name(f"{path.stem}-approach{path.suffix}")], _ = self._message(names, before)
        points = points_of(*subject.samples(), self.most_points)
        files[path], signals = self._message(names, points)
        round_off = np.full((3, len(names)), 0.5 * 10.0**-PLACES)
        return MotionContent(files, Printed(points.time, signals, round_off), _notes(subject))

    def _message(self, names: tuple[str, ...], points: Points) -> tuple[bytes, Array]:
        """Return the text of a message and the signals (3, M, n) read back from it."""
        decimals = Decimals(np.ones(len(names)), PLACES)
        texts = [decimals.texts(signal) for signal in points.signals]
        lines = [
            "header: {stamp: {sec: 0, nanosec: 0}, frame_id: ''}",
            f"joint_names: [{', '.join(repr(name) for name in names)}]",
            "points:",
        ]
        for moment, q, dq, ddq in zip(points.nanoseconds, *texts, strict=True):
            seconds, rest = divmod(moment, NANO)
            lines += [
                f"- positions: [{', '.join(q)}]",
                f"  velocities: [{', '.join(dq)}]",
                f"  accelerations: [{', '.join(ddq)}]",
                f"  time_from_start: {{sec: {seconds}, nanosec: {rest}}}",
            ]
        if self.goal:
            lines = ["trajectory:", *(f"  {line}" for line in lines)]
        read = np.stack([decimals.read(text) for text in texts])
        return ("\n".join(lines) + "\n").encode("ascii"), read


def _notes(subject: DrivenMotion) -> tuple[str, ...]:
    if subject.posture is None and not subject.at_start:
        return ("the approach is one point, reached by the controller's own interpolation from where the robot is",)
    return ()
