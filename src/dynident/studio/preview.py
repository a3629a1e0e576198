"""What a log looks like before anything is done with it: its columns, first rows, ranges and curves; and motions.

Of an estimate, torques on the data that it was trained on and on the data that it was tested on.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from functools import lru_cache
from itertools import pairwise
from pathlib import Path, PurePath
from typing import TYPE_CHECKING, Any

import numpy as np

from dynident.arrays import Array, finite
from dynident.case.case import Case
from dynident.case.draft.time_columns import time_columns, unit_of_time
from dynident.data.formats import ColumnMap, LogTable, open_log
from dynident.data.formats._units import UNITS
from dynident.errors import BadOption, DynidentError
from dynident.studio.folder import Folder

#: Columns that are looked at, and rows that are shown as numbers.
MAX_COLUMNS, ROWS = 200, 6

#: Pairs of smallest and largest value that a curve is drawn with, and postures that a motion is played with.
BUCKETS, POSTURES = 500, 1500

#: Files above this size, in bytes, are not drawn.
LARGE = 1 << 29


def preview(path: Path, columns: ColumnMap | None = None) -> dict[str, Any]:
    """Return the columns of a log with their first rows and ranges as plain data.

    Args:
        path: The log.
        columns: Its columns by a case, which state how the file is read; None for its suffix.

    Raises:
        FileError: The file cannot be read.
        LogFormatError: It is no table of numbers.
    """
    facts = path.stat()
    table = _opened(path, columns, facts.st_mtime_ns)
    header = table.header[:MAX_COLUMNS]
    shown: dict[str, Any] = {"header": list(header), "more": len(table.header) - len(header), "how": table.how}
    if facts.st_size > LARGE:
        return {**shown, "rows": None, "first": [], "ranges": []}
    values = _values(path, columns, facts.st_mtime_ns, header)
    return {
        **shown,
        "rows": len(values),
        "first": [[finite(float(v)) for v in row] for row in values[:ROWS]],
        "ranges": [_range(values[:, k]) for k in range(len(header))],
    }


def curves(path: Path, names: tuple[str, ...], columns: ColumnMap | None = None) -> dict[str, Any]:
    """Return curves of some columns over time, by the smallest and largest value of each bucket of rows.

    The time is the column that has its name, from its first value, in s where its unit is stated; else curves are over
    the numbers of their rows.

    Args:
        path: The log.
        names: The columns.
        columns: As for :func:`preview`.

    Raises:
        BadOption: A column that the log does not have, or a file that is too large to draw.
    """
    facts = path.stat()
    table = _opened(path, columns, facts.st_mtime_ns)
    unknown = [name for name in names if name not in table.header]
    if unknown or not names or facts.st_size > LARGE:
        raise BadOption("columns", (unknown or ["", path.name])[0], "choose columns of a log of up to 512 MB")
    values = _values(path, columns, facts.st_mtime_ns, table.header[:MAX_COLUMNS])
    chosen = [table.header.index(name) for name in names]
    time, across = _time_of(table.header[:MAX_COLUMNS], values)
    found = [decimated(values[:, k]) for k in chosen]
    for one in found:
        one["x"] = [float(time[int(row or 0)]) for row in one["x"]]
    return {"rows": len(values), "across": across, "curves": found}


def _time_of(header: Sequence[str], values: Array) -> tuple[Array, str]:
    """Return the time of each sample of a log (N, columns), or its number, shape (N,), and how an axis is named."""
    names = time_columns(header)
    time = values[:, header.index(names[0])] if names else np.zeros(0)
    if len(time) < 2 or not np.all(np.diff(time) > 0):  # none, or it stands, runs back or is not finite
        return np.arange(len(values), dtype=float), "row"
    factor, _ = UNITS["time"].get(unit_of_time(names[0], header), (None, ""))
    if factor is None:
        return time - time[0], f"{names[0]}, from its first value"
    return (time - time[0]) * factor[0] / factor[1], "time [s]"


def decimated(values: Array, buckets: int = BUCKETS) -> dict[str, list[float | None]]:
    """Return row numbers and values of a curve (N,) such that no peak is lost: two values of each bucket of rows."""
    count = len(values)
    if count <= 2 * buckets:
        return {"x": [float(k) for k in range(count)], "y": [finite(float(v)) for v in values]}
    edges = np.linspace(0, count, buckets + 1).astype(int)
    rows: list[int] = []
    for start, stop in pairwise(edges.tolist()):
        part = values[start:stop]
        if np.all(np.isnan(part)):
            rows.append(start)
            continue
        rows += sorted({start + int(np.nanargmin(part)), start + int(np.nanargmax(part))})
    return {"x": [float(k) for k in rows], "y": [finite(float(values[k])) for k in rows]}


def run_times(time: Array, starts: Sequence[int]) -> Array:
    """Return the times (N,) of logs that stand one after another as one time from zero, in s.

    Args:
        time: Shape (N,), in s; starts anew with each log.
        starts: First sample of each log.
    """
    shown, end = np.array(time, dtype=float), 0.0
    for start, stop in pairwise((*starts, len(shown))):
        if stop > start:
            shown[start:stop] += end - shown[start]
            end = float(shown[stop - 1])
    return shown


def curve(time: Array, starts: Sequence[int], values: Array) -> dict[str, list[float | None]]:
    """Return a curve over the time of :func:`run_times`, no peak lost, with a gap between two logs.

    Args:
        time: Shape (N,), in s.
        starts: First sample of each log.
        values: Shape (N,).
    """
    x: list[float | None] = []
    y: list[float | None] = []
    for start, stop in pairwise((*starts, len(values))):
        found = decimated(values[start:stop], max(1, BUCKETS // len(starts)))
        if x:
            x.append(x[-1])
            y.append(None)
        x += [float(time[start + int(row or 0)]) for row in found["x"]]
        y += found["y"]
    return {"x": x, "y": y}


def motion_of_log(case: Case, path: Path) -> dict[str, Any]:
    """Return the motion of a log for playback: time in s and positions in rad or m by joint.

    Raises:
        LogFormatError: No sound log.
        LogMismatch: It does not fit the case.
    """
    log = case.read_currents(path)
    keep = np.unique(np.linspace(0, log.samples - 1, min(log.samples, POSTURES)).astype(int))
    time = log.time[keep] - log.time[0]
    return {"joints": list(log.joints), "time": time.tolist(), "q": log.q[keep].tolist(), "still": dict(case.locked)}


def motion_of_plan(path: Path) -> dict[str, Any]:
    """Return the motion of a plan for playback, from rest to rest; see :func:`motion_of_log`.

    Raises:
        FileError: No plan.
    """
    from dynident.excitation.design.plan import read_plan

    plan = read_plan(path)
    motion = plan.motion()
    time = np.linspace(0.0, motion.duration, POSTURES)
    q = motion.evaluate(time)[0]
    return {"joints": list(plan.joints), "time": time.tolist(), "q": q.tolist(), "still": {}}


def _opened(path: Path, columns: ColumnMap | None, changed: int) -> LogTable:
    return _tables(path, changed, columns) if columns is not None else _by_suffix(path, changed)


@lru_cache(maxsize=4)
def _by_suffix(path: Path, changed: int) -> LogTable:
    del changed
    return open_log(path)


@lru_cache(maxsize=4)
def _tables(path: Path, changed: int, columns: ColumnMap) -> LogTable:
    del changed
    return open_log(path, columns)


@lru_cache(maxsize=2)
def _values(path: Path, columns: ColumnMap | None, changed: int, header: tuple[str, ...]) -> Array:
    return _opened(path, columns, changed).columns(header)


def _range(values: Array) -> dict[str, float | None]:
    sound = values[np.isfinite(values)]
    if not len(sound):
        return {"lowest": None, "largest": None, "bad": float(len(values))}
    return {"lowest": float(sound.min()), "largest": float(sound.max()), "bad": float(len(values) - len(sound))}


if TYPE_CHECKING:
    from dynident.data.log import Log
    from dynident.identification.estimate.estimate import Estimate
    from dynident.identification.estimate.validation import Validation

#: Test logs above this size in all, in bytes, are not read for a picture.
LARGE_LOGS = 1 << 27


def torques_of(estimate: Estimate, data: Validation) -> dict[str, Any]:
    """Return curves of each joint's torque over time, and the motion that belongs to them, as plain data.

    Args:
        estimate: The estimate.
        data: Measured and predicted torques, of the training or of a test.
    """
    time = run_times(data.time, data.starts)
    joints = [
        {
            "name": fit.name,
            "unit": fit.unit,
            "measured": curve(time, data.starts, data.measured[:, k]),
            "predicted": curve(time, data.starts, data.predicted[:, k]),
            "residual": curve(time, data.starts, data.residual[:, k]),
        }
        for k, fit in enumerate(data.joints)
    ]
    names = list(estimate.model.robot.joint_names)
    return {"torques": joints, "motion": {"joints": names, "time": time.tolist(), "q": data.q.tolist(), "still": {}}}


def torques_on_test_data(folder: Folder, name: str) -> dict[str, Any]:
    """Return the torques of an estimate on its test data, read anew from the logs of its case.

    ``missing`` says why there are none: the estimate was not tested, or case and logs are no longer those of the test.

    Raises:
        DynidentError: No such file, or no estimate.
    """
    from dynident.api.validate import compared
    from dynident.identification.files.estimate_file import read_estimate

    path = folder.find(name)
    estimate = read_estimate(path)
    stated = json.loads(path.read_bytes()).get("summary", {}).get("test")
    if not stated:
        return _none("The estimate was not tested; choose test logs below.")
    try:
        logs, missing = _test_logs(folder, estimate)
    except (DynidentError, OSError) as error:
        logs, missing = (), f"The test logs cannot be read: {str(error).replace(f'{folder.path}/', '')}"
    if missing:
        return _none(missing)
    found = compared(estimate, logs)
    if not math.isclose(found.total_relative_error, stated["total_relative_error"], rel_tol=1e-6):
        return _none("The case or its logs are no longer those of the test.")
    return {**torques_of(estimate, found), "missing": ""}


def _none(missing: str) -> dict[str, Any]:
    return {"torques": [], "motion": None, "missing": missing}


def _test_logs(folder: Folder, estimate: Estimate) -> tuple[tuple[Log, ...], str]:
    """Return the test logs of the case of an estimate, or why there are none."""
    from dynident.api.case_logs import read_data
    from dynident.case.case import read_case

    file = PurePath(str(estimate.provenance.get("case", {}).get("path", ""))).name
    if file not in folder.names():
        return (), "The case of the estimate is not in this folder."
    case = read_case(folder.find(file))
    if not case.test and case.split is None:
        return (), "The case names no test logs; those of the test were chosen elsewhere."
    if sum(Path(case.find(log)).stat().st_size for log in {*case.train, *case.test}) > LARGE_LOGS:
        return (), "The test logs are too large to draw here; the report has their figures."
    return read_data(case).test, ""
