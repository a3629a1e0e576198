"""A case file drafted from a robot description and a log: columns by their names, facts as comments, doubts as remarks.

Nothing is converted on a guess: units stand in the file for the user to check, and what no log can tell (drive gains,
the direction of gravity) is asked for.
"""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from dynident.errors import LogFormatError
from dynident.experiment.case_file.case import FORMAT
from dynident.experiment.formats import ColumnMap, read_header, read_log
from dynident.experiment.log import Log
from dynident.model.descriptions import read_robot
from dynident.model.descriptions.base import shipped_robots
from dynident.model.robot import Robot

#: Words of the field for each signal, most telling first; compared without case and separators.
WORDS: Mapping[str, tuple[str, ...]] = {
    "time": ("t", "time", "timestamp", "stamp", "times", "timesec"),
    "q": ("q", "actualq", "pos", "position", "positions", "jointposition", "jointpos", "theta", "angle", "qmeas"),
    "dq": ("dq", "qd", "actualqd", "vel", "velocity", "jointvelocity", "jointvel", "qdot", "dqmeas"),
    "torque": ("tau", "tauj", "torque", "jointtorque", "effort", "trq", "measuredtorque", "taumeas"),
    "current": ("i", "current", "actualcurrent", "motorcurrent", "cur", "curr"),
}


#: Units that stand at the end of column names; they are no more than a hint and are not believed.
UNIT_WORDS = frozenset("s ms us ns sec rad deg m mm rads degs nm n a amp amps ma".split())


@dataclass(frozen=True)
class Draft:
    """A drafted case file.

    Attributes:
        text: The YAML text.
        remarks: What the user has to check or fill in.
    """

    text: str
    remarks: tuple[str, ...]


@dataclass(frozen=True)
class Found:
    """Columns of a log by signal.

    Attributes:
        time: Column of the time.
        signals: Columns per joint of each signal found.
    """

    time: str
    signals: Mapping[str, tuple[str, ...]] = field(default_factory=dict)


def draft_case(robot: str, log: str, folder: str | Path = ".") -> Draft:
    """Draft the case file of a robot and a log.

    Args:
        robot: Robot description, or the name of a robot that ships.
        log: Log of a motion.
        folder: Where the case file will stand; paths in it are relative to it.

    Raises:
        FileError: A file cannot be read.
        DescriptionError: A fault in the robot description.
        LogFormatError: No sound log.
    """
    described = read_robot(robot)
    header = read_header(log)
    try:
        found = find_columns(header, described, log)
    except LogFormatError as error:
        remark = f"{error.evidence}: fill in the columns"
        return Draft(_text_to_fill_in(described, robot, log, header, Path(folder)), (remark,))
    columns = ColumnMap(joints=described.joint_names, time=found.time, **_complete(found))  # type: ignore[arg-type]
    read = read_log(log, columns)
    remarks = _remarks(described, read, found)
    return Draft(_text(described, robot, log, read, found, Path(folder), remarks), tuple(remarks))


def find_columns(header: Sequence[str], robot: Robot, log: str) -> Found:
    """Return which columns of a header are which signals, by the words and numbers in their names.

    Raises:
        LogFormatError: No time or no positions are found.
    """
    time = next((name for word in WORDS["time"] for name in header if _bare(name) == word), None)
    signals = {}
    for signal in ("q", "dq", "torque", "current"):
        columns = _columns_of(WORDS[signal], header, robot)
        if columns:
            signals[signal] = columns
    missing = "time" if time is None else "positions" if "q" not in signals else None
    if time is None or missing:
        listed = ", ".join(header[:40])
        step = f"the header has {listed}; write the case file by hand (docs/case-file.md) and name the columns there"
        raise LogFormatError(log, 1, f"no columns for the {missing} of {robot.dof} joints can be told", step)
    return Found(time, signals)


def _columns_of(words: Sequence[str], header: Sequence[str], robot: Robot) -> tuple[str, ...] | None:
    """Return one column per joint: a word with a number from 1 or 0, or a word with the name of the joint."""
    count = robot.dof
    for word in words:
        for first in (1, 0):
            numbered = {_bare(name): name for name in header}
            wanted = [f"{word}{k}" for k in range(first, first + count)]
            beyond = f"{word}{first + count}" in numbered
            if all(name in numbered for name in wanted) and not beyond:
                return tuple(numbered[name] for name in wanted)
        named = []
        for joint in robot.joint_names:
            forms = {_bare(joint) + word, word + _bare(joint)}
            named += [name for name in header if _bare(name) in forms][:1]
        if len(named) == count:
            return tuple(named)
    return None


def _bare(name: str) -> str:
    """Return a name without case, separators and the units at its end."""
    words = re.findall(r"[a-z0-9]+", name.lower())
    while len(words) > 1 and words[-1] in UNIT_WORDS:
        words.pop()
    return "".join(words)


def _complete(found: Found) -> dict[str, tuple[str, ...]]:
    return {signal: found.signals.get(signal, ()) for signal in ("q", "dq", "torque", "current")}


def _remarks(robot: Robot, log: Log, found: Found) -> list[str]:
    remarks = []
    largest = float(np.abs(log.q).max())
    if largest > 4 * np.pi:
        remarks.append(f"positions reach {largest:.4g}: if they are degrees, set units: position: deg")
    for joint, low, high in zip(robot.active, log.q.min(axis=0), log.q.max(axis=0), strict=True):
        if low < joint.limits.lower - 0.02 or high > joint.limits.upper + 0.02:
            span = f"{low:.4g} to {high:.4g}, limits {joint.limits.lower:.4g} to {joint.limits.upper:.4g}"
            remarks.append(f"{joint.name} leaves its limits ({span}): check units, sign and order of the columns")
        if high - low < 1e-3:
            remarks.append(f"{joint.name} never moves; lock it (locked:) or record a motion of all joints")
    if "torque" not in found.signals:
        what = "currents only: fill in the drive gains" if "current" in found.signals else "no torques and no currents"
        remarks.append(what)
    return remarks


def _text(
    robot: Robot, description: str, path: str, log: Log, found: Found, folder: Path, remarks: Sequence[str]
) -> str:
    steps = np.diff(log.time)
    moved = np.ptp(log.q, axis=0) >= 1e-3
    still = {n: q for n, q, m in zip(robot.joint_names, np.median(log.q, axis=0), moved, strict=True) if not m}
    where = description if description in shipped_robots() else _relative(description, folder)
    gravity = ", ".join(f"{g:g}" for g in robot.gravity)
    lines = [
        "# Case file of dynident; docs/case-file.md describes every key.",
        f"# Drafted from {Path(path).name}: {log.samples} samples, {log.duration:.4g} s,",
        f"# {1 / np.median(steps):.5g} Hz, steps of {steps.min() * 1e3:.4g} to {steps.max() * 1e3:.4g} ms.",
        *[f"# CHECK: {remark}" for remark in remarks],
        f"case: {FORMAT}",
        f"robot: {_quoted(where)}",
        f"# gravity: [{gravity}]   # in the base frame, m/s^2; turn it for a tilted mounting",
        f"locked: {{{', '.join(f'{_quoted(name)}: {q:.6g}' for name, q in still.items())}}}   # where they stand"
        if still
        else "# locked: {joint6: 0}",
        f"joints: {_list(robot.joint_names)}   # in the order of the columns",
        *_drives(robot, found),
        "friction:",
        "  - coulomb: {width: 0.02}   # rad/s over which the sign turns",
        "  - viscous",
        "  - offset",
        "  # - rotor_inertia          # for geared drives whose torque is measured at the motor",
        "log:",
        "  columns:",
        f"    time: {_quoted(found.time)}",
        *[f"    {signal}: {_list(names)}" for signal, names in found.signals.items()],
        *_unit_lines(robot, found),
        "preprocessing:",
        "  filter:",
        "    butterworth: {cutoff_hz: 5}   # on both sides of the equation; positions five times higher",
        "  rate_hz: 200",
        "  trim_s: 0.5",
        "  standstill: 0.02             # rad/s; rows at rest are left out of the fit",
        "estimator: consistent",
        f"train: {_quoted(_relative(path, folder))}",
        "split: first:0.67              # or test: another-run.csv",
    ]
    return "\n".join(lines) + "\n"


def _text_to_fill_in(robot: Robot, description: str, path: str, header: Sequence[str], folder: Path) -> str:
    """Return the case file of a log whose columns cannot be told: they stand there as a comment."""
    where = description if description in shipped_robots() else _relative(description, folder)
    lines = [
        "# Case file of dynident; docs/case-file.md describes every key.",
        f"# The columns of {Path(path).name}: {', '.join(repr(name) for name in header)}",
        f"case: {FORMAT}",
        f"robot: {_quoted(where)}",
        f"joints: {_list(robot.joint_names)}   # FILL IN: only those in the log, in the order of its columns",
        "# locked: rest              # when the log has fewer joints than the robot",
        "friction: [coulomb, viscous, offset]",
        "log:",
        "  columns:                  # FILL IN: one name per joint, or a pattern with {} for its number",
        "    time:",
        "    q: []",
        "    torque: []              # or current: [], with drives: {joint: {gain: ...}}",
        *_unit_lines(robot, Found("", {"q": (), "torque": ()})),
        f"train: {_quoted(_relative(path, folder))}",
        "split: first:0.67",
    ]
    return "\n".join(lines) + "\n"


def _drives(robot: Robot, found: Found) -> list[str]:
    if "torque" in found.signals or "current" not in found.signals:
        return []
    head = "drives:   # FILL IN: joint torque per ampere of motor current, N m/A (gear ratio x torque constant)"
    return [head, *[f"  {_quoted(name)}: {{gain: }}" for name in robot.joint_names]]


def _unit_lines(robot: Robot, found: Found) -> list[str]:
    def words(turning: str, sliding: str) -> str:
        each = [sliding if joint.kind == "prismatic" else turning for joint in robot.active]
        return each[0] if len(set(each)) == 1 else f"[{', '.join(each)}]"

    lines = ["  units:   # CHECK: no log can tell them", "    time: s", f"    position: {words('rad', 'm')}"]
    lines += [f"    velocity: {words('rad/s', 'm/s')}"] if "dq" in found.signals else []
    lines += [f"    torque: {words('N m', 'N')}"] if "torque" in found.signals else []
    return lines + (["    current: A"] if "current" in found.signals else [])


def _relative(path: str, folder: Path) -> str:
    return Path(os.path.relpath(path, folder)).as_posix()


def _list(names: Sequence[str]) -> str:
    return f"[{', '.join(_quoted(name) for name in names)}]"


def _quoted(text: str) -> str:
    """Return a text as YAML: plain where it is a simple word, else in single quotes."""
    simple = re.fullmatch(r"[A-Za-z_./][A-Za-z0-9_./+-]*", text) and text.lower() not in ("null", "none")
    return text if simple else "'" + text.replace("'", "''") + "'"
