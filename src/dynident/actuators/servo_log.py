"""Logs of commanded and measured positions: read, checked, and what spoils them."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from dynident.actuators.drive_law import COUNTS, DriveLaw
from dynident.arrays import Array, BoolArray
from dynident.data.formats import ColumnMap, open_log
from dynident.data.formats.base import missing_column
from dynident.errors import BadOption, FileError, LogFormatError, LogMismatch

#: Share of samples whose reads may fail before a log is refused.
_MOST_FAILED = 0.5

#: A position is a failed read where it leaves the line through its neighbours by this many median steps and comes back.
_SPIKE = 12.0

#: Positions beyond this many rad are counts, or degrees.
_LARGEST_ANGLE = 40.0

#: A command counts as copied where this share of it, in motion, is the measurement of another sample, at most this many
#: samples away.
_COPIED, _MOST_LAG = 0.9, 5

#: Fewest samples of a log.
_FEWEST = 20


@dataclass(frozen=True)
class ServoColumns:
    """Which columns of a log are what.

    Attributes:
        joints: Names of the n joints.
        columns: Names of time, positions and commands, with their units.
        enabled: Columns that are 1 where the drive is on: one for all joints, or one per joint; empty for always on.
        supply: Column of the supply voltage; empty for none.
        nominal_volts: Voltage at which the torque at full duty is stated; 0: the voltage is not used.
        added: Columns of feed-forward torque or duty, one per joint; empty for none.
        kp: Position gain of each log: a number for all, a column, a pattern with ``{}`` in the log's name, or numbers
            by name; None where it is not known.
        counts: Name of a coding of COUNTS where positions and commands are counts; empty where they have a unit.
    """

    joints: tuple[str, ...]
    columns: ColumnMap = field(default_factory=ColumnMap)
    enabled: tuple[str, ...] = ()
    supply: str = ""
    nominal_volts: float = 0.0
    added: tuple[str, ...] = ()
    kp: float | str | Mapping[str, float] | None = None
    counts: str = ""


#: Stands for a friction model that held-out roll-outs choose.
AUTO = "auto"


@dataclass(frozen=True)
class ServoSetup:
    """What a case says of its servos.

    Attributes:
        laws: Drive law of each joint, in the order of the robot.
        columns: Which columns of the logs are what.
        friction: Name of a friction model, or ``auto``.
    """

    laws: tuple[DriveLaw, ...]
    columns: ServoColumns
    friction: str = AUTO


@dataclass(frozen=True)
class ServoLog:
    """Commands and measured positions of n joints.

    Attributes:
        name: The file.
        joints: Names of the n joints.
        time: Shape (N,), in s.
        q: Measured positions, shape (N, n), in rad or m; where a read failed the line between its neighbours.
        q_ref: Commanded positions, shape (N, n).
        dq_ref: Commanded velocities, shape (N, n); zero where there are none.
        added: Feed-forward duty or torque, shape (N, n).
        enabled: Whether the drive is on, shape (N, n).
        supply: Supply voltage over the nominal one, shape (N,).
        failed: Reads that failed, shape (N, n).
        kp: Position gain in the drive's unit; nan where it is not known.
    """

    name: str
    joints: tuple[str, ...]
    time: Array
    q: Array
    q_ref: Array
    dq_ref: Array
    added: Array
    enabled: BoolArray
    supply: Array
    failed: BoolArray
    kp: float

    @property
    def samples(self) -> int:
        """N."""
        return len(self.time)


def read_servo_log(path: str | Path, how: ServoColumns) -> ServoLog:
    """Return a log of commanded and measured positions; BAM JSON by its suffix, else any format that logs have.

    Raises:
        LogFormatError: A column is missing, or the file is no sound log.
        LogMismatch: The command is missing or copies the measurement, one pose only, counts in place of radians, the
            drive is never on, or the gain of the log is not stated.
    """
    if str(path).lower().endswith(".json"):
        return _checked(_bam_log(path, how))
    table = open_log(path, how.columns)
    names, count = how.columns, len(how.joints)
    logged = names.joints or how.joints
    order = [logged.index(name) for name in how.joints]
    q, q_ref = (
        tuple((stated or tuple(f"{word}{k + 1}" for k in range(len(logged))))[k] for k in order)
        for stated, word in ((names.q, "q"), (names.q_ref, "q_ref"))
    )
    if not set(q_ref) <= set(table.header):
        missing = next(name for name in q_ref if name not in table.header)
        step = (
            f"log the commanded position of each joint beside the measured one and name it (log: {{columns: {{q_ref: "
            f"[...]}}}}); the header has {', '.join(table.header[:30])}"
        )
        raise LogFormatError(path, table.line, f"no column of the command ('{missing}')", step)
    kp_column = _kp_column(how, table.header)
    wanted = [names.time, *q, *q_ref, *how.enabled, *how.added, *filter(None, (how.supply, kp_column))]
    rates = tuple(names.dq_ref[k] for k in order) if names.dq_ref else ()
    wanted += rates
    for name in wanted:
        if name not in table.header:
            raise missing_column(name, table.header, path, table.line)
    unique = list(dict.fromkeys(wanted))
    values = table.read(unique)[0]
    place = {name: k for k, name in enumerate(unique)}

    def chosen(columns: Sequence[str]) -> Array:
        return values[:, [place[name] for name in columns]]

    zero = np.array([names.zero[k] for k in order]) if names.zero else 0.0
    rows = len(values)
    enabled = chosen(how.enabled) > 0.5 if how.enabled else np.ones((rows, 1), dtype=bool)
    return _checked(
        ServoLog(
            name=str(path),
            joints=how.joints,
            time=names.time_to_si(chosen([names.time])[:, 0]),
            q=_positions(path, how, "q", chosen(q)) + zero,
            q_ref=_positions(path, how, "q_ref", chosen(q_ref)) + zero,
            dq_ref=names.to_si("dq_ref", chosen(rates)) if rates else np.zeros((rows, count)),
            added=chosen(how.added) if how.added else np.zeros((rows, count)),
            enabled=np.broadcast_to(enabled, (rows, count)).copy(),
            supply=_supply(how, chosen([how.supply])[:, 0] if how.supply else np.full(rows, np.nan)),
            failed=np.zeros((rows, count), dtype=bool),
            kp=float(np.nanmedian(chosen([kp_column]))) if kp_column else kp_of(path, how.kp),
        )
    )


def _supply(how: ServoColumns, volts: Array) -> Array:
    """Return the supply voltage over the nominal one, shape (N,); 1 where it is not known or not used."""
    if not how.nominal_volts:
        return np.ones(len(volts))
    return np.where(np.isfinite(volts), volts, how.nominal_volts) / how.nominal_volts


def _positions(path: str | Path, how: ServoColumns, signal: str, values: Array) -> Array:
    """Return positions in rad or m, shape (N, n), from those of the columns of ``q`` or ``q_ref``."""
    names = how.columns
    if how.counts:
        whole = values[np.isfinite(values)]
        if np.any(whole != np.round(whole)):
            row, column = np.argwhere(np.isfinite(values) & (values != np.round(values)))[0]
            evidence = f"{signal} of {how.joints[column]} is {values[row, column]:.6g} in sample {row + 1}: no count"
            raise LogMismatch(str(path), evidence, "leave out counts under servo: and state the unit of the positions")
        found = COUNTS[how.counts].radians(values)
    else:
        found = names.to_si(signal, values)
    return names.counted(signal, found) if names.wrapped else found


def _kp_column(how: ServoColumns, header: Sequence[str]) -> str:
    return how.kp if isinstance(how.kp, str) and "{}" not in how.kp and how.kp in header else ""


def kp_of(path: str | Path, kp: float | str | Mapping[str, float] | None) -> float:
    """Return the position gain of a log by its name.

    Raises:
        LogMismatch: The name says none.
    """
    if kp is None:
        return float("nan")
    if isinstance(kp, int | float):
        return float(kp)
    name = Path(path).name
    if isinstance(kp, str):
        found = re.search(re.escape(kp).replace(r"\{\}", r"(\d+(?:\.\d+)?)"), name) if "{}" in kp else None
        if found is None:
            step = "write kp: a number, {log: number, ...}, a column of the log, or a pattern such as 'kp{}'"
            raise LogMismatch(str(path), f"no position gain by kp: {kp!r} in its name or columns", step)
        return float(found[1])
    for key, value in kp.items():
        if Path(key).name == name:
            return float(value)
    raise LogMismatch(str(path), "the case file states no kp for it", "add it under servo: {kp: {...}}")


def _bam_log(path: str | Path, how: ServoColumns) -> ServoLog:
    """Return a log of the JSON that Rhoban BAM records: entries of position, goal_position, torque_enable."""
    try:
        data: Any = json.loads(Path(path).read_text(encoding="utf-8"))
        entries = data["entries"]
        signals = {
            name: np.array([float(entry.get(name, fallback)) for entry in entries])
            for name, fallback in (
                ("timestamp", np.nan),
                ("position", np.nan),
                ("goal_position", np.nan),
                ("torque_enable", 1.0),
                ("input_volts", np.nan),
            )
        }
    except OSError as error:
        raise FileError(path, str(error.strerror), "name a file that can be read") from error
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        step = "logs of BAM have 'entries', each with timestamp, position, goal_position and torque_enable"
        raise LogFormatError(path, None, f"no log of BAM ({type(error).__name__}: {error})", step) from error
    if len(how.joints) != 1:
        step = "lock the other joints (locked: rest, joints: [...]), or log the whole arm as a table"
        raise LogMismatch(str(path), f"one servo, and the robot has {len(how.joints)} joints", step)
    time, rows = signals["timestamp"], len(entries)
    if np.isnan(time).all() and "dt" in data:
        time = np.arange(rows) * float(data["dt"])
    kp = how.kp if how.kp is not None else data.get("kp")
    return ServoLog(
        name=str(path),
        joints=how.joints,
        time=time,
        q=signals["position"][:, None],
        q_ref=signals["goal_position"][:, None],
        dq_ref=np.zeros((rows, 1)),
        added=np.zeros((rows, 1)),
        enabled=signals["torque_enable"][:, None] > 0.5,
        supply=_supply(how, signals["input_volts"]),
        failed=np.zeros((rows, 1), dtype=bool),
        kp=kp_of(path, float(kp) if isinstance(kp, int | float) else kp),
    )


def _checked(log: ServoLog) -> ServoLog:
    """Return a log without rows that cannot be placed, with its failed reads marked and bridged.

    Raises:
        LogMismatch: What read_servo_log says.
    """
    good = np.isfinite(log.time) & np.isfinite(log.q_ref).all(axis=1)
    good &= log.time > np.maximum.accumulate(np.concatenate([[-np.inf], np.where(good, log.time, -np.inf)[:-1]]))
    log = _rows(log, good)
    if log.samples < _FEWEST:
        raise LogMismatch(log.name, f"only {log.samples} samples with a time and a command", "log seconds of motion")
    failed = np.column_stack([_failed_reads(log.time, column) for column in log.q.T])
    q = log.q.copy()
    for joint in range(q.shape[1]):
        bad = failed[:, joint]
        if bad.mean() > _MOST_FAILED:
            evidence = f"{bad.sum()} of {log.samples} reads of {log.joints[joint]} failed"
            raise LogMismatch(log.name, evidence, "repair the bus (speed, cable, power) and record again")
        q[bad, joint] = np.interp(log.time[bad], log.time[~bad], q[~bad, joint])
    _check_meaning(log, q)
    return replace(log, q=q, failed=failed)


def _rows(log: ServoLog, keep: BoolArray) -> ServoLog:
    signals = ("time", "q", "q_ref", "dq_ref", "added", "enabled", "supply", "failed")
    return replace(log, **{name: getattr(log, name)[keep] for name in signals})


def _failed_reads(time: Array, q: Array) -> BoolArray:
    """Return which positions are missing, or leave the line between their neighbours and come back at once."""
    failed = ~np.isfinite(q)
    sound = np.flatnonzero(~failed)
    if len(sound) < _FEWEST:
        return failed
    t, x = time[sound], q[sound]
    line = x[:-2] + (x[2:] - x[:-2]) * (t[1:-1] - t[:-2]) / (t[2:] - t[:-2])
    away = np.abs(x[1:-1] - line)
    steps = np.abs(np.diff(x))
    usual = max(float(np.quantile(steps, 0.99)), 1e-9)
    spikes = (away > _SPIKE * usual) & (np.abs(x[2:] - x[:-2]) < 0.5 * away)
    failed[sound[1:-1][spikes]] = True
    return failed


def _check_meaning(log: ServoLog, q: Array) -> None:
    for joint, name in enumerate(log.joints):
        measured, command = q[:, joint], log.q_ref[:, joint]
        if max(np.ptp(measured), np.ptp(command)) > _LARGEST_ANGLE:
            evidence = f"positions of {name} span {np.ptp(measured):.4g} rad: they are counts, or degrees"
            step = (
                f"state the unit (log: {{units: {{position: deg}}}}), or say what counts they are (servo: {{counts: "
                f"{' or '.join(COUNTS)}}})"
            )
            raise LogMismatch(log.name, evidence, step)
        if np.ptp(measured) < 1e-3 and np.ptp(command) < 1e-3:
            step = "log a motion of tens of degrees, or leave the joint out (locked: {joint: position})"
            raise LogMismatch(log.name, f"{name} stands in one pose throughout", step)
        if not log.enabled[:, joint].any():
            step = "log with the torque on; where the column is 0 while the drive is on, it is inverted: turn it over"
            raise LogMismatch(log.name, f"the drive of {name} is never on by its column", step)
        on = log.enabled[:, joint]
        if np.ptp(measured) > 1e-3 and np.max(np.abs(measured - command)[on], initial=0.0) < 1e-9:
            step = "log what the controller sends (goal position), not the position that it reads back"
            raise LogMismatch(log.name, f"the command of {name} equals its measurement in every sample", step)
        lag = _copied(measured, command, on)
        if lag:
            when = f"{abs(lag)} sample{'s' * (abs(lag) > 1)} {'later' if lag > 0 else 'before'}"
            step = "log what the controller sends (goal position, the pose of the leader arm), not what it reads back"
            raise LogMismatch(log.name, f"the command of {name} is its measurement {when}", step)
        _check_inverted(log, joint, measured, command, on)


def _copied(measured: Array, command: Array, on: BoolArray) -> int:
    """Return the samples by which a command that copies the measurement is ahead of it, or behind it; 0 for none."""
    count = len(measured)
    for lag in (value * sign for value in range(1, _MOST_LAG + 1) for sign in (1, -1)):
        now, then = np.arange(max(0, -lag), count - max(0, lag)), np.arange(max(0, lag), count + min(0, lag))
        moves = on[now] & (np.abs(np.gradient(measured)[then]) > 0)
        if moves.sum() > _FEWEST and np.mean(np.abs(command[now] - measured[then])[moves] < 1e-9) > _COPIED:
            return lag
    return 0


def _check_inverted(log: ServoLog, joint: int, measured: Array, command: Array, on: BoolArray) -> None:
    """Refuse a torque-enable column that is inverted: the joint follows its command only where the drive is off."""
    if min(on.sum(), (~on).sum()) < _FEWEST:
        return

    def follows(part: BoolArray) -> float:
        if np.ptp(command[part]) < 0.05 or np.ptp(measured[part]) == 0:
            return float("nan")
        return float(np.corrcoef(command[part], measured[part])[0, 1])

    with_drive, without = follows(on), follows(~on)
    if without > 0.7 and not with_drive > 0.3:
        evidence = f"{log.joints[joint]} follows its command where the drive is off, and not where it is on"
        raise LogMismatch(log.name, evidence, "the column of the torque is inverted: turn it over (1 is on)")


def kp_values(logs: Sequence[ServoLog]) -> tuple[float, ...]:
    """Return the position gains of logs, sorted, without repeats."""
    return tuple(sorted({log.kp for log in logs if np.isfinite(log.kp)}))


def is_outside(kp: float, gains: Sequence[float]) -> bool:
    """Return whether a position gain is outside the range of others; never where there are none."""
    return bool(gains) and not min(gains) <= kp <= max(gains)


def check_gains(logs: Sequence[ServoLog], kp: float | None) -> list[ServoLog]:
    """Return logs in which each has a gain; ``kp`` where the log states none.

    Raises:
        BadOption: Some logs state gains and others do not.
    """
    stated = [np.isfinite(log.kp) for log in logs]
    if all(stated):
        return list(logs)
    if any(stated):
        raise BadOption("servo.kp", None, f"{logs[stated.index(False)].name} states no kp, other logs do; state all")
    return [ServoLog(**{**vars(log), "kp": 1.0 if kp is None else kp}) for log in logs]
