"""A stream of rows as the monitor takes it: velocities, and each torque beside the motion that it belongs to.

Its text is a log that is still being written: a header, then rows one at a time, as from a pipe.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np

from dynident.applications.monitor.monitor import Monitor, MonitorSample, MonitorState, step
from dynident.arrays import Array
from dynident.data.formats._clocked_table import with_made
from dynident.data.formats._column_map import ColumnMap
from dynident.data.formats._text_header import cells_of, delimiter_of
from dynident.data.formats._text_table import TextTable, stamped
from dynident.data.formats.base import Blocks, Checked, LogTable, names_of
from dynident.data.log import Log
from dynident.data.log_of_robot import with_meaning
from dynident.errors import LogFormatError, LogMismatch
from dynident.identification.estimate.estimate import Estimate
from dynident.model.robot import Robot


@dataclass(frozen=True)
class _Sample:
    """One instant; ``is_first``: behind a gap."""

    time: float
    q: Array
    dq: Array
    torque: Array
    temperature: Array | None
    is_first: bool = False


def watch(
    monitor: Monitor, lines: Iterable[str], columns: ColumnMap | None = None, robot: Robot | None = None
) -> Iterator[MonitorSample]:
    """Yield the reading of each sample of a text that is still being written.

    As for a log (:func:`dynident.applications.monitor.signals.signals_of`), without velocities they are differences,
    and positions and torques are means over the same two samples; the motion is shifted by the torque's delay in the
    fit, linearly between samples. Time need not be uniform; nothing is made of samples on both sides of a gap.

    Args:
        monitor: The monitor.
        lines: The lines, such as ``sys.stdin``.
        columns: Their columns and units; None for those of the fit.
        robot: The robot of the lines, with its joints, drive gains and gears; None for that of the fit.

    Raises:
        LogFormatError: A row that is unsound, named by its number.
        LogMismatch: No torques or temperatures, or joints that are not the robot's.
    """
    state = MonitorState()
    estimate = monitor.observer.estimate
    samples = _samples(estimate, lines, columns or estimate.columns, robot or estimate.model.robot)
    for one in _beside(_with_speed(_behind_gaps(samples, monitor)), estimate.preprocessing.delay_s or 0.0):
        state, reading = step(monitor, state, one.time, one.q, one.dq, one.torque, one.temperature)
        yield reading


def _samples(
    estimate: Estimate, lines: Iterable[str], columns: ColumnMap, sender: Robot
) -> Iterator[tuple[_Sample, bool]]:
    """Yield samples, and whether they have velocities."""
    robot, needs = estimate.model.robot, estimate.model.needs
    for row in live_rows(lines, columns):
        log = with_meaning(row, columns, sender).ordered(robot.joint_names)
        if log.torque is None:
            raise LogMismatch(
                log.name, "no torques", "send torque columns, or currents with the drive gains of the fit"
            )
        if "temperature" in needs and log.temperature is None:
            raise LogMismatch(log.name, "no temperatures of the drives", "send them: the friction depends on them")
        warm = None if log.temperature is None else log.temperature[0]
        speed = np.zeros_like(log.q[0]) if log.dq is None else log.dq[0]
        yield _Sample(float(log.time[0]), log.q[0], speed, log.torque[0], warm), log.dq is not None


def _behind_gaps(samples: Iterable[tuple[_Sample, bool]], monitor: Monitor) -> Iterator[tuple[_Sample, bool]]:
    """Yield samples, of which those behind a gap say so."""
    last, shortest = np.inf, np.inf
    for one, moving in samples:
        shortest = min(shortest, one.time - last) if one.time > last else shortest
        yield replace(one, is_first=one.time - last > monitor.longest_step(shortest)), moving
        last = one.time


def _with_speed(samples: Iterable[tuple[_Sample, bool]]) -> Iterator[_Sample]:
    """Yield samples with velocities, those between two where they are differences."""
    last: _Sample | None = None
    for one, moving in samples:
        if moving:
            yield one
        elif last is not None and not one.is_first:
            speed = (one.q - last.q) / (one.time - last.time)
            q, torque = 0.5 * (last.q + one.q), 0.5 * (last.torque + one.torque)
            yield _Sample(0.5 * (last.time + one.time), q, speed, torque, one.temperature, last.is_first)
        last = one


def _beside(samples: Iterable[_Sample], delay: float) -> Iterator[_Sample]:
    """Yield torques beside the motion ``delay`` seconds before, as soon as both are there."""
    if not delay:
        yield from samples
        return
    motion: deque[_Sample] = deque()
    waiting: deque[_Sample] = deque()
    for one in samples:
        if one.is_first:
            motion.clear()
            waiting.clear()
        motion.append(one)
        waiting.append(one)
        while waiting and waiting[0].time - delay <= motion[-1].time:
            wanted = waiting[0].time - delay
            while len(motion) > 1 and motion[1].time <= wanted:
                motion.popleft()
            held = waiting.popleft()
            if motion[0].time <= wanted:
                q, dq = (_between(motion, wanted, name) for name in ("q", "dq"))
                yield _Sample(held.time, q, dq, held.torque, held.temperature)


def _between(motion: deque[_Sample], time: float, name: str) -> Array:
    """Return a signal at a time, linearly between the first two samples."""
    first, second = motion[0], motion[min(1, len(motion) - 1)]
    span = second.time - first.time
    share = (time - first.time) / span if span else 0.0
    return (1.0 - share) * getattr(first, name) + share * getattr(second, name)


#: What messages call the text.
NAME = "standard input"


def live_rows(lines: Iterable[str], columns: ColumnMap) -> Iterator[Log]:
    """Yield each row of a text as a log of one sample in SI units, as soon as it has come.

    The text is that of a CSV file: a header, one row a sample, comments after # and blank lines passed over.

    Args:
        lines: The lines, such as ``sys.stdin``.
        columns: Which columns are which signals, and their units.

    Raises:
        LogFormatError: No header, a column that is missing, a cell that is no finite number, time that stands still.
    """
    told = ((k, line) for k, line in enumerate(lines, 1) if line.strip() and not line.lstrip().startswith("#"))
    header, first = next(told, None), next(told, None)
    if header is None or first is None:
        raise LogFormatError(NAME, None, "it ended before its first row", "send a header and then a row a sample")
    texts = [header[1].removeprefix("\ufeff").strip(), first[1].strip()]
    sign = delimiter_of(texts, columns.decimal, None)
    names, cells = ([cell.strip() for cell in cells_of(text, sign)] for text in texts)
    table = with_made(_LiveTable(
        path=NAME, sha256="", header=tuple(names), how="text", line=header[0], time_stamps=stamped(names, cells),
        delimiter=sign, decimal=columns.decimal, before=header[0], rest=chain((first,), told),
    ), columns)  # fmt: skip
    chosen = columns.resolved(table.header, NAME, table.line)
    checked = Checked(table, chosen)
    for values in table.batches(names_of(chosen), 1):
        yield checked.block(values)


@dataclass(frozen=True, kw_only=True)
class _LiveTable(TextTable):
    """Lines as they come with their numbers, each read once."""

    rest: Iterator[tuple[int, str]]
    fault = LogTable.fault  # what has come cannot be read again

    def batches(self, names: Sequence[str], rows: int) -> Blocks:
        places = [self.header.index(name) for name in names]
        for row in self.rest:
            yield self.careful(places, self.held(((row[0], row[1].strip()),)))
        return ()
