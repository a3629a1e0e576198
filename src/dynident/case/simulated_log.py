"""A simulated log written as the logs of a case are: with its columns, units, zeros and side of the gears.

As a recording of ROS it has the states of the joints on one topic and the commanded motion on another.
"""

from __future__ import annotations

import io
import re
import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from dynident.arrays import Array, IntArray
from dynident.data.formats import ColumnMap
from dynident.data.formats._column_map import NUMBERED, QUANTITY, RATED
from dynident.data.formats._simulated_bag import FRAME
from dynident.data.formats._units import counted_unit, unit_of
from dynident.data.log import Log
from dynident.data.motor_side import gears_of
from dynident.errors import BadOption, MissingDependency
from dynident.files import write_atomically, written_for_a_while
from dynident.model.robot import Robot

#: Signals of position that a zero is counted from; signals of motion, which turn with the motors.
_PLACES = ("q", "q_ref")
_MOTION = ("q", "dq", "ddq", "q_ref", "dq_ref")


def wants_current(columns: ColumnMap) -> bool:
    """Return whether the logs of a case have currents and no torques."""
    return bool(columns.current) and not columns.torque


def case_columns(log: Log, columns: ColumnMap, robot: Robot, locked: Mapping[str, float]) -> dict[str, Array]:
    """Return the columns (N,) of a log by the names that a case reads them under, in the case's units.

    Signals that the case does not name stand under their numbered names (q_ref1, ...) in SI units.

    Args:
        log: A log of the robot's joints.
        columns: How the case reads its logs.
        robot: The robot, locked joints merged.
        locked: Positions of the locked joints.
    """
    gears = gears_of(robot)
    zero = dict(zip(columns.joints, columns.zero, strict=True)) if columns.zero else {}
    shift = np.array([zero.get(name, 0.0) for name in log.joints])
    joints = columns.joints or log.joints
    found = {columns.time: _per_unit(log.time[:, None], "time", (columns.units.time,))[:, 0]}
    for name, signal in log.signals().items():
        values = signal - shift if name in _PLACES else signal
        if name in columns.motor:
            values = values @ (gears.T if name in _MOTION else np.linalg.inv(gears))
        stated = getattr(columns, name)
        names = stated or tuple(f"{NUMBERED[name]}{k}" for k in range(1, len(joints) + 1))
        own = _all_joints(values, log.joints, joints, locked if name in _PLACES else {})
        if stated or name in ("q", "dq", "torque", "current"):
            words = columns.units.of(QUANTITY[name], len(joints))
            own = _per_unit(own, QUANTITY[name], words)
            shares = [QUANTITY[name] == "torque" and counted_unit(word)[1] in RATED for word in words]
            own = own / np.where(shares, columns.rated, 1.0) if any(shares) else own
        found |= dict(zip(names, own.T, strict=True))
    return found


def write_columns(table: Mapping[str, Array], path: str | Path, decimal: str = ".") -> None:
    """Write columns (N,) as the suffix of the file says: .csv, .txt, .tsv, .npz, .parquet or .mat.

    Args:
        table: The columns by name.
        path: The file.
        decimal: Decimal sign of text files, ``.`` or ``,``.

    Raises:
        BadOption: Another suffix.
        FileError: The file cannot be written.
        MissingDependency: The package that writes it is not installed.
    """
    suffix = Path(path).suffix.lower()
    writers: dict[str, Callable[[Mapping[str, Array]], bytes]] = {
        ".csv": lambda table: _text(table, "," if decimal == "." else ";", decimal),
        ".txt": lambda table: _text(table, "," if decimal == "." else ";", decimal),
        ".tsv": lambda table: _text(table, "\t", decimal),
        ".npz": _npz,
        ".parquet": _parquet,
        ".mat": _mat,
    }
    if suffix not in writers:
        raise BadOption("--output", str(path), f"end the name in one of: {', '.join((*writers, *BAGS))}")
    write_atomically(path, writers[suffix](table))


def _all_joints(values: Array, own: tuple[str, ...], joints: tuple[str, ...], locked: Mapping[str, float]) -> Array:
    """Return values (N, n) with columns for locked joints, shape (N, m)."""
    if own == joints:
        return values
    columns = [
        values[:, own.index(name)] if name in own else np.full(len(values), locked.get(name, 0.0)) for name in joints
    ]
    return np.stack(columns, axis=1)


def _per_unit(values: Array, quantity: str, words: tuple[str, ...]) -> Array:
    """Return SI values (N, k) in the units of their columns."""
    factors = np.array([unit_of(quantity, word)[0] for word in words])
    return values if np.all(factors == 1.0) else values * factors[:, 1] / factors[:, 0]


def _text(table: Mapping[str, Array], separator: str, decimal: str) -> bytes:
    rows = np.column_stack(list(table.values())).tolist()
    lines = [separator.join(table), *(separator.join(map(repr, row)) for row in rows)]
    if decimal == ",":
        lines[1:] = [line.replace(".", ",") for line in lines[1:]]
    return ("\n".join(lines) + "\n").encode()


def _npz(table: Mapping[str, Array]) -> bytes:
    content = io.BytesIO()
    np.savez_compressed(content, **dict(table))  # type: ignore[arg-type]
    return content.getvalue()


def _parquet(table: Mapping[str, Array]) -> bytes:
    try:
        import pyarrow as pa
        import pyarrow.parquet as pq
    except ImportError as error:
        raise MissingDependency("writing Parquet", "pyarrow", "parquet") from error
    sink = pa.BufferOutputStream()
    pq.write_table(pa.table(dict(table)), sink)
    return sink.getvalue().to_pybytes()


def _mat(table: Mapping[str, Array]) -> bytes:
    from scipy.io import savemat  # loads slowly

    nested: dict[str, Any] = {}
    for name, values in table.items():
        *groups, last = name.split(".")
        inner = nested
        for group in groups:
            inner = inner.setdefault(group, {})
        inner[last] = values
    content = io.BytesIO()
    savemat(content, nested, long_field_names=True)
    return content.getvalue()


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
