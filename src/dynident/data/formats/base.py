"""What a log format is: files of named columns of numbers, and the log that a map of columns makes of them."""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from collections.abc import Generator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar, TypeAlias

import numpy as np

from dynident.arrays import Array
from dynident.data.formats._column_map import NUMBERED, ColumnMap, shown
from dynident.data.log import Log, Source
from dynident.errors import BadOption, LogFormatError, LogMismatch
from dynident.files import size_of_file

#: Fewer rows than this are no log.
MIN_SAMPLES = 10

#: Cells that are read at once at most: 2 GiB of numbers.
MAX_CELLS = 1 << 28

#: Bytes of all logs of a fit together above which they are reduced as a stream.
LARGE = 512 << 20

#: What to do with a file that is larger than what is read at once.
TOO_LARGE = "reduce it as a stream: dynident reduce CASE LOG -o part.tri"

#: What to do where cells hold no number, where rows have the time of the row before, and where its values as well.
_NOT_FINITE = "repair the recording or leave these rows out ('dynident check' with --fix OUT.csv, of a few)"
_SAME_TIME = "'dynident check' with --fix OUT.csv leaves a few out; of many write the time with more digits"
_REPEATED = "they are the same in all that is read: have them left out (log: {repeats: drop})"

#: Blocks of rows of a table, shape (rows, columns); when they have ended, in words what was done to get them.
Blocks: TypeAlias = Generator[Array, None, tuple[str, ...]]


@dataclass(frozen=True, kw_only=True)
class LogTable(ABC):
    """A file whose bytes are sound and whose columns are known; its rows are read by :meth:`columns`.

    Attributes:
        path: The file as it was given.
        sha256: Hash of its bytes.
        header: Names of the columns, in order.
        how: In words how it is read, for the provenance.
        line: Line of the header where the file is text, counted from 1; else None.
        rereads: Whether some columns can be read again at little cost; a stream keeps the rows of others on disk.
        time_stamps: Columns whose cells are time stamps, read in s.
        has_frames: Whether messages of a recording are behind it, each with the name of its frame.
    """

    path: str
    sha256: str
    header: tuple[str, ...]
    how: str
    line: int | None = None
    time_stamps: tuple[str, ...] = ()

    rereads: ClassVar[bool] = True
    has_frames: ClassVar[bool] = False

    @abstractmethod
    def columns(self, names: Sequence[str]) -> Array:
        """Return some columns, shape (N, len(names)).

        Raises:
            LogFormatError: A cell that is no number.
        """

    def read(self, names: Sequence[str]) -> tuple[Array, tuple[str, ...]]:
        """Return some columns, shape (N, len(names)), and in words what was done to get them.

        Raises:
            LogFormatError: A cell that is no number.
        """
        return self.columns(names), ()

    def batches(self, names: Sequence[str], rows: int) -> Blocks:
        """Yield some columns in blocks of at most ``rows`` rows, shape (rows, len(names)); returns the notes.

        Memory holds one block, except in formats that can only be read as a whole: there all rows are in memory.

        Raises:
            LogFormatError: A cell that is no number.
        """
        values, notes = self.read(names)
        for start in range(0, len(values), rows):
            yield values[start : start + rows]
        return notes

    def fault(self, row: int, evidence: str, step: str) -> LogFormatError:
        """Return the error to raise for a row, counted from 0."""
        return LogFormatError(self.path, None, f"row {row + 1}: {evidence}", step)


@dataclass(frozen=True, kw_only=True)
class TableOfTable(LogTable):
    """A file seen through other names, or with rows or columns more or less.

    Attributes:
        inner: The file.
    """

    inner: LogTable

    rereads: ClassVar = False

    def columns(self, names: Sequence[str]) -> Array:
        return self.read(names)[0]

    def fault(self, row: int, evidence: str, step: str) -> LogFormatError:
        return self.inner.fault(row, evidence, step)


def log_of(table: LogTable, columns: ColumnMap) -> Log:
    """Return the log that a map of columns makes of a table, in SI units.

    Raises:
        LogFormatError: A column is missing, too few rows, a cell that is not finite, or time that does not run forward.
        BadOption: Units that do not fit each other.
    """
    chosen = columns.resolved(table.header, table.path, table.line)
    values, notes = table.read(names_of(chosen))
    checked = Checked(table, chosen, is_whole=True)
    log = checked.block(values)
    checked.end()
    spells = chosen.spells_left_out(table.path)
    log = replace(log, source=checked.source(notes), gaps=log.time[0] + spells if len(spells) else None)
    return log.on_one_clock(chosen.torque_clock)


def check_size(path: str | Path, most: int, step: str) -> None:
    """Refuse what is no ordinary file, and a file of more than ``most`` bytes.

    Raises:
        FileError: It is no ordinary file, or cannot be reached.
        LogFormatError: It is larger.
    """
    size = size_of_file(path)
    if size > most:
        evidence = f"{size / 2**30:.3g} GiB, more than the {most / 2**30:.3g} GiB that are read at once"
        raise LogFormatError(path, None, evidence, step)


def bytes_of(place: Path) -> int:
    """Return the size of a log, a file or the files of a folder; 0 where nothing is there."""
    files = place.iterdir() if place.is_dir() else (place,)
    return sum(file.stat().st_size for file in files if file.is_file())


def names_of(columns: ColumnMap) -> list[str]:
    """Return the columns that a resolved map reads, each once, the time first."""
    return list(dict.fromkeys([columns.time, *(name for signal in columns.stated().values() for name in signal)]))


def signals_of(columns: ColumnMap, values: Array) -> dict[str, Array]:
    """Return the signals in SI units, (N, n) each, of rows of the columns of :func:`names_of`, shape (N, k)."""
    names, found = names_of(columns), dict[str, Array]()
    for signal, own in columns.stated().items():
        first, count = names.index(own[0]), len(set(own))
        each = columns.to_si(signal, values[:, first : first + count])
        found[signal] = each if count == len(own) else np.repeat(each, len(own), axis=1)
    return found


class Checked:
    """Turns blocks of rows into logs in SI units, and refuses unsound rows by their number in the file.

    Attributes:
        rows: Rows seen so far.
    """

    def __init__(self, table: LogTable, columns: ColumnMap, is_whole: bool = False) -> None:
        if columns.torque_clock != 1.0 and not is_whole:
            step = "a log that is read row by row has torques of the clock of its positions: correct their times before"
            raise BadOption("torque_clock", columns.torque_clock, step)
        self.rows = 0
        self._table, self._columns, self._names = table, columns, names_of(columns)
        self._last: float | None = None
        self._counted: dict[str, Array] = {}

    def block(self, values: Array) -> Log:
        """Return the log of the next rows, shape (rows, columns of :func:`names_of`).

        Raises:
            LogFormatError: A cell that is not finite, or time that does not run forward.
        """
        time = self.time(values)
        chosen, signals = self._columns, signals_of(self._columns, values)
        if chosen.wrapped and len(values):
            signals = {name: chosen.counted(name, each, self._counted.get(name)) for name, each in signals.items()}
            self._counted = {name: each[-1] for name, each in signals.items()}
        return Log(chosen.joints, time, source=Source(self._table.path, self._table.sha256), **signals)

    def time(self, values: Array) -> Array:
        """Return the time of the next rows in s, shape (rows,), which may be all that is read; see :meth:`block`."""
        self._check_cells(values)
        time = self._columns.time_to_si(values[:, 0])
        self._check_time(time, values)
        self.rows += len(values)
        return time

    def end(self) -> None:
        """Refuse what has too few rows.

        Raises:
            LogFormatError: Fewer than ten.
        """
        if self.rows < MIN_SAMPLES:
            step = "an identification needs seconds of motion"
            raise LogFormatError(self._table.path, self._table.line, f"only {self.rows} rows", step)

    def source(self, notes: tuple[str, ...]) -> Source:
        """Return where the rows seen so far come from, and what was done to get them."""
        left_out = [f"{a:.4g} to {b:.4g} s left out" for a, b in self._columns.spells_left_out(self._table.path)]
        steps = filter(None, (f"read as {self._table.how}", *notes, self._columns.conversions(), *left_out))
        return Source(self._table.path, self._table.sha256, self.rows, tuple(steps))

    def _check_cells(self, values: Array) -> None:
        """Name the first cell that is not finite."""
        bad = ~np.isfinite(values)
        if np.any(bad):
            row = int(np.argmax(bad.any(axis=1)))
            column = int(np.argmax(bad[row]))
            many = f" ({bad.sum()} such cells in {bad.any(axis=1).sum()} rows)" if bad.sum() > 1 else ""
            cell = "no number (blank or nan)" if np.isnan(values[row, column]) else f"{values[row, column]:g}"
            evidence = f"column '{shown(self._names[column])}' holds {cell}{many}"
            raise self._table.fault(self.rows + row, evidence, _NOT_FINITE)

    def _check_time(self, time: Array, values: Array) -> None:
        """Refuse time that runs back or stands still, also from the block before to this one."""
        known = time if self._last is None else np.append(self._last, time)
        steps = np.diff(known)
        for wrong, what, step in (
            (steps < 0, "runs back", "split the log there, or sort its rows if they are only out of order"),
            (steps == 0, "repeats", _SAME_TIME),
        ):
            if np.any(wrong):
                row = int(np.argmax(wrong)) + 1
                count = int(wrong.sum())
                many = f" ({count} such rows)" if count > 1 else ""
                column = self._columns.time
                remedy = _REPEATED if step == _SAME_TIME and _is_repeated(values) else step
                evidence = f"time in column '{column}' {what}: {known[row - 1]:.15g} s, then {known[row]:.15g} s{many}"
                raise self._table.fault(self.rows + row - (len(known) - len(time)), evidence, remedy)
        if len(time):
            self._last = float(time[-1])


def _is_repeated(values: Array) -> bool:
    """Return whether all rows with the time of the row before, in the first column, have its values as well."""
    again = values[1:, 0] == values[:-1, 0]
    same = (values[1:] == values[:-1]).all(axis=1)
    return values.shape[1] > 1 and bool(again.any()) and bool(same[again].all())


class LogFormat(ABC):
    """A kind of file that holds a log; the fields of the part are its options."""

    suffixes: ClassVar[tuple[str, ...]]

    @classmethod
    def takes(cls, path: str | Path) -> bool:
        """Return whether a file is of this kind by its name."""
        return os.fspath(path).rstrip(os.sep).lower().endswith(cls.suffixes)

    @abstractmethod
    def open(self, path: str | Path) -> LogTable:
        """Return the columns of a file, its rows not read yet.

        Raises:
            FileError: The file cannot be read at all.
            LogFormatError: It is no sound file of this kind.
            MissingDependency: The package that reads it is not installed.
        """

    def write(self, log: Log, path: str | Path) -> None:
        """Write a log in SI units so that :func:`written_columns` reads it back bit for bit.

        Raises:
            FileError: The file cannot be written.
            LogFormatError: Files of this kind are only read.
            LogMismatch: The log holds a value that is not finite.
        """
        raise LogFormatError(path, None, "files of this kind are only read", "write .csv or .npz")


def written_table(log: Log) -> tuple[list[str], Array]:
    """Return names and values, shape (N, c), of the columns that a log is written as; see :func:`written_columns`.

    Raises:
        LogMismatch: The log holds a value that is not finite.
    """
    signals = log.signals()
    header = ["t", *(f"{NUMBERED[name]}{k + 1}" for name in signals for k in range(len(log.joints)))]
    values = np.column_stack([log.time, *signals.values()])
    bad = ~np.isfinite(values)
    if np.any(bad):
        row = int(np.argmax(bad.any(axis=1)))
        evidence = f"{header[int(np.argmax(bad[row]))]} of sample {row + 1} is not finite"
        raise LogMismatch(log.name, evidence, "leave such rows out before writing")
    return header, values


def written_columns(log: Log) -> ColumnMap:
    """Return the map under which a written log reads back: its joints, all its signals, SI units."""
    count = range(1, len(log.joints) + 1)
    names: dict[str, tuple[str, ...]] = {
        signal: tuple(f"{word}{k}" for k in count) if getattr(log, signal) is not None else ()
        for signal, word in NUMBERED.items()
    }
    return ColumnMap(joints=log.joints, **names)  # type: ignore[arg-type]
