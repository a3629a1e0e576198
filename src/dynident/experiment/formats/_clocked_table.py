"""A log without a column of the time, whose rows follow each other at a stated rate."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from dynident.arrays import Array
from dynident.errors import BadOption, LogFormatError
from dynident.experiment.formats._table import Blocks, Table
from dynident.experiment.formats.base import ColumnMap

#: What stands for the column of the time where a file has none.
RATE = re.compile(r"([0-9]*\.?[0-9]+) ?Hz")


@dataclass(frozen=True, kw_only=True)
class ClockedTable(Table):
    """A table with one column more: the number of the row over the rate, in s.

    Attributes:
        inner: The file.
        clock: Name of the added column, such as ``200 Hz``.
        rate: Rows a second.
    """

    inner: Table
    clock: str
    rate: float

    rereads: ClassVar = False

    def columns(self, names: Sequence[str]) -> Array:
        """Return some columns; see :meth:`Table.columns`."""
        return self._timed(self.inner.columns(self._inside(names)), names, 0)

    def read(self, names: Sequence[str]) -> tuple[Array, tuple[str, ...]]:
        """Return some columns and what was done; see :meth:`Table.read`."""
        values, notes = self.inner.read(self._inside(names))
        return self._timed(values, names, 0), notes

    def batches(self, names: Sequence[str], rows: int) -> Blocks:
        """Yield some columns in blocks; see :meth:`Table.batches`."""
        blocks, start = self.inner.batches(self._inside(names), rows), 0
        while True:
            try:
                values = next(blocks)
            except StopIteration as end:
                return end.value
            yield self._timed(values, names, start)
            start += len(values)

    def fault(self, row: int, evidence: str, step: str) -> LogFormatError:
        """Return the error to raise for a row; see :meth:`Table.fault`."""
        return self.inner.fault(row, evidence, step)

    def _inside(self, names: Sequence[str]) -> list[str]:
        """Return the columns to read of the file: one at least, as it says how many rows there are."""
        return [name for name in names if name != self.clock] or [self.inner.header[0]]

    def _timed(self, values: Array, names: Sequence[str], start: int) -> Array:
        time = (start + np.arange(len(values))) / self.rate
        inside = iter(values.T)
        return np.column_stack([time if name == self.clock else next(inside) for name in names])


def clocked(table: Table, columns: ColumnMap) -> Table:
    """Return a table with a column of the time, where the map of columns states a rate in its place.

    Raises:
        BadOption: A rate that is none, or a unit of the time beside it.
    """
    stated = RATE.fullmatch(columns.time)
    if stated is None or columns.time in table.header:
        return table
    rate = float(stated[1])
    if not rate > 0:
        raise BadOption("time", columns.time, "state the rows a second, such as 200 Hz")
    if columns.units.time != "s":
        raise BadOption("units.time", columns.units.time, f"leave it out: the time is made of the rate {columns.time}")
    return with_clock(table, columns.time, rate)


def with_clock(table: Table, clock: str, rate: float) -> ClockedTable:
    """Return a table with a column of the time called ``clock``, at ``rate`` rows a second."""
    return ClockedTable(
        path=table.path,
        sha256=table.sha256,
        header=(clock, *table.header),
        how=f"{table.how}, {clock} for want of a column of the time",
        line=table.line,
        inner=table,
        clock=clock,
        rate=rate,
    )
