"""A simulated log written as a recording of ROS: states of the joints on one topic, commanded motion on another."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from dynident.arrays import Array, IntArray
from dynident.data.formats._column_map import NUMBERED
from dynident.data.formats._simulated_bag import FRAME
from dynident.errors import BadOption, MissingDependency
from dynident.files import write_atomically, written_for_a_while

#: Suffixes of recordings: ROS 1 bags, and bare files of ROS 2 recordings.
BAGS = (".bag", ".mcap", ".db3")

#: Topics of columns that name none.
STATES, COMMANDED = "/joint_states", "/commanded"

#: Stamp of the time 0, in ns: ROS takes a stamp of 0 for none.
START = 1_000_000_000

_STATE, _GOAL = "sensor_msgs/msg/JointState", "trajectory_msgs/msg/JointTrajectory"

#: Lists of the two messages, by the words that columns end in.
_LISTS = {
    _STATE: {"position": "position", "velocity": "velocity", "effort": "effort"},
    _GOAL: {"points[0].positions": "positions", "points[0].velocities": "velocities"},
}

#: What columns of signals that the case does not name are called in a recording.
_WORDS = {
    "q": "{}.position",
    "dq": "{}.velocity",
    "torque": "{}.effort",
    "current": "{}.effort",
    "q_ref": COMMANDED + ":{}.points[0].positions",
    "dq_ref": COMMANDED + ":{}.points[0].velocities",
}

_COLUMN = re.compile(
    r"(?:(?P<topic>/[^:]+):)?(?P<joint>.+?)\.(?P<list>position|velocity|effort|points\[0\]\.(?:positions|velocities))"
)


def write_bag(table: Mapping[str, Array], path: str | Path, time: Array, joints: Sequence[str]) -> None:
    """Write columns as messages with a stamp, so that ``rosbag`` of the log formats reads the same columns.

    ``elbow.position``, ``.velocity`` and ``.effort`` stand in sensor_msgs/JointState on ``/joint_states``, or on the
    topic before a colon; ``/commanded:elbow.points[0].positions`` in trajectory_msgs/JointTrajectory.

    Args:
        table: The columns (N,) by name, without the time; numbered ones (q1, tau1, ...) are named after the joints.
        path: A file that ends in one of :data:`BAGS`.
        time: Of the rows in s, shape (N,).
        joints: Names by number.

    Raises:
        BadOption: A column that no such message has.
        FileError: The file cannot be written.
        MissingDependency: rosbags is not installed.
    """
    topics = _topics(table, joints)
    stamps = START + np.round(np.asarray(time) * 1e9).astype(np.int64)
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder) / "recording"
        with written_for_a_while():
            content = _write(place, Path(path).suffix.lower(), topics, stamps).read_bytes()
        write_atomically(path, content)


def _topics(table: Mapping[str, Array], joints: Sequence[str]) -> dict[tuple[str, str], dict[str, dict[str, Array]]]:
    """Return by topic and type the signals of each joint: their column (N,) by the list it stands in."""
    numbered = {
        f"{NUMBERED[signal]}{k}": word.format(name)
        for signal, word in _WORDS.items()
        for k, name in enumerate(joints, start=1)
    }
    found: dict[tuple[str, str], dict[str, dict[str, Array]]] = {}
    for name, values in table.items():
        match = _COLUMN.fullmatch(numbered.get(name, name))
        if match is None:
            step = "name columns such as elbow.position (log: profile: joint_states), or write .csv or .parquet"
            raise BadOption("--output", f"'{name}' in a recording of ROS", step)
        kind = _STATE if match["list"] in _LISTS[_STATE] else _GOAL
        topic = match["topic"] or (STATES if kind == _STATE else COMMANDED)
        found.setdefault((topic, kind), {}).setdefault(match["joint"], {})[_LISTS[kind][match["list"]]] = values
    for (topic, _), own in found.items():
        if len({tuple(sorted(lists)) for lists in own.values()}) > 1:
            raise BadOption("--output", f"other signals for each joint on {topic}", "name the same for all joints")
    return found


def _message(store: Any, kind: str, own: Mapping[str, Mapping[str, Array]], row: int, stamp: int, *seq: int) -> Any:
    """Return the message of a row; ``seq`` is the number that headers of ROS 1 begin with."""
    seconds, rest = divmod(stamp, 1_000_000_000)
    header = store.types["std_msgs/msg/Header"](*seq, store.types["builtin_interfaces/msg/Time"](seconds, rest), FRAME)

    def values(name: str) -> Array:
        return np.array([lists[name][row] for lists in own.values() if name in lists], dtype=np.float64)

    if kind == _STATE:
        return store.types[kind](header, list(own), *map(values, _LISTS[kind].values()))
    since = store.types["builtin_interfaces/msg/Duration"](0, 0)
    point = store.types["trajectory_msgs/msg/JointTrajectoryPoint"]
    goal = point(values("positions"), values("velocities"), np.zeros(0), np.zeros(0), since)
    return store.types[kind](header, list(own), [goal])


def _write(place: Path, suffix: str, topics: Mapping[tuple[str, str], Any], stamps: IntArray) -> Path:
    """Write a bag of ROS 1 (.bag) or a recording of ROS 2, and return the file with its messages."""
    try:
        from rosbags import rosbag1, rosbag2
        from rosbags.typesys import Stores, get_typestore
    except ImportError as error:
        raise MissingDependency("writing a recording of ROS", "rosbags", "ros") from error
    is_first = suffix == ".bag"
    store = get_typestore(Stores.ROS1_NOETIC if is_first else Stores.ROS2_HUMBLE)
    serialize = store.serialize_ros1 if is_first else store.serialize_cdr
    plugin = rosbag2.StoragePlugin.MCAP if suffix == ".mcap" else rosbag2.StoragePlugin.SQLITE3
    with rosbag1.Writer(place) if is_first else rosbag2.Writer(place, version=9, storage_plugin=plugin) as writer:
        links: Any = {key: writer.add_connection(*key, typestore=store) for key in topics}
        for row, stamp in enumerate(stamps.tolist()):
            for (topic, kind), own in topics.items():
                message = _message(store, kind, own, row, stamp, *[row] * is_first)
                writer.write(links[topic, kind], stamp, serialize(message, kind))
    return place if is_first else next(place.glob(f"*{suffix}"))
