"""What a call from Python is given as a robot and as logs: a file, arrays, a pandas frame or values of this library."""

from __future__ import annotations

import hashlib
import os
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol, TypeAlias, runtime_checkable

import numpy as np

from dynident.api.case_options import with_drive_friction
from dynident.api.given_robots import RobotLike, is_robot_model, robot_of
from dynident.api.log_checks import case_of_model
from dynident.applications.states import motion_of_arrays, plain_numbers
from dynident.arrays import Array
from dynident.case.case import Case, read_case
from dynident.case.evidence.rows import sortable
from dynident.data.formats import ColumnMap
from dynident.data.log import Log, Source
from dynident.data.log_of_robot import with_meaning
from dynident.errors import BadArgument, nearest
from dynident.identification.estimators import ESTIMATORS
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import default_friction
from dynident.model.robot import Robot


@runtime_checkable
class DataFrameLike(Protocol):
    """A table of named columns, such as a pandas or a polars frame."""

    @property
    def columns(self) -> Any:
        """Names of the columns."""
        ...

    def __getitem__(self, name: Any) -> Any: ...


#: A log: as it is, in a file, as arrays by name, or as a frame.
LogLike: TypeAlias = Log | str | Path | Mapping[str, Any] | DataFrameLike

#: Names under which arrays and columns of a signal are looked for.
_WORDS = {
    "time": ("time", "t"),
    "q": ("q",),
    "dq": ("dq",),
    "ddq": ("ddq",),
    "torque": ("torque", "tau"),
    "current": ("current", "i"),
    "temperature": ("temperature",),
    "q_ref": ("q_ref",),
    "dq_ref": ("dq_ref",),
}

#: What stands in place of the file of a log that is given as arrays.
ARRAYS = "arrays"

#: A log as arrays, as a line that works.
EXAMPLE = '{"time": t, "q": q, "torque": tau}'


def log_of(data: LogLike, robot: RobotLike | None = None) -> Log:
    """Return a log from arrays by name, a pandas frame, or a file.

    Args:
        data: Arrays ``time`` (N,), ``q`` (N, n), ``torque`` or ``current`` (N, n), and ``dq``, ``ddq``,
            ``temperature``, ``q_ref``, ``dq_ref`` where they are measured, in SI units (a frame among them is read by
            the names of the joints where its columns have them); or a frame with columns
            ``time``, ``q1`` or ``q0``, ..., ``torque1``, ..., or ``q_NAME``, ``torque_NAME`` by the joints' names.
        robot: The robot, as :func:`robot_of` takes it: its joints, in its order; None for joint1, joint2, ...

    Raises:
        BadArgument: A wrong shape, a value that is not finite, positions in degrees, time that does not run forward.
        DynidentError: Any fault of a file.
    """
    known = None if robot is None else robot_of(robot)
    if isinstance(data, Log):
        return data
    if isinstance(data, str | Path):
        from dynident.data.formats import read_log

        return read_log(data, None if known is None else ColumnMap(joints=known.joint_names))
    if known is not None and isinstance(data, np.ndarray):
        raise _unnamed("log", data, known)
    if not isinstance(data, Mapping | DataFrameLike):
        raise BadArgument("log", f"{_kind(data)} where a log is wanted", f"write {EXAMPLE}, or give a file")
    log = _log(data, known)
    if known is None:
        return log
    motion_of_arrays(known, log.q)
    return with_meaning(log, ColumnMap(joints=known.joint_names), known)


def logs_of(data: Any, robot: Robot, read: Callable[[str | Path], Log], argument: str = "logs") -> list[Log]:
    """Return logs from one log or several, each as :func:`log_of` takes it.

    Args:
        data: The log or the logs.
        robot: The robot.
        read: Reads a file.
        argument: Name of the argument, for messages.

    Raises:
        BadArgument: Something that is no log.
        DynidentError: Any fault of a log.
    """
    if isinstance(data, str) and data in ESTIMATORS.names() and not os.path.exists(data):
        raise BadArgument(argument, f"'{data}', which is an estimator", f'write estimator="{data}"')
    one = isinstance(data, Log | str | Path | Mapping) or (
        isinstance(data, DataFrameLike) and not isinstance(data, Sequence)
    )
    if not one and not isinstance(data, Iterable):
        raise BadArgument(argument, f"{_kind(data)} where logs are wanted", f"write {EXAMPLE}, or give files")
    if isinstance(data, np.ndarray):
        raise _unnamed(argument, data, robot)
    several: list[Any] = [data] if one else list(data)  # type: ignore[arg-type]
    if any(isinstance(each, np.ndarray | float | int | list) for each in several):
        raise BadArgument(argument, f"{_kind(data)} of numbers where logs are wanted", f"write {EXAMPLE}")
    found = [read(each) if isinstance(each, str | Path) else log_of(each, robot) for each in several]
    if any(log.source.path == ARRAYS and log.torque is None for log in found):
        raise BadArgument(argument, "neither torques nor currents with drive gains", f"write {EXAMPLE}")
    return found


def _unnamed(argument: str, data: Any, robot: Robot) -> BadArgument:
    """Return the error for an array of columns without names; its step has what their values say they are."""
    evidence = f"{_kind(data)} of numbers without names"
    if data.ndim != 2 or data.dtype.kind not in "fiu":
        return BadArgument(argument, evidence, f"write {EXAMPLE}")
    from dynident.case.draft.structure import structure_of  # loads what drafts are made with

    told = structure_of(robot, [f"column {k}" for k in range(data.shape[1])], np.asarray(data, dtype=float))
    signals = {"time": told.time, **{name: group.names for name, group in told.groups.items() if name != "dq"}}
    if not told.time or "torque" not in told.groups or told.rivals:
        step = "numpy.save it, and dynident init ROBOT FILE.npy asks what its columns are"
        return BadArgument(argument, evidence, f"write {EXAMPLE}; or {step}")
    parts = [f'"{name}": log[:, {_indices(columns)}]' for name, columns in signals.items()]
    why = f"by their values: {told.evidence['q']}, and of the torques {told.evidence['torque']}"
    return BadArgument(argument, f"{evidence}; {why}", f"write {{{', '.join(parts)}}} in SI units if that is right")


def _indices(columns: str | Sequence[str]) -> str:
    """Return numbers of columns as an index of NumPy: one, a slice, or a list."""
    if isinstance(columns, str):
        return columns.split()[1]
    numbers = [int(name.split()[1]) for name in columns]
    step = numbers[1] - numbers[0] if len(numbers) > 1 else 1
    end = numbers[-1] + 1
    return f"{numbers[0]}:{end}" if step == 1 else f"{numbers[0]}:{end}:{step}"


def case_of(subject: Any, learns: bool = False) -> Case:
    """Return the case of a case file, a dynamic model, or a robot as :func:`robot_of` takes it; a case as it is.

    Args:
        subject: See above.
        learns: Whether logs are there to decide on the friction of a robot, of which none is stated.

    Raises:
        BadArgument: Something else.
        DynidentError: Any fault of a file.
    """
    if isinstance(subject, Case):
        return subject
    if isinstance(subject, str | Path):
        case = read_case(subject)
    elif isinstance(subject, Robot) or is_robot_model(subject):
        case = case_of_model(DynamicModel(robot_of(subject), default_friction()))
    elif isinstance(subject, DynamicModel):
        return case_of_model(subject)
    else:
        step = 'write di.identify("arm.urdf", log), or give a case file, a Robot or a DynamicModel'
        raise BadArgument("subject", f"{_kind(subject)} where a robot is wanted", step)
    return with_drive_friction(case) if learns else case


def check_kinds(wanted: Mapping[str, tuple[Any, Any, str]]) -> None:
    """Refuse an option of another kind than it has; None is left to the default.

    Args:
        wanted: Value, class and the line that works, by the name of the option.

    Raises:
        BadArgument: There is one.
    """
    for name, (value, kind, line) in wanted.items():
        if value is not None and not isinstance(value, kind):
            what = kind.__name__ if isinstance(kind, type) else "name or a part"
            raise BadArgument(name, f"{_kind(value)} where a {what} is wanted", f"write {line}")


def _log(data: Mapping[str, Any] | DataFrameLike, robot: Robot | None) -> Log:
    names = list(data) if isinstance(data, Mapping) else [str(name) for name in data.columns]
    if twice := [name for name, count in Counter(names).items() if count > 1]:
        raise BadArgument(
            "log", f"the columns {', '.join(twice)} stand there twice", "give each column a name of its own"
        )
    found: dict[str, Any] = {}
    used: set[str] = set()
    for signal in _WORDS:
        columns, whole = _columns_of(signal, names, robot)
        if columns:
            used.update(columns)
            found[signal] = data[columns[0]] if whole else [data[name] for name in columns]
            if not whole:
                found[signal] = np.ma.stack(found[signal], axis=1) if _hides(found[signal]) else _stacked(found[signal])
    free = [name for name in names if name not in used]
    for signal in ("time", "q"):
        if signal not in found:
            raise _missing(signal, names, free, isinstance(data, Mapping), robot)
    if isinstance(data, Mapping) and free:
        known = ", ".join(_WORDS)
        raise BadArgument("log", f"an array '{free[0]}', where the signals are {known}", f"write {EXAMPLE}")
    return _checked(found, robot)


def _columns_of(signal: str, names: Sequence[str], robot: Robot | None) -> tuple[list[str], bool]:
    """Return the columns of a signal, and whether the one column holds all joints."""
    for word in _WORDS[signal]:
        if word in names:
            return [word], True
        first = 0 if f"{word}0" in names else 1
        numbered = [f"{word}{k}" for k in range(first, first + len(names)) if f"{word}{k}" in names]
        called = [f"{word}_{name}" for name in robot.joint_names] if robot else []
        if robot and 0 < len(numbered) < robot.dof:
            lost = next(f"{word}{k}" for k in range(first, first + robot.dof) if f"{word}{k}" not in names)
            step = f'name it: frame.rename(columns={{"old": "{lost}"}}); or {_of_joints(robot, len(numbered))}'
            raise BadArgument("log", f"columns {', '.join(names[:12])}, and none is '{lost}'", step)
        for columns in (numbered, called):
            if columns and set(columns) <= set(names):
                return columns, False
    return [], False


def _missing(signal: str, names: Sequence[str], free: Sequence[str], by_name: bool, robot: Robot | None) -> BadArgument:
    listed = ", ".join(names[:12]) + (", ..." if len(names) > 12 else "")
    hint = nearest(signal, free)
    if by_name:
        return BadArgument("log", f"arrays {listed or 'none'}, and none is '{signal}'", f"write {EXAMPLE}{hint}")
    wanted = "'time'" if signal == "time" else "'q1', 'q2', ..."
    if robot is not None and signal == "q":
        wanted += f" or 'q_{robot.joint_names[0]}', ..."
    first, new = (free or ["old"])[0], "time" if signal == "time" else "q1"
    step = f'name them: frame.rename(columns={{"{first}": "{new}", ...}})'
    return BadArgument("log", f"a frame with the columns {listed}, where {wanted} is wanted", step)


def _checked(found: Mapping[str, Any], robot: Robot | None) -> Log:
    time = found["time"]
    if getattr(getattr(time, "dtype", None), "kind", "") in ("m", "M"):
        step = 'write time = (time - time[0]) / np.timedelta64(1, "s")'
        raise BadArgument("time", f"{time.dtype} where seconds are wanted", step)
    time = plain_numbers("time", time)
    if getattr(found["q"], "ndim", 0) == 3:
        step = f"pass a list of logs, one an episode: {_list_of_logs(found, time)}"
        raise BadArgument("q", f"shape {np.shape(found['q'])}, several episodes in one array", step)
    if time.ndim == 0:
        step = f"give one time a sample in s; where it is the rate: np.arange(len(q)) / {float(time):g}"
        raise BadArgument("time", f"the number {float(time):g} where (N,) is wanted", step)
    if time.ndim != 1:
        raise BadArgument("time", f"shape {time.shape} where (N,) is wanted", "write time.ravel(), one time a sample")
    back = np.flatnonzero(np.diff(time) <= 0)
    if len(back):
        row = int(back[0]) + 1
        word = "repeats" if time[row] == time[row - 1] else "runs back"
        evidence = f"it {word} at row {row} ({time[row - 1]:.9g} s, then {time[row]:.9g} s)"
        raise BadArgument("time", evidence, _forward(time, list(found)))
    signals = {name: _rows(name, values, len(time), robot) for name, values in found.items() if name != "time"}
    count = signals["q"].shape[1]
    for name, values in signals.items():
        if values.shape[1] != count:
            step = "give one column for each joint in all signals"
            raise BadArgument(name, f"shape {values.shape} where q has {signals['q'].shape}", step)
    digest = hashlib.sha256(b"".join(np.ascontiguousarray(each).tobytes() for each in (time, *signals.values())))
    joints = robot.joint_names if robot else tuple(f"joint{k}" for k in range(1, count + 1))
    return Log(joints, time, source=Source(ARRAYS, digest.hexdigest(), len(time), ("given as arrays",)), **signals)


def _list_of_logs(found: Mapping[str, Any], time: Array) -> str:
    """Return the line that makes a list of logs of arrays by episode."""
    episodes, rows = np.shape(found["q"])[:2]
    clock = "time[k]" if time.ndim > 1 else "time.reshape(len(q), -1)[k]" if len(time) == episodes * rows else "time"
    parts = [f'"{name}": {clock if name == "time" else f"{name}[k]"}' for name in found]
    return f"[{{{', '.join(parts)}}} for k in range(len(q))]"


def _forward(time: Array, names: Sequence[str]) -> str:
    """Return what to do about a time that does not run forward; no step leaves samples out without their number."""
    steps = np.diff(time)
    back = np.count_nonzero(steps < 0)
    if not back:
        lost = np.count_nonzero(steps == 0)
        return f"give the time with all its digits; of samples that repeat, leave out the {lost} that have it again"
    if sortable(time) or 10 * back > len(time):  # of mere handfuls of samples in order there are no recordings
        return "sort the samples: order = np.argsort(time), then time[order], q[order], ..."
    parts = ", ".join(f'"{name}": {name}[a:b]' for name in names)
    cuts = "cuts = [0, *(np.flatnonzero(np.diff(time) < 0) + 1), len(time)]"
    logs = f"[{{{parts}}} for a, b in zip(cuts, cuts[1:])]"
    return f"pass a list of logs, one for each of the {back + 1} recordings: {cuts}, then {logs}"


def _by_joints(name: str, values: Any, robot: Robot | None) -> Any:
    """Return the columns of a frame in the order of the joints whose names they have; other values as they are.

    Raises:
        BadArgument: Columns with the names of some of the joints.
    """
    if robot is None or not isinstance(values, DataFrameLike):
        return values
    labels, joints = [str(label) for label in values.columns], robot.joint_names
    for called in (list(joints), [f"{name}_{joint}" for joint in joints]):
        if set(called) <= set(labels):
            return values[called]
        if some := [label for label in called if label in labels]:
            evidence = f"a frame with the columns {', '.join(labels[:12])}, of which {', '.join(some)} are joints"
            step = f"name the columns of all joints: {', '.join(called)}; or give {name}.to_numpy() in that order"
            raise BadArgument(name, evidence, step)
    return values


def _rows(name: str, values: Any, rows: int, robot: Robot | None) -> Array:
    array = plain_numbers(name, _by_joints(name, values, robot))
    if array.ndim == 1 and (robot is None or robot.dof == 1):
        array = array[:, None]
    n = str(robot.dof) if robot else "n"
    if array.ndim != 2 or len(array) != rows or (robot and array.shape[1] != robot.dof):
        step = "one row for each time, one column for each joint"
        if array.ndim == 2 and array.shape[1] == rows:
            step = f"write {name}.T"
        elif robot and array.ndim == 2 and len(array) == rows:
            step = _of_joints(robot, array.shape[1])
        raise BadArgument(name, f"shape {array.shape} where ({rows}, {n}) is wanted", step)
    return array


def _of_joints(robot: Robot, columns: int) -> str:
    """Return what to do where a log has another number of columns than the robot has moving joints."""
    joints = f"one column for each of the joints {', '.join(robot.joint_names)}"
    tied = {place: joint.name for place, joint in enumerate(robot.joints) if joint.mimic is not None}
    if tied and columns == len(robot.joints):
        called = " and ".join(tied.values())
        return f"give {joints}; {called} follow{'s' * (len(tied) == 1)} others: np.delete(array, {[*tied]}, axis=1)"
    if not 0 < columns < robot.dof:
        return f"give {joints}"
    held = ", ".join(f'"{name}": 0.0' for name in robot.joint_names[columns:])
    call = f"di.robot_of(robot).locked({{{held}}})"
    return f"give {joints}; lock those that did not move, where they stood (rad or m): {call} as the robot"


def _hides(columns: Sequence[Any]) -> bool:
    return any(isinstance(each, np.ma.MaskedArray) for each in columns)


def _stacked(columns: Sequence[Any]) -> Any:
    lengths = {len(each) for each in columns}
    return np.stack([np.asarray(each) for each in columns], axis=1) if len(lengths) == 1 else list(columns)


def _kind(value: object) -> str:
    shape = getattr(value, "shape", None)
    if isinstance(value, str):
        return f"the text '{value}'"
    return f"{type(value).__name__} of shape {shape}" if isinstance(shape, tuple) else type(value).__name__
