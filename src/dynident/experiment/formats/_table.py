"""An opened file: named columns of numbers, whatever the format; and the log that a map of columns makes of it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dynident.arrays import Array
from dynident.errors import LogFormatError
from dynident.experiment.formats.base import ColumnMap, shown
from dynident.experiment.log import Log, Source

#: Fewer rows than this are no log.
MIN_SAMPLES = 10

#: Cells that are read at once at most: 2 GiB of numbers.
MAX_CELLS = 1 << 28


@dataclass(frozen=True, kw_only=True)
class Table(ABC):
    """A file whose bytes are sound and whose columns are known; its rows are read by :meth:`columns`.

    Attributes:
        path: The file as it was given.
        sha256: Hash of its bytes.
        header: Names of the columns, in order.
        how: In words how it is read, for the provenance.
        line: Line of the header where the file is text, counted from 1; else None.
    """

    path: str
    sha256: str
    header: tuple[str, ...]
    how: str
    line: int | None = None

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

    def fault(self, row: int, evidence: str, step: str) -> LogFormatError:
        """Return the error to raise for a row, counted from 0."""
        return LogFormatError(self.path, None, f"row {row + 1}: {evidence}", step)


def log_of(table: Table, columns: ColumnMap) -> Log:
    """Return the log that a map of columns makes of a table, in SI units.

    Raises:
        LogFormatError: A column is missing, too few rows, a cell that is not finite, or time that does not run forward.
        BadOption: Units that do not fit each other.
    """
    chosen = columns.resolved(table.header, table.path, table.line)
    stated = chosen.stated()
    names = [chosen.time, *(name for signal in stated.values() for name in signal)]
    values, notes = table.read(names)
    _check_cells(table, names, values)
    time = chosen.time_to_si(values[:, 0])
    _check_time(table, chosen.time, time)
    count = len(chosen.joints)
    blocks = {name: values[:, 1 + k * count : 1 + (k + 1) * count] for k, name in enumerate(stated)}
    signals = {name: chosen.to_si(name, block) for name, block in blocks.items()}
    steps = tuple(filter(None, (f"read as {table.how}", *notes, chosen.conversions())))
    return Log(chosen.joints, time, source=Source(table.path, table.sha256, len(values), steps), **signals)


def _check_cells(table: Table, names: Sequence[str], values: Array) -> None:
    """Refuse too few rows, and name the first cell that is not finite."""
    bad = ~np.isfinite(values)
    if np.any(bad):
        row = int(np.argmax(bad.any(axis=1)))
        column = int(np.argmax(bad[row]))
        many = f" ({bad.sum()} such cells in {bad.any(axis=1).sum()} rows)" if bad.sum() > 1 else ""
        evidence = f"column '{shown(names[column])}' holds {values[row, column]:g}{many}"
        raise table.fault(row, evidence, "mend the recording or leave these rows out")
    if len(values) < MIN_SAMPLES:
        step = "an identification needs seconds of motion"
        raise LogFormatError(table.path, table.line, f"only {len(values)} rows", step)


def _check_time(table: Table, column: str, time: Array) -> None:
    """Refuse time that runs back or stands still."""
    steps = np.diff(time)
    for wrong, what, step in (
        (steps < 0, "runs back", "split the log there, or sort its rows if they are only out of order"),
        (steps == 0, "repeats", "leave the repeated rows out, or write the time with more digits"),
    ):
        if np.any(wrong):
            row = int(np.argmax(wrong)) + 1
            count = int(wrong.sum())
            many = f" ({count} such rows)" if count > 1 else ""
            evidence = f"time in column '{column}' {what}: {time[row - 1]:.9g} s, then {time[row]:.9g} s{many}"
            raise table.fault(row, evidence, step)
