"""Commands of servos: topics beside the states of joints in a recording of ROS, and columns beside measured positions.

Only words such as action and state, goal and present tell commanded columns from measured ones.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from dynident.actuators.formats.trajectory import STATE, TRAJECTORY
from dynident.case.draft.column_groups import Group, joint_forms, joint_in
from dynident.case.draft.column_words import (
    ENABLED,
    KIND,
    NEUTRAL,
    OTHER,
    SHARE_WORDS,
    SIGNAL,
    Meaning,
    split_unit,
    tokens_of,
)
from dynident.case.draft.joint_choice import choose_joints
from dynident.case.draft.recognition import Recognised, SignalSource
from dynident.case.draft.structure import TableStructure
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


#: Words for what a servo is told, beside those that commands have in every log.
_TOLD = frozenset("action actions leader".split())

#: Words for what it did, beside those of measurements.
_DID = frozenset("follower state observation".split())


def command_pair(header: Sequence[str], joints: Sequence[str]) -> dict[str, Group]:
    """Return measured and commanded positions, ``q`` and ``q_ref``, whose names differ in a word for the command alone.

    The columns of both have the same words and numbers beside it, one for each motor: ``action.elbow.pos`` and
    ``observation.state.elbow.pos``, ``cmd1`` and ``pos1``. They are those of the joints where their words are, else in
    the order of the header; at least as many as the robot has joints.

    Args:
        header: Names of the columns.
        joints: Names of the joints of the robot, in order.

    Returns:
        Both groups; empty where the names tell no such pair, or more columns than these may be torques.
    """
    told: dict[tuple[str, ...], str] = {}
    did: dict[tuple[str, ...], str] = {}
    rest = 0
    for name in header:
        words = tokens_of(split_unit(name)[0])
        signals = {SIGNAL[word] for word in words if word in SIGNAL}
        if (
            ENABLED.fullmatch(name)
            or signals == {"time"}
            or OTHER.intersection(words)
            or (not signals and SHARE_WORDS.intersection(words))
        ):
            continue
        is_told = any(word in _TOLD or KIND.get(word) == "commanded" for word in words)
        known = is_told or bool(signals) or any(word in _DID or KIND.get(word) == "measured" for word in words)
        key = tuple(w for w in words if w not in NEUTRAL | SIGNAL.keys() | KIND.keys() | _TOLD | _DID)
        if signals & {"torque", "current"}:
            return {}
        if signals - {"q"} or not known or key in (told if is_told else did):
            rest += not signals
            continue
        (told if is_told else did)[key] = name
    both = [key for key in did if key in told]
    if len(both) < len(joints) or rest + len(told) + len(did) - 2 * len(both) >= len(joints):
        return {}
    forms = joint_forms(joints)
    places = {key: place[0] for key in both if (place := joint_in(key, forms)) is not None}
    by_name = sorted(places.values()) == list(range(len(joints)))
    order = sorted(places, key=places.__getitem__) if by_name else both
    meanings = {"q": (did, "measured"), "q_ref": (told, "commanded")}
    return {
        signal: Group(Meaning("q", kind), {k: names[key] for k, key in enumerate(order)}, by_name)
        for signal, (names, kind) in meanings.items()
    }


def by_commands(found: Recognised) -> Recognised:
    """Return measured and commanded positions that a word for the command, or a topic, alone tells apart, if any."""
    groups = command_pair(found.header, found.robot.joint_names)
    if not groups or not found.time:
        return by_places(found)
    how = {"q": "measured, by their names", "q_ref": "commanded, by their names"}
    sources = {signal: SignalSource(group.names, "", "link", how[signal]) for signal, group in groups.items()}
    joints = choose_joints(found.robot, groups["q"], np.zeros((1, groups["q"].count)))
    structure = TableStructure(groups=groups, evidence=how)
    return replace(found, sources=sources, rivals={}, joints=joints, structure=structure)
