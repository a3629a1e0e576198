"""Recordings of ROS 2 of one joint, written message by message."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from servo_bench import PENDULUM

pytest.importorskip("rosbags", reason="recordings of ROS need the package rosbags (extra ros)")

from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

FIRST = 1_700_000_000_000_000_000
STATE, GOAL = "sensor_msgs/msg/JointState", "trajectory_msgs/msg/JointTrajectory"
CONTROLLER = "control_msgs/msg/JointTrajectoryControllerState"
GOALS = "/arm_controller/joint_trajectory"

#: Fields of a controller's state before and since ROS 2 Iron: commanded, measured, and the rest.
OLD, NEW = ("desired", "actual", "error"), ("reference", "feedback", "error", "output")


def store(words: tuple[str, ...] = OLD) -> Any:
    """Return the types of ROS 2 with the state of a trajectory controller."""
    found = get_typestore(Stores.ROS2_HUMBLE)
    text = "std_msgs/Header header\nstring[] joint_names\n"
    text += "".join(f"trajectory_msgs/JointTrajectoryPoint {word}\n" for word in words)
    found.register(get_types_from_msg(text, CONTROLLER))
    return found


Message = Callable[[Any, Any, int], Any]


def record(kinds: Mapping[str, str], rows: list[tuple[float, str, Message]], words: tuple[str, ...] = OLD) -> None:
    """Write run.mcap: messages by time and topic, each made of the types, its stamp and a row."""
    types = store(words)
    with Writer("rec", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        topics = {name: writer.add_connection(name, kind, typestore=types) for name, kind in kinds.items()}
        for row, (time, topic, made) in enumerate(rows):
            stamp = FIRST + round(time * 1e9)
            message = made(types.types, head(types.types, stamp), row)
            writer.write(topics[topic], stamp, types.serialize_cdr(message, kinds[topic]))
    Path("rec/rec.mcap").rename("run.mcap")
    Path("pendulum.urdf").write_text(PENDULUM)


def head(types: Any, stamp: int) -> Any:
    moment = types["builtin_interfaces/msg/Time"](stamp // 10**9, stamp % 10**9)
    return types["std_msgs/msg/Header"](stamp=moment, frame_id="")


def point(types: Any, *values: float, after: float = 0.0) -> Any:
    """Return a point with position, velocity and acceleration as far as they are given."""
    lists = [np.array([value]) for value in values] + [np.zeros(0)] * (4 - len(values))
    whole = types["builtin_interfaces/msg/Duration"](int(after), round(after % 1 * 1e9))
    return types["trajectory_msgs/msg/JointTrajectoryPoint"](*lists, whole)


def state(q: float, *effort: float) -> Message:
    return lambda types, header, _: types[STATE](header, ["joint1"], np.array([q]), np.zeros(0), np.array(effort))


def goal(*points: tuple[float, ...], stamped: bool = False) -> Message:
    """Return a trajectory of points (time, position, velocity, ...) that starts at once."""

    def made(types: Any, header: Any, _: int) -> Any:
        own = [point(types, *values, after=after) for after, *values in points]
        return types[GOAL](header if stamped else head(types, 0), ["joint1"], own)

    return made
