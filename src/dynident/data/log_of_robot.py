"""A log with the joints of a robot: in its order, on their side of the gears, with torques."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from dynident.data.formats import ColumnMap, read_log
from dynident.data.log import Log, torque_from_current
from dynident.data.log_places import as_named, at_hand, is_address
from dynident.data.motor_side import joint_side, with_zero
from dynident.errors import LogMismatch
from dynident.model.robot import Robot

#: How far, in rad or m, a locked joint may stand from where the case says it does.
LOCKED_TOLERANCE = 0.05


def read_with(path: str | Path, columns: ColumnMap, robot: Robot, locked: Mapping[str, float] | None = None) -> Log:
    """Return a log with the joints of a robot and with torques, currents times drive gains where it has none.

    ``path`` is a file or an address (:mod:`dynident.data.log_places`).

    Raises:
        FileError: The address cannot be reached.
        LogFormatError: The file is no sound log.
        LogMismatch: A joint is missing, currents have no gain, or a locked joint moves or stands elsewhere.
    """
    return with_meaning(_read(path, columns), columns, robot, locked)


def read_signals(path: str | Path, columns: ColumnMap, robot: Robot, locked: Mapping[str, float] | None = None) -> Log:
    """Return a log with the joints of a robot and the signals that its file has: currents stay currents.

    Raises:
        LogFormatError: The file is no sound log.
        LogMismatch: A joint is missing, or a locked joint moves or stands elsewhere.
    """
    return _at_joints(_read(path, columns), columns, robot, locked)


def _read(path: str | Path, columns: ColumnMap) -> Log:
    """Return a log as it is in its file; one at an address is copied to this machine meanwhile, and keeps its name."""
    if not is_address(str(path)):
        return read_log(path, columns)
    name = str(path)
    with at_hand(name) as file, as_named(file, name):
        log = read_log(file, columns)
    return replace(log, source=replace(log.source, path=name))


def with_meaning(log: Log, columns: ColumnMap, robot: Robot, locked: Mapping[str, float] | None = None) -> Log:
    """Return rows as they were read with the joints of a robot and with torques, as :func:`read_with` does.

    Each row stands for itself, so the samples of a log may come in parts. Errors as there.
    """
    log = _at_joints(log, columns, robot, locked)
    if log.torque is not None or log.current is None:
        return log
    gains = {joint.name: joint.drive.gain for joint in robot.active if joint.drive.gain is not None}
    return torque_from_current(log, gains, robot.coupling if robot.is_coupled else None)


def _at_joints(log: Log, columns: ColumnMap, robot: Robot, locked: Mapping[str, float] | None) -> Log:
    """Return the log with the joints of a robot, on their side of the gears, in its order."""
    zero = dict(zip(log.joints, columns.zero, strict=True)) if columns.zero else {}
    if columns.motor:
        known = [name for name in locked or {} if name in log.joints]
        if known:
            step = "leave locked joints out of joints and of the columns"
            raise LogMismatch(log.name, f"{known[0]} is locked, and a log of the motors' side has it", step)
        log = joint_side(log.ordered(robot.joint_names), robot, columns.motor)
    if zero:
        log = with_zero(log, zero)
    for _, evidence, step in off_lock(log, robot, locked):
        raise LogMismatch(log.name, evidence, step)
    return log.ordered(robot.joint_names)


def off_lock(log: Log, robot: Robot, locked: Mapping[str, float] | None = None) -> list[tuple[str, str, str]]:
    """Return locked joints that move or stand elsewhere in a log on the joints' side, each with evidence and next step.

    Without ``locked`` they are those of the robot that carry joints which move (``Robot.held``).
    """
    found = []
    for name, position in {**robot.held, **(locked or {})}.items():
        q = log.q[:, log.joints.index(name)] if name in log.joints else np.empty(0)
        away = float(np.fmax.reduce(np.abs(q - position), initial=0.0))
        if away > LOCKED_TOLERANCE:
            at = f"{np.median(q):.4g}" if np.ptp(q) < LOCKED_TOLERANCE else "..."
            step = (
                f"lock it at its logged position (locked: {{{name}: {at}}} in the case of the fit), or do not lock it; "
            )
            step += "where it stands elsewhere in each log, leave it out of joints and of the columns"
            found.append((name, f"{name} is locked at {position:g} but up to {away:.3g} away", step))
    return found
