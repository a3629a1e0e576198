"""A log without the rows that repeat the one before, as recorders that poll faster than the robot write them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from dynident.arrays import Array, BoolArray
from dynident.data.formats._column_map import ColumnMap
from dynident.data.formats.base import Blocks, LogTable, TableOfTable
from dynident.errors import LogFormatError


@dataclass(frozen=True, kw_only=True)
class UnrepeatedTable(TableOfTable):
    """A table without the rows whose time and values are those of the row before.

    Attributes:
        clock: Its column of the time, which is compared along with whatever is read.
    """

    clock: str
    _left_out: list[int] = field(default_factory=list, init=False, repr=False, compare=False)

    def read(self, names: Sequence[str]) -> tuple[Array, tuple[str, ...]]:
        inside = self._inside(names)
        values, notes = self.inner.read(inside)
        same = _repeats(values)
        self._left_out[:] = np.flatnonzero(same).tolist()
        return values[~same][:, : len(names)], (*notes, *self._note())

    def batches(self, names: Sequence[str], rows: int) -> Blocks:
        blocks, start, before = self.inner.batches(self._inside(names), rows), 0, None
        self._left_out.clear()
        while True:
            try:
                values = next(blocks)
            except StopIteration as end:
                return (*end.value, *self._note())
            same = _repeats(values, before)
            self._left_out.extend((start + np.flatnonzero(same)).tolist())
            start, before = start + len(values), values[-1] if len(values) else before
            if not same.all():
                yield values[~same][:, : len(names)]

    def fault(self, row: int, evidence: str, step: str) -> LogFormatError:
        """Return the error to raise for a row of those that are left; see :meth:`LogTable.fault`."""
        kept_before = np.asarray(self._left_out) - np.arange(len(self._left_out))
        return self.inner.fault(row + int(np.searchsorted(kept_before, row, side="right")), evidence, step)

    def _inside(self, names: Sequence[str]) -> list[str]:
        return [*names, *([] if self.clock in names else [self.clock])]

    def _note(self) -> tuple[str, ...]:
        count = len(self._left_out)
        return (f"{count} rows left out that repeat the one before",) if count else ()


def _repeats(values: Array, before: Array | None = None) -> BoolArray:
    """Return which rows are those before them, shape (N,); ``before`` is the row before the first."""
    same = np.zeros(len(values), bool)
    if len(values):
        same[1:] = (values[1:] == values[:-1]).all(axis=1)
        same[0] = before is not None and bool(np.array_equal(values[0], before))
    return same


def unrepeated(table: LogTable, columns: ColumnMap) -> LogTable:
    """Return a table without repeated rows, where the map of columns says so."""
    if columns.repeats != "drop":
        return table
    return UnrepeatedTable(
        path=table.path,
        sha256=table.sha256,
        header=table.header,
        how=table.how,
        line=table.line,
        inner=table,
        clock=columns.time,
    )
