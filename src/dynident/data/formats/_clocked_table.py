"""Columns that are made of others: a time of a stated rate, or of seconds and nanoseconds, and sums of torques."""

from __future__ import annotations

import re
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, final

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


#: A column in a sum of columns, with its factor, such as ``0.5 * tau2``.
TERM = re.compile(r"(?:(\d+\.?\d*(?:e-?\d+)?) \* )?(.+)")


@dataclass(frozen=True, kw_only=True)
class MadeTable(TableOfTable):
    """A table with columns more, which are made of others.

    Attributes:
        made: Names of the added columns, as the map of columns states them.
    """

    made: tuple[str, ...]

    @abstractmethod
    def sources(self, name: str) -> tuple[str, ...]:
        """Return the columns of the file that an added one is made of."""

    @abstractmethod
    def values(self, name: str, rows: int, start: int, columns: Mapping[str, Array]) -> Array:
        """Return an added column, shape (rows,); ``columns`` are those of the file that were read for its rows."""

    def read(self, names: Sequence[str]) -> tuple[Array, tuple[str, ...]]:
        inside = self._inside(names)
        values, notes = self.inner.read(inside)
        return self._with_made(values, inside, names, 0), notes

    def batches(self, names: Sequence[str], rows: int) -> Blocks:
        inside, start = self._inside(names), 0
        blocks = self.inner.batches(inside, rows)
        while True:
            try:
                values = next(blocks)
            except StopIteration as end:
                return end.value
            yield self._with_made(values, inside, names, start)
            start += len(values)

    def _inside(self, names: Sequence[str]) -> list[str]:
        """Return the columns to read of the file: one at least, as it says how many rows there are."""
        needed = [self.sources(name) if name in self.made else (name,) for name in names]
        return list(dict.fromkeys(name for own in needed for name in own)) or [self.inner.header[0]]

    def _with_made(self, values: Array, inside: Sequence[str], names: Sequence[str], start: int) -> Array:
        found = dict(zip(inside, values.T, strict=True))
        own = {name: self.values(name, len(values), start, found) for name in self.made if name in names}
        return np.column_stack([(found | own)[name] for name in names])


@final
@dataclass(frozen=True, kw_only=True)
class ClockedTable(MadeTable):
    """A table whose rows follow each other at a stated rate.

    Attributes:
        rate: Samples a second.
    """

    rate: float

    def sources(self, name: str) -> tuple[str, ...]:
        """Return no column of the file; see :meth:`MadeTable.sources`."""
        return ()

    def values(self, name: str, rows: int, start: int, columns: Mapping[str, Array]) -> Array:
        """Return the number of the row over the rate; see :meth:`MadeTable.values`."""
        return (start + np.arange(rows)) / self.rate


@final
@dataclass(frozen=True, kw_only=True)
class SummedTable(MadeTable):
    """A table with sums of columns, such as the time in seconds and nanoseconds.

    Attributes:
        parts: Columns of the file with their factors, by the added column.
    """

    parts: Mapping[str, tuple[tuple[str, float], ...]]

    def sources(self, name: str) -> tuple[str, ...]:
        """Return the columns of a sum; see :meth:`MadeTable.sources`."""
        return tuple(column for column, _ in self.parts[name])

    def values(self, name: str, rows: int, start: int, columns: Mapping[str, Array]) -> Array:
        """Return a sum; see :meth:`MadeTable.values`."""
        return np.sum([factor * columns[column] for column, factor in self.parts[name]], axis=0)


def _seconds(unit: str) -> float:
    (numerator, denominator), _ = UNITS["time"][unit]
    return numerator / denominator


def with_made(table: LogTable, columns: ColumnMap) -> LogTable:
    """Return a table with the columns that a map of columns makes of others: a stated rate, sums.

    Raises:
        BadOption: A rate that is not above 0, or a unit of the time beside it.
        LogFormatError: A column of the sum that is the time is missing.
    """
    table = clocked(table, columns)
    signals = (columns.q, columns.dq, columns.q_ref, columns.dq_ref, columns.torque, columns.current)
    named = (name for signal in signals for name in signal or ())
    sums = {name: sum_of(name, table.header) for name in named if name not in table.header}
    sums = {name: parts for name, parts in sums.items() if parts}
    if not sums:
        return table
    return SummedTable(**_beside(table, tuple(sums), f"{table.how}, with {', '.join(sums)}"), parts=sums)


def sum_of(name: str, header: Sequence[str]) -> tuple[tuple[str, float], ...]:
    """Return the columns of a header, with their factors, that ``a + 0.5 * b - c`` is the sum of; none for no sum."""
    first, *rest = re.split(r" ([+-]) ", name)
    terms = [TERM.fullmatch(text) for text in (first, *rest[1::2])]
    found = tuple(
        (term[2], float(f"{sign}{term[1] or 1}"))
        for sign, term in zip(("+", *rest[::2]), terms, strict=True)
        if term is not None and term[2] in header
    )
    return found if len(found) == len(terms) > 1 else ()


def clocked(table: LogTable, columns: ColumnMap) -> LogTable:
    """Return a table with a column of the time, where the map of columns states a rate or a sum in its place.

    Raises:
        BadOption: A rate that is not above 0, or a unit of the time beside it.
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


def with_clock(table: LogTable, clock: str, rate: float) -> LogTable:
    """Return a table with a column of the time called ``clock``, at ``rate`` samples a second."""
    how = f"{table.how}, {clock} for want of a column of the time"
    return ClockedTable(**_beside(table, (clock,), how), rate=rate)


def with_sum(table: LogTable, clock: str, parts: tuple[tuple[str, str], tuple[str, str]]) -> LogTable:
    """Return a table with a column of the time called ``clock``, the sum of two columns in units of their own."""
    own = {clock: tuple((name, _seconds(unit)) for name, unit in parts)}
    return SummedTable(**_beside(table, (clock,), f"{table.how}, time as {clock}"), parts=own)


def _beside(table: LogTable, made: tuple[str, ...], how: str) -> dict[str, Any]:
    """Return what a table has with columns before its own."""
    there = {"path": table.path, "sha256": table.sha256, "line": table.line, "inner": table, "made": made, "how": how}
    return {**there, "header": (*made, *table.header)}
