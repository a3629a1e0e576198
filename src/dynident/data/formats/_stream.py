"""A log file that is read block by block, as often as it is asked for."""

from __future__ import annotations

import tempfile
from collections.abc import Generator, Iterator
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Generic, TypeVar

import numpy as np

from dynident.arrays import Array
from dynident.data.formats._column_map import ColumnMap
from dynident.data.formats.base import Blocks, Checked, LogTable, names_of
from dynident.data.log import Log, Source
from dynident.files import written_for_a_while

Item = TypeVar("Item")
Result = TypeVar("Result")

#: Rows of a block.
ROWS = 1 << 14


class Reading(Generic[Item, Result]):
    """The items of a generator; ``result`` is there when they have ended: what it returned."""

    result: Result

    def __init__(self, items: Generator[Item, None, Result]) -> None:
        self._items = items

    def __iter__(self) -> Iterator[Item]:
        self.result = yield from self._items


@dataclass(frozen=True)
class LogStream:
    """A log in a file, which may be larger than memory.

    A format that is slow to decode, text or messages, is decoded once: its rows are kept in a temporary file of plain
    numbers, which the system removes when the process ends in whatever way.

    Attributes:
        table: The opened file.
        columns: Which columns are which signals, every one in the header.
        folder: Where the temporary file is; None for the system's folder for such files.
        kept: The temporary file of a format that is decoded once.
    """

    table: LogTable
    columns: ColumnMap
    folder: Path | None = None
    kept: list[_Kept] = field(default_factory=list, init=False, repr=False, compare=False)

    def times(self, rows: int = ROWS) -> Reading[Array, Source]:
        """Return the time in s in blocks, shape (<= rows,), and where the log comes from.

        Raises:
            LogFormatError: An unsound row, or fewer than ten.
        """
        if self.kept or not self.table.rereads:
            return Reading(_times_of(self._logs(rows) if self.kept else self._logs_once(rows)))
        return Reading(self._only_times(rows))

    def blocks(self, rows: int = ROWS) -> Reading[Log, Source]:
        """Return logs of successive rows, and where they come from; errors as of :meth:`times`."""
        return Reading(self._logs(rows))

    def close(self) -> None:
        """Remove the temporary file."""
        while self.kept:
            self.kept.pop().file.close()

    def _only_times(self, rows: int) -> Generator[Array, None, Source]:
        checked = Checked(self.table, self.columns)
        batches = Reading(self.table.batches([self.columns.time], rows))
        for values in batches:
            yield checked.time(values)
        checked.end()
        return checked.source(batches.result)

    def _logs(self, rows: int) -> Generator[Log, None, Source]:
        checked = Checked(self.table, self.columns)
        kept = self.kept[0].blocks(rows) if self.kept else self.table.batches(names_of(self.columns), rows)
        batches = Reading(kept)
        for values in batches:
            yield checked.block(values)
        checked.end()
        return checked.source(batches.result)

    def _logs_once(self, rows: int) -> Generator[Log, None, Source]:
        """Yield the rows while they are kept on disk."""
        checked, names = Checked(self.table, self.columns), names_of(self.columns)
        with ExitStack() as stack:
            file = stack.enter_context(tempfile.TemporaryFile(dir=self.folder))
            batches = Reading(self.table.batches(names, rows))
            for values in batches:
                with written_for_a_while(self.folder):
                    file.write(np.ascontiguousarray(values, dtype=np.float64).tobytes())
                yield checked.block(values)
            checked.end()
            with written_for_a_while(self.folder):
                file.flush()
            self.kept.append(_Kept(file, len(names), batches.result))
            stack.pop_all()  # it stays open until the stream is closed
            return checked.source(batches.result)


def _times_of(logs: Generator[Log, None, Source]) -> Generator[Array, None, Source]:
    reading = Reading(logs)
    for log in reading:
        yield log.time
    return reading.result


@dataclass(frozen=True)
class _Kept:
    """Rows on disk as plain numbers."""

    file: IO[bytes]
    width: int
    notes: tuple[str, ...]

    def blocks(self, rows: int) -> Blocks:
        self.file.seek(0)
        while data := self.file.read(8 * self.width * rows):
            yield np.frombuffer(data, dtype=np.float64).reshape(-1, self.width)
        return self.notes
