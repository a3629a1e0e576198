"""ROS 2: a bag that plays the approach and then the motion."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from dynident.errors import BadOption, FileError, MissingDependency
from dynident.exports.motions._messages import NANO, Points, approach_points, points_of
from dynident.exports.motions._motion import DrivenMotion
from dynident.exports.motions._printed import Printed
from dynident.exports.motions.base import MotionContent, MotionExporter, MotionFigures
from dynident.exports.names_in_files import ros_names
from dynident.files import written_for_a_while

_TYPE = "trajectory_msgs/msg/JointTrajectory"
_TOPIC = re.compile(r"(/[A-Za-z_][A-Za-z0-9_]*)+")
_FOLDER = re.compile(r"[A-Za-z0-9_.-]+")

#: Pause in s between the end of the approach and the motion.
PAUSE = 2


@dataclass(frozen=True)
class BagFigures(MotionFigures):
    """Time stamp of the first sample, in s."""

    motion_starts_s: float


@dataclass(frozen=True)
class Ros2Bag(MotionExporter):
    """A bag (a folder) with the approach and, after it and a pause of 2 s, the motion, as JointTrajectory messages.

    Attributes:
        storage: ``mcap`` or ``sqlite3``.
        topic: Topic of the controller.
        most_points: Points that a message may have.
    """

    storage: str = "mcap"
    topic: str = "/joint_trajectory_controller/joint_trajectory"
    most_points: int = 20000

    suffix: ClassVar = ""
    writes_folder: ClassVar = True
    extra: ClassVar = "ros"
    proof: ClassVar = "the last message of the bag: samples of the plan, within its bounds, at rest at both ends"
    rate: ClassVar = 100.0
    moves_itself: ClassVar = True

    def __post_init__(self) -> None:
        if self.storage not in ("mcap", "sqlite3"):
            raise BadOption("storage", self.storage, "give mcap or sqlite3")
        if not _TOPIC.fullmatch(self.topic):
            raise BadOption("topic", self.topic, "give a name such as /joint_trajectory_controller/joint_trajectory")
        if self.most_points < 2:
            raise BadOption("most_points", self.most_points, "give 2 or more")

    def content(self, subject: DrivenMotion, path: Path) -> MotionContent:
        names = ros_names(subject.joints)
        if not _FOLDER.fullmatch(path.name) or path.name.startswith("."):
            raise FileError(path, "no name for a bag", "name its folder with letters, digits, '_', '.' and '-'")
        motion = points_of(*subject.samples(), self.most_points)
        before = approach_points(subject, self.most_points)
        start = 0 if before is None else before.nanoseconds[-1] + PAUSE * NANO
        messages = [(0, before)] if before is not None else []
        with tempfile.TemporaryDirectory() as folder:
            place = Path(folder) / path.name
            with written_for_a_while():
                printed = self._bag(place, names, [*messages, (start, motion)])
            files = {path / file.name: file.read_bytes() for file in sorted(place.iterdir())}
        return MotionContent(files, printed, figures=BagFigures(start / NANO))

    def _bag(self, place: Path, names: tuple[str, ...], messages: list[tuple[int, Points]]) -> Printed:
        """Write a bag and return the samples of its last message."""
        try:
            from rosbags.rosbag2 import StoragePlugin, Writer
            from rosbags.typesys import Stores, get_typestore
        except ImportError as error:
            raise MissingDependency("a ROS bag", "rosbags", self.extra) from error
        store = get_typestore(Stores.ROS2_HUMBLE)
        plugin = StoragePlugin.MCAP if self.storage == "mcap" else StoragePlugin.SQLITE3
        data = b""
        with Writer(place, version=9, storage_plugin=plugin) as writer:
            connection = writer.add_connection(self.topic, _TYPE, typestore=store)
            for moment, points in messages:
                data = bytes(store.serialize_cdr(_message(store.types, names, points), _TYPE))
                writer.write(connection, moment, data)
        found: Any = store.deserialize_cdr(data, _TYPE)
        signals = np.array([[p.positions, p.velocities, p.accelerations] for p in found.points]).transpose(1, 0, 2)
        times = [p.time_from_start.sec + p.time_from_start.nanosec / NANO for p in found.points]
        return Printed(np.array(times), signals, np.zeros(signals.shape[::2]), "rosbags")


def _message(types: Any, names: tuple[str, ...], points: Points) -> Any:
    duration = types["builtin_interfaces/msg/Duration"]
    point, nothing = types["trajectory_msgs/msg/JointTrajectoryPoint"], np.zeros(0)

    def each() -> Iterator[Any]:
        for k, moment in enumerate(points.nanoseconds):
            q, dq, ddq = points.signals[:, k].copy()
            yield point(q, dq, ddq, nothing, duration(*divmod(moment, NANO)))

    header = types["std_msgs/msg/Header"](types["builtin_interfaces/msg/Time"](0, 0), "")
    return types[_TYPE](header, list(names), list(each()))
