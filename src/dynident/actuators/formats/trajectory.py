"""Recordings of ROS whose commands are trajectories: each message asks for positions at times to come."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from itertools import pairwise
from operator import itemgetter
from pathlib import Path
from typing import ClassVar

import numpy as np

from dynident.arrays import Array
from dynident.data.formats._arrays import ArrayTable, columns_of
from dynident.data.formats._bag_messages import MAX_LIST, Layout, Numbers
from dynident.data.formats._bag_messages import columns_of as names_of
from dynident.data.formats._bag_source import BagSource, bag_source, releases
from dynident.data.formats.base import LogFormat
from dynident.errors import BadOption, LogFormatError, UnknownChoice

#: Types of the messages.
STATE, TRAJECTORY = "sensor_msgs/msg/JointState", "trajectory_msgs/msg/JointTrajectory"

#: Time in s over which the velocity of a command is told.
_MOMENT = 1e-4

#: Position, velocity and acceleration of a joint at a point of a trajectory.
_POINT = re.compile(r"(.+)\.points\[(\d+)\]\.(positions|velocities|accelerations)")
_ORDER = {"positions": 0, "velocities": 1, "accelerations": 2}


@dataclass(frozen=True)
class TrajectoryLog(LogFormat):
    """Recording of ROS with commands as trajectory_msgs/JointTrajectory; ``t``, ``elbow.position``, ``elbow.command``.

    The command at each state is what the joint trajectory controller of ros2_controllers makes of the messages: from
    the measured position at the start of a message through its points, on lines, on cubic splines where both ends have
    velocities, on quintic ones where both have accelerations; then the last point. A message without points holds the
    joints. A message starts at the stamp of its header; where one has none, receive times count for all. Before the
    first message a joint is held where it is. Needs the extra ``ros``.

    Attributes:
        states: Topic of the states of the joints (sensor_msgs/JointState); empty for the only one.
        commands: Topic of the trajectories; empty for the only one.
        from_command: Whether a message starts from the last command (``open_loop_control``,
            ``interpolate_from_desired_state``), not from the measured position.
        distro: ROS release whose message types hold where the recording defines none, such as ``humble``.
    """

    states: str = ""
    commands: str = ""
    from_command: bool = False
    distro: str = ""

    suffixes: ClassVar = ()

    def __post_init__(self) -> None:
        for name, topic in (("states", self.states), ("commands", self.commands)):
            if topic and not topic.startswith("/"):
                raise BadOption(name, topic, "name a topic with all of its path, such as /joint_states")
        if self.distro and self.distro not in releases():
            raise UnknownChoice("ROS release", self.distro, list(releases()))

    def open(self, path: str | Path) -> ArrayTable:
        source = bag_source(path, self.distro, False)
        known = source.topics()
        states, commands = (
            _topic(str(path), known, named, kind) for named, kind in ((self.states, STATE), (self.commands, TRAJECTORY))
        )
        arrays = _columns(source, states, commands, self.from_command)
        found = columns_of(path, {name: values.shape for name, values in arrays.items()}, number_vectors=True)
        how = f"{source.kind}, {states} under the trajectories of {commands}"
        return replace(ArrayTable.of(path, source.digest(), how, found), load=arrays.__getitem__)


def _topic(path: str, known: Mapping[str, str], named: str, kind: str) -> str:
    fitting = [topic for topic, own in known.items() if own == kind]
    if named in fitting or (not named and len(fitting) == 1):
        return named or fitting[0]
    evidence = f"'{named}' is no topic of {kind}" if named else f"{len(fitting)} topics of {kind}"
    there = ", ".join(fitting) or "none"
    step = f"name both, format: {{trajectory: {{states: ..., commands: ...}}}}; there are {there}"
    raise LogFormatError(path, None, evidence, step)


def _columns(source: BagSource, states: str, commands: str, from_command: bool) -> dict[str, Array]:
    """Return time in s, measured and commanded positions by column, each (N,)."""
    goals, rows = list[tuple[int, Numbers]](), list[tuple[int, Numbers]]()
    for topic, received, numbers in source.messages([states, commands]):
        (goals if topic == commands else rows).append((received, numbers))
    is_stamped = all(numbers.stamp for _, numbers in goals + rows)
    goals, rows = ([((n.stamp or 0) if is_stamped else r, n) for r, n in each] for each in (goals, rows))
    orders = [(stamp, _goal(source.path, commands, n)) for stamp, n in sorted(goals, key=itemgetter(0))]
    joints = list(dict.fromkeys(name for _, goal in orders for name in goal))
    layouts = dict.fromkeys(numbers.layout for _, numbers in rows)  # a gripper may share the topic
    layout = max(layouts, key=partial(_known, joints), default=())
    kept = {stamp: n.values for stamp, n in rows if n.layout == layout and np.isfinite(n.values).all()}
    if not kept or not goals:
        what = commands if kept else states
        raise LogFormatError(source.path, None, f"no message of {what} counts", "record states and commands together")
    stamps, values = np.array(sorted(kept)), np.array([kept[stamp] for stamp in sorted(kept)])
    time = (stamps - stamps[0]) / 1e9
    table = dict(zip(names_of(layout), values.T, strict=True))
    found = {"t": time}
    begins = [((stamp - stamps[0]) / 1e9, goal) for stamp, goal in orders]
    for joint in joints:
        q, dq = table.get(f"{joint}.position"), table.get(f"{joint}.velocity")
        if q is not None:
            own = [(begin, goal.get(joint, [])) for begin, goal in begins if joint in goal or not goal]
            found[f"{joint}.position"] = q
            found[f"{joint}.command"] = commanded(time, q, dq, own, from_command)
    if len(found) == 1:
        evidence = f"{commands} names none of the joints of {states}"
        raise LogFormatError(source.path, None, evidence, "name the topics of one robot")
    return found


def _known(joints: Sequence[str], layout: Layout) -> int:
    """Return of how many joints messages of a layout have the position."""
    return len({f"{joint}.position" for joint in joints}.intersection(names_of(layout)))


def _goal(path: str, topic: str, numbers: Numbers) -> dict[str, list[tuple[float, ...]]]:
    """Return the points of a trajectory by joint: time from its start in s, position, derivatives that it has.

    Raises:
        LogFormatError: It has more points than are read, or one of a joint has no position.
    """
    places, times = _places(numbers.layout)
    missing = [joint for joint, own in places.items() if not all((k, 0) in own for k in range(len(times)))]
    if missing:
        step = "only positions are read: record the state of the controller, which has its commands"
        raise LogFormatError(path, None, f"a trajectory of {topic} has a point without position of {missing[0]}", step)
    if len(times) >= MAX_LIST:
        step = "record the state of the controller (control_msgs/JointTrajectoryControllerState): it has its commands"
        raise LogFormatError(path, None, f"a trajectory of {topic} has {MAX_LIST} points or more", step)
    values = numbers.values.tolist()
    seconds = [values[sec] + 1e-9 * values[nanosec] for sec, nanosec in times]
    found: dict[str, list[tuple[float, ...]]] = {}
    for joint, own in places.items():
        points = [[values[own[k, order]] for order in range(3) if (k, order) in own] for k in range(len(times))]
        found[joint] = [(second, *point) for second, point in zip(seconds, points, strict=True)]
        if not np.isfinite([point[0] for point in points]).all():
            raise LogFormatError(path, None, f"a trajectory of {topic} asks {joint} for no number", "leave it out")
    return found


@lru_cache(maxsize=256)
def _places(layout: Layout) -> tuple[dict[str, dict[tuple[int, int], int]], list[tuple[int, int]]]:
    """Return where the numbers of a trajectory stand, by joint, point and derivative, and those of the times."""
    names, found = names_of(layout), dict[str, dict[tuple[int, int], int]]()
    at = {name: k for k, name in enumerate(names)}
    for name, k in at.items():
        match = _POINT.fullmatch(name)
        if match:
            found.setdefault(match[1], {})[int(match[2]), _ORDER[match[3]]] = k
    times = []
    while f"points[{len(times)}].time_from_start.sec" in at:
        start = f"points[{len(times)}].time_from_start"
        times.append((at[f"{start}.sec"], at[f"{start}.nanosec"]))
    return found, times


def commanded(
    time: Array,
    q: Array,
    dq: Array | None,
    goals: Sequence[tuple[float, Iterable[tuple[float, ...]]]],
    from_command: bool = False,
) -> Array:
    """Return the command of a joint at some times, shape (N,), in the unit of its positions.

    Args:
        time: Shape (N,), in s.
        q: Measured positions, shape (N,).
        dq: Measured velocities, shape (N,); None where they are not known.
        goals: Trajectories in the order of their starts: the start in s, and each point's time from it, position,
            velocity and acceleration, the last two where it has them.
        from_command: Whether each begins at the last command.
    """
    found, last = np.full(len(time), q[0]), [float(q[0]), 0.0]
    starts = [begin for begin, _ in goals]
    for (begin, points), end in zip(goals, [*starts[1:], np.inf], strict=True):
        ends = np.searchsorted(time, [begin, end])
        until = (end if np.isfinite(end) else begin) - begin
        at = np.append(time[slice(*ends)] - begin, [until - _MOMENT, until])
        state = last if from_command else [float(np.interp(begin, time, each)) for each in (q, dq) if each is not None]
        passed = [(0.0, *state), *points]
        values = np.full(len(at), passed[-1][1])
        for one, two in pairwise(passed):
            on = (at >= one[0]) & (at < two[0])
            if on.any():
                values[on] = _between(one, two, at[on])
        found[slice(*ends)], last = values[:-2], [float(values[-1]), float(values[-1] - values[-2]) / _MOMENT]
    return found


def _between(one: tuple[float, ...], two: tuple[float, ...], at: Array) -> Array:
    """Return the positions between two points at some times, shape (n,), by what both of them have."""
    order = min(len(one), len(two))
    if order == 2:
        return np.interp(at, [one[0], two[0]], [one[1], two[1]])
    from scipy.interpolate import BPoly  # which `init` does not load otherwise

    return np.asarray(BPoly.from_derivatives([one[0], two[0]], [one[1:order], two[1:order]])(at))
