"""A log as its file has it: values that are not finite and time that runs back are kept, not refused."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dynident.arrays import BoolArray, IntArray
from dynident.case.case import Case
from dynident.data.formats import ColumnMap, LogTable, open_log
from dynident.data.formats._text_table import TextTable
from dynident.data.formats.base import names_of, signals_of
from dynident.data.log import Log, Source, torque_from_current
from dynident.data.log_of_robot import off_lock
from dynident.data.motor_side import joint_side, with_zero
from dynident.errors import DynidentError


@dataclass(frozen=True)
class Recording:
    """Rows of a file under the names and units of a case, nothing checked.

    Attributes:
        log: The signals of the joints of the robot in SI units; torques from currents where there are gains.
        table: The file; None for a log of the memory.
        columns: The map of its columns, resolved.
        rows: Row of the file behind each sample, counted from 0, shape (N,).
        off_lock: Locked joints that move or stand elsewhere, each with evidence and next step.
    """

    log: Log
    table: LogTable | None
    columns: ColumnMap
    rows: IntArray
    off_lock: tuple[tuple[str, str, str], ...] = ()

    def place(self, sample: int) -> str:
        """Return where in the file a sample stands, such as ``line 17``."""
        row = int(self.rows[sample])
        return f"line {self.table.line_of(row)}" if isinstance(self.table, TextTable) else f"row {row + 1}"

    def column_of(self, signal: str, joint: int) -> str:
        """Return the column of the file that holds a signal of a joint of the robot; in words where there is none."""
        if signal == "time":
            return self.columns.time if self.table is not None else "the time"
        name = self.log.joints[joint]
        names = self.columns.stated().get(signal, ())
        return names[self.columns.joints.index(name)] if names else f"{signal} of {name}"

    def columns_in(self, case: Case) -> ColumnMap | None:
        """Return the map of its columns under a case, resolved; None where there is no case file, or no log file."""
        if self.table is not None:
            return self.columns
        if not (case.path and self.log.source.path):
            return None
        try:
            table = open_log(self.log.source.path, case.columns)
            return case.columns.resolved(table.header, table.path, table.line)
        except DynidentError:  # it was read before, and is gone
            return None

    def kept(self, keep: BoolArray | IntArray, step: str) -> Recording:
        """Return some samples only; ``step`` says which in words."""
        return Recording(self.log.rows(keep, step), self.table, self.columns, self.rows[keep], self.off_lock)


def read_recording(case: Case, name: str) -> Recording:
    """Return a log of a case with its faults.

    Raises:
        LogFormatError: The file is no table, a column is missing or a cell is no number.
        LogMismatch: A joint is missing.
        FileError: The file cannot be read at all.
    """
    path = case.find(name)
    table = open_log(path, case.columns)
    columns = case.columns.resolved(table.header, table.path, table.line)
    values, _ = table.read(names_of(columns))
    with np.errstate(all="ignore"):
        signals = {name: columns.counted(name, each) for name, each in signals_of(columns, values).items()}
        time = columns.time_to_si(values[:, 0])
    source = Source(table.path, table.sha256, len(values))
    log = Log(columns.joints, time, source=source, gaps=time[:1] + columns.spells_left_out(path), **signals)
    if np.all(np.diff(time) > 0.0):
        log = log.on_one_clock(columns.torque_clock)
    with np.errstate(all="ignore"):
        log, off = _at_joints(case, log)
    return Recording(log, table, columns, np.arange(log.samples), off)


def recording_of(case: Case, log: Log) -> Recording:
    """Return a log that was read already: one of the joints of the robot of the case, in SI units, whole or in part."""
    return Recording(log, None, case.columns, np.arange(log.samples))


def _at_joints(case: Case, log: Log) -> tuple[Log, tuple[tuple[str, str, str], ...]]:
    """Return the log at the joints of the robot, in its order, as ``read_with`` does, and its locked joints that move.

    Of logs on the motors' side nothing is known of locked joints.
    """
    zero = dict(zip(log.joints, case.columns.zero, strict=True)) if case.columns.zero else {}
    if case.columns.motor:
        log = joint_side(log.ordered(case.robot.joint_names), case.robot, case.columns.motor)
    if zero:
        log = with_zero(log, zero)
    off = tuple(off_lock(log, case.robot, case.locked))
    log = log.ordered(case.robot.joint_names)
    gains = {joint.name: joint.drive.gain for joint in case.robot.active if joint.drive.gain is not None}
    if log.torque is not None or log.current is None or len(gains) < case.robot.dof:
        return log, off
    return torque_from_current(log, gains, case.robot.coupling if case.robot.is_coupled else None), off
