"""Files of commanded and measured positions: tables of any format, LeRobot data sets, JSON of Rhoban BAM."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from dynident.actuators.drive_law import COUNTS
from dynident.actuators.lerobot_calibration import SHARES
from dynident.actuators.servo_log import LARGEST_ANGLE, ServoColumns, ServoLog, checked_log, rows_of
from dynident.arrays import Array
from dynident.data.formats import open_log
from dynident.data.formats._column_map import missing_column
from dynident.data.split import EPISODE, episode_rows
from dynident.errors import LogFormatError, LogMismatch
from dynident.simulation.effects import Payload

#: Measured positions may leave the calibrated range by this factor.
_MOST_SHARE = 1.2


def read_servo_logs(path: str | Path, how: ServoColumns) -> list[ServoLog]:
    """Return the logs of commanded and measured positions of a file of any format of logs.

    A file has one, or one for each recording that its column ``episode_index`` tells apart.

    Raises:
        LogFormatError: A column is missing, or the file is no sound log.
        LogMismatch: The command is missing or copies the measurement, one pose only, counts in place of radians, the
            drive is never on, or the gain of the log is not stated.
    """
    payload = payload_of(path, how.payloads)
    whole, numbers = _table_log(path, how)
    whole = replace(whole, payload=payload)
    parts = episode_rows(numbers) if len(numbers) else []
    if len(parts) < 2:
        return [checked_log(whole)]
    logs, left_out = list[ServoLog](), list[str]()
    last: LogMismatch | None = None
    for part in parts:
        log = replace(rows_of(whole, part), name=f"{whole.name} episode {numbers[part.start]:g}")
        try:
            logs.append(checked_log(log))
        except LogMismatch as problem:
            last = problem
            left_out.append(f"{log.name} is left out: {problem.evidence}")
    if not logs and last is not None:
        raise last
    logs[0] = replace(logs[0], left_out=tuple(left_out))
    return logs


def _table_log(path: str | Path, how: ServoColumns) -> tuple[ServoLog, Array]:
    """Return a table as one log, not checked, and the number of the episode of each sample, (N,); (0,) without one."""
    if str(path).lower().endswith(".json"):
        how = _columns_of_bam(path, how)
    table = open_log(path, how.columns)
    names, count = how.columns, len(how.joints)
    order = _order(how)
    q, q_ref = column_names(how, "q"), column_names(how, "q_ref")
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
    speeds = tuple(names.dq[k] for k in order) if names.dq else ()
    wanted += [*rates, *speeds]
    for name in wanted:
        if name not in table.header:
            raise missing_column(name, table.header, path, table.line)
    wanted += [EPISODE] if EPISODE in table.header else []
    unique = list(dict.fromkeys(wanted))
    values = table.read(unique)[0]
    place = {name: k for k, name in enumerate(unique)}

    def chosen(columns: Sequence[str]) -> Array:
        return values[:, [place[name] for name in columns]]

    zero = np.array([names.zero[k] for k in order]) if names.zero else 0.0
    rows = len(values)
    enabled = chosen(how.enabled) > 0.5 if how.enabled else np.ones((rows, 1), dtype=bool)
    log = ServoLog(
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
        path=str(path),
        dq=names.to_si("dq", chosen(speeds)) if speeds else None,
    )
    return log, chosen([EPISODE])[:, 0] if EPISODE in place else np.zeros(0)


def _columns_of_bam(path: str | Path, how: ServoColumns) -> ServoColumns:
    """Return the columns of a log of BAM, which states torque, voltage and gain by itself.

    Raises:
        LogMismatch: The robot has several joints.
    """
    if len(how.joints) != 1:
        step = "lock the other joints (locked: rest, joints: [...]), or log the whole arm as a table"
        raise LogMismatch(str(path), f"one servo, and the robot has {len(how.joints)} joints", step)
    own = replace(how.columns, time="t", q=None, dq=None, q_ref=None, dq_ref=None, form="bam", form_options=())
    return replace(how, columns=own, enabled=("torque_enable",), supply="input_volts")


def _order(how: ServoColumns) -> list[int]:
    """Return the place of each joint among those of the log."""
    logged = how.columns.joints or how.joints
    return [logged.index(name) for name in how.joints]


def column_names(how: ServoColumns, signal: str) -> tuple[str, ...]:
    """Return the columns of ``q`` or ``q_ref``, one for each joint; numbered where none are stated."""
    stated = how.columns.q if signal == "q" else how.columns.q_ref
    return tuple(stated[k] if stated else f"{signal}{k + 1}" for k in _order(how))


def written_positions(how: ServoColumns, values: Array) -> Array:
    """Return positions in rad or m, shape (N, n), as the columns of the command have them: counts, degrees, shares."""
    zero = np.array([how.columns.zero[k] for k in _order(how)]) if how.columns.zero else 0.0
    count = len(how.joints)
    at_0, at_1 = _positions("", how, "q_ref", np.vstack([np.zeros(count), np.ones(count)])) + zero
    written = (values - at_0) / (at_1 - at_0)
    return np.round(written, 0 if how.counts else 9)


def payload_of(path: str | Path, payloads: Mapping[str, Payload]) -> Payload | None:
    """Return the payload whose name is a part of the name of a log, the longest of several; None for none."""
    named = [key for key in payloads if key in Path(path).name]
    return payloads[max(named, key=len)] if named else None


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
        _check_coding(path, how, signal, values)
    elif how.ranges:
        logged = names.joints or how.joints
        own = [how.ranges[logged.index(joint)] for joint in how.joints]
        shared = {k: motor for k, motor in enumerate(own) if motor is not None}
        _check_shares(path, [how.joints[k] for k in shared], signal, values[:, list(shared)])
        found = np.array(names.to_si(signal, values))
        for k, motor in shared.items():
            found[:, k] = motor.radians(values[:, k])
    else:
        found = names.to_si(signal, values)
    return names.counted(signal, found) if names.wrapped else found


def _check_coding(path: str | Path, how: ServoColumns, signal: str, counts: Array) -> None:
    """Refuse counts (N, n) whose negative numbers another coding reads: by this one a joint jumps by many turns."""
    spans = {name: np.ptp(coding.radians(counts), axis=0) for name, coding in COUNTS.items()}
    own = spans.pop(how.counts)
    others = [name for name in spans if spans[name].max() <= LARGEST_ANGLE]
    if not np.isfinite(counts).all() or own.max() <= LARGEST_ANGLE or not others:
        return
    joint, family = int(np.argmax(own)), how.counts.split("_")[0]
    other = max(others, key=lambda name: name.startswith(family))
    evidence = f"{signal} of {how.joints[joint]} spans {own[joint]:.4g} rad as counts of {how.counts}"
    step = f"its negative numbers are coded otherwise: by {other} it spans {spans[other][joint]:.3g} rad"
    raise LogMismatch(str(path), evidence, f"{step} (servo: {{counts: {other}}})")


def _check_shares(path: str | Path, joints: Sequence[str], signal: str, values: Array) -> None:
    most = np.nanmax(np.abs(values), axis=0, initial=0.0)
    beyond = np.flatnonzero(most > _MOST_SHARE * SHARES)
    if signal == "q" and len(beyond):
        evidence = f"positions of {joints[beyond[0]]} reach {most[beyond[0]]:.4g}, and shares of a range end at 100"
        step = "leave calibration out and state the unit (log: {units: {position: deg}}), or name the right calibration"
        raise LogMismatch(str(path), evidence, step)


def _kp_column(how: ServoColumns, header: Sequence[str]) -> str:
    if how.kp is None and how.columns.form == "bam":
        return "kp" if "kp" in header else ""
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
