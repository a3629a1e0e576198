"""A log whose time is no column of its own: made of a stated rate, or of two columns, seconds and nanoseconds."""

from __future__ import annotations

import re
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from dynident.arrays import Array
from dynident.data.formats._column_map import ColumnMap, missing_column
from dynident.data.formats._units import UNITS
from dynident.data.formats.base import Blocks, LogTable, TableOfTable
from dynident.errors import BadOption

#: What stands for the column of the time where a file has none.
RATE = re.compile(r"([0-9]*\.?[0-9]+) ?Hz")

#: What stands for it where the time is in two columns, such as ``sec s + nanosec ns``.
SUM = re.compile(r"(.+) (s|ms|us|ns) \+ (.+) (s|ms|us|ns)")


@dataclass(frozen=True, kw_only=True)
class TimedTable(TableOfTable):
    """A table with one column more: the time, in s.

    Attributes:
        clock: Name of the added column, as the map of columns states it.
    """

    clock: str

    @property
    @abstractmethod
    def sources(self) -> tuple[str, ...]:
        """Columns of the file that the time is made of."""

    @abstractmethod
    def time(self, rows: int, start: int, columns: Mapping[str, Array]) -> Array:
        """Return the time of rows in s, shape (rows,); ``columns`` are those of the file that were read for them."""

    def read(self, names: Sequence[str]) -> tuple[Array, tuple[str, ...]]:
        """Return some columns and what was done; see :meth:`LogTable.read`."""
        inside = self._inside(names)
        values, notes = self.inner.read(inside)
        return self._timed(values, inside, names, 0), notes

    def batches(self, names: Sequence[str], rows: int) -> Blocks:
        """Yield some columns in blocks; see :meth:`LogTable.batches`."""
        inside, start = self._inside(names), 0
        blocks = self.inner.batches(inside, rows)
        while True:
            try:
                values = next(blocks)
            except StopIteration as end:
                return end.value
            yield self._timed(values, inside, names, start)
            start += len(values)

    def _inside(self, names: Sequence[str]) -> list[str]:
        """Return the columns to read of the file: one at least, as it says how many rows there are."""
        needed = self.sources if self.clock in names else ()
        wanted = dict.fromkeys([*needed, *(name for name in names if name != self.clock)])
        return list(wanted) or [self.inner.header[0]]

    def _timed(self, values: Array, inside: Sequence[str], names: Sequence[str], start: int) -> Array:
        found = dict(zip(inside, values.T, strict=True))
        if self.clock in names:
            found[self.clock] = self.time(len(values), start, found)
        return np.column_stack([found[name] for name in names])


@dataclass(frozen=True, kw_only=True)
class ClockedTable(TimedTable):
    """A table whose rows follow each other at a stated rate.

    Attributes:
        rate: Samples a second.
    """

    rate: float

    @property
    def sources(self) -> tuple[str, ...]:
        """No column of the file."""
        return ()

    def time(self, rows: int, start: int, columns: Mapping[str, Array]) -> Array:
        """Return the number of the row over the rate; see :meth:`TimedTable.time`."""
        return (start + np.arange(rows)) / self.rate


@dataclass(frozen=True, kw_only=True)
class SummedTimeTable(TimedTable):
    """A table whose time is the sum of two columns.

    Attributes:
        parts: The two columns with the unit of each.
    """

    parts: tuple[tuple[str, str], tuple[str, str]]

    @property
    def sources(self) -> tuple[str, ...]:
        """The two columns."""
        return tuple(name for name, _ in self.parts)

    def time(self, rows: int, start: int, columns: Mapping[str, Array]) -> Array:
        """Return the sum in s; see :meth:`TimedTable.time`."""
        (whole, first), (part, second) = self.parts
        return columns[whole] * _seconds(first) + columns[part] * _seconds(second)


def _seconds(unit: str) -> float:
    (numerator, denominator), _ = UNITS["time"][unit]
    return numerator / denominator


def clocked(table: LogTable, columns: ColumnMap) -> LogTable:
    """Return a table with a column of the time, where the map of columns states a rate or a sum in its place.

    Raises:
        BadOption: A rate that is none, or a unit of the time beside it.
        LogFormatError: A column of the sum is missing.
    """
    if columns.time in table.time_stamps and columns.units.time != "s":
        raise BadOption("units.time", columns.units.time, f"leave it out: {columns.time} holds time stamps")
    if columns.time in table.header:
        return table
    stated, summed = RATE.fullmatch(columns.time), SUM.fullmatch(columns.time)
    if stated is None and summed is None:
        return table
    if columns.units.time != "s":
        made = "the rate" if summed is None else "the sum"
        raise BadOption("units.time", columns.units.time, f"leave it out: the time is made of {made} {columns.time}")
    if summed is not None:
        parts = ((summed[1], summed[2]), (summed[3], summed[4]))
        for name, _ in parts:
            if name not in table.header:
                raise missing_column(name, table.header, table.path, table.line)
        return with_sum(table, columns.time, parts)
    assert stated is not None
    rate = float(stated[1])
    if not rate > 0:
        raise BadOption("time", columns.time, "state the samples a second, such as 200 Hz")
    return with_clock(table, columns.time, rate)


def with_clock(table: LogTable, clock: str, rate: float) -> ClockedTable:
    """Return a table with a column of the time called ``clock``, at ``rate`` samples a second."""
    how = f"{table.how}, {clock} for want of a column of the time"
    return ClockedTable(**_beside(table, clock, how), rate=rate)


def with_sum(table: LogTable, clock: str, parts: tuple[tuple[str, str], tuple[str, str]]) -> SummedTimeTable:
    """Return a table with a column of the time called ``clock``, the sum of two columns in units of their own."""
    return SummedTimeTable(**_beside(table, clock, f"{table.how}, time as {clock}"), parts=parts)


def _beside(table: LogTable, clock: str, how: str) -> dict[str, Any]:
    """Return what a table has with a column of the time before its own."""
    there = {"path": table.path, "sha256": table.sha256, "line": table.line, "inner": table, "clock": clock, "how": how}
    return {**there, "header": (clock, *table.header)}
