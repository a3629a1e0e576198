"""Topics of a recording of ROS that have the commands of servos beside the states of their joints."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from dynident.actuators.formats.trajectory import STATE, TRAJECTORY
from dynident.case.draft.column_words import KIND, SIGNAL, tokens_of
from dynident.case.draft.recognition import Recognised, SignalSource
from dynident.data.formats import FORMATS, LogTable
from dynident.data.formats._bag_source import bag_source
from dynident.errors import LogFormatError

#: Kinds of messages: commands by place, and states and commands of a trajectory controller.
_ARRAY, _CONTROLLER = "MultiArray", "JointTrajectoryControllerState"

#: Rows that are looked at for torques.
_ROWS = 1 << 10

#: Topics with states of joints that are looked at.
_MOST = 20

#: A column of commands by place, and its topic.
_PLACE = re.compile(r"(.+):data\[(\d+)\]")


def command_topics(path: str | Path) -> tuple[str, ...]:
    """Return the topics that have states and commands of joints, where the states of a recording have no efforts.

    The commands are the one topic whose name has a word for it, states and commands of one trajectory controller, or
    the one topic of trajectories. None where the file is no recording, or several topics may be the one.

    Raises:
        FileError: It cannot be read.
        LogFormatError: It is no sound recording.
    """
    if not FORMATS.get("rosbag").takes(path):
        return ()
    topics = bag_source(path, "", False).topics()
    words = {topic: tokens_of(topic) for topic in topics}
    told = [topic for topic, own in words.items() if any(KIND.get(word) == "commanded" for word in own)]
    told = [topic for topic in told if all(SIGNAL.get(word, "q") == "q" for word in words[topic])]
    states = [topic for topic, kind in topics.items() if kind == STATE and topic not in told]
    commands = [topic for topic in told if topics[topic] == STATE or topics[topic].endswith(_ARRAY)]
    controllers = [topic for topic, kind in topics.items() if kind.endswith(_CONTROLLER)]
    trajectories = [topic for topic, kind in topics.items() if kind == TRAJECTORY]
    if len(states) > 1 or any(_has_torques(path, topic) for topic in states):
        return ()
    if len(commands) == len(states) == 1:
        return states[0], commands[0]
    if commands or len(controllers) == 1:
        return () if commands else tuple(controllers)
    return (states[0], trajectories[0]) if len(trajectories) == len(states) == 1 else ()


def topic_of_joints(path: str | Path, joints: Sequence[str]) -> tuple[str, ...]:
    """Return the topic that alone of several with states of joints has joints of the robot; none where it is not one.

    Raises:
        FileError: It cannot be read.
        LogFormatError: It is no sound recording.
    """
    if not FORMATS.get("rosbag").takes(path):
        return ()
    states = [topic for topic, kind in bag_source(path, "", False).topics().items() if kind == STATE]
    headers = {topic: FORMATS.make("rosbag", {"topics": (topic,)}).open(path).header for topic in states[:_MOST]}
    own = [topic for topic, names in headers.items() if {f"{joint}.position" for joint in joints} & set(names)]
    return tuple(own) if len(own) == 1 < len(states) <= _MOST else ()


def recording(path: str | Path, topics: tuple[str, ...]) -> tuple[LogTable, str]:
    """Return a recording of these topics, without efforts and velocities, and the line of the case that says how."""
    if TRAJECTORY in _kinds(path, topics):
        table = FORMATS.make("trajectory", dict(zip(("states", "commands"), topics, strict=True))).open(path)
        return table, f"format: {{trajectory: {{states: {topics[0]}, commands: {topics[1]}}}}}"
    stamps = "receive" if any(kind.endswith(_ARRAY) for kind in _kinds(path, topics)) else "header"
    table = FORMATS.make("rosbag", {"topics": topics, "stamps": stamps}).open(path)
    header = tuple(name for name in table.header if not name.endswith((".effort", ".velocity")))
    inside = f"topics: [{', '.join(topics)}]" + ", stamps: receive" * (stamps == "receive")
    return replace(table, header=header), f"format: {{rosbag: {{{inside}}}}}"


def by_places(found: Recognised) -> Recognised:
    """Return what was found with the commands that a topic has by their places, one for each joint of the robot."""
    columns: dict[str, dict[int, str]] = {}
    for name in found.header:
        match = _PLACE.fullmatch(name)
        if match:
            columns.setdefault(match[1], {})[int(match[2])] = name
    whole = [own for own in columns.values() if sorted(own) == list(range(found.robot.dof))]
    if "q" not in found.sources or len(whole) != 1:
        return found
    names = tuple(whole[0][k] for k in range(found.robot.dof))
    source = SignalSource(names, "", "link", "in the order of the chain: is it that of the controller?")
    return replace(found, sources={**found.sources, "q_ref": source})


def _kinds(path: str | Path, topics: tuple[str, ...]) -> list[str]:
    known = bag_source(path, "", False).topics()
    return [known[topic] for topic in topics]


def _has_torques(path: str | Path, topic: str) -> bool:
    """Return whether states of joints have efforts that are numbers other than 0."""
    table = FORMATS.make("rosbag", {"topics": (topic,)}).open(path)
    names = [name for name in table.header if name.endswith(".effort")]
    try:
        return bool(names) and bool(np.any(next(table.batches(names, _ROWS), np.zeros(0))))
    except LogFormatError:
        return False
