"""The part of a log that trains, block by block, where logs are split."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TypeAlias

import numpy as np

from dynident.arrays import Array, BoolArray
from dynident.data.formats import LogStream, stream_log
from dynident.data.formats._stream import ROWS, Reading
from dynident.data.log import Log, Source
from dynident.data.split import Split
from dynident.identification.streaming.stream_setup import StreamSetup

#: First row that trains, the row behind the last, and the time from which on none does.
_Limits: TypeAlias = tuple[int, int, float]


@dataclass(frozen=True)
class TrainingPart(LogStream):
    """A log without the rows that do not train, as :meth:`Split.apply` leaves them out.

    Attributes:
        split: How the log is split.
    """

    split: Split = field(kw_only=True)

    def times(self, rows: int = ROWS) -> Reading[Array, Source]:
        limits = self._limits  # before the rows are read once more
        return Reading(self._cut_times(super().times(rows), limits))

    def blocks(self, rows: int = ROWS) -> Reading[Log, Source]:
        limits = self._limits
        return Reading(self._cut_logs(super().blocks(rows), limits))

    def _cut_times(self, times: Reading[Array, Source], limits: _Limits) -> Generator[Array, None, Source]:
        start = 0
        for time in times:
            kept = _trains(start, time, limits)
            start += len(time)
            if kept.any():
                yield time[kept]
        return self._source(times.result)

    def _cut_logs(self, blocks: Reading[Log, Source], limits: _Limits) -> Generator[Log, None, Source]:
        start = 0
        for log in blocks:
            kept = _trains(start, log.time, limits)
            start += log.samples
            if kept.any():
                yield replace(log, **{name: getattr(log, name)[kept] for name in ("time", *log.signals())})
        return self._source(blocks.result)

    @cached_property
    def _limits(self) -> _Limits:
        """Which rows train, by a pass over the time.

        Raises:
            LogMismatch: The log has fewer rows than the split names.
        """
        count, first, last = 0, 0.0, 0.0
        for time in super().times():
            first = float(time[0]) if not count else first
            count, last = count + len(time), float(time[-1])
        if self.split.first is not None:
            return 0, count, first + self.split.first * (last - first)
        self.split.check(count, self.table.path)
        return (*self.split.train, np.inf)

    def _source(self, source: Source) -> Source:
        if self.split.first is not None:
            step = f"first {self.split.first:g} of the duration"
        else:
            step = "samples {} to {} of {}".format(*self.split.train, source.rows)
        return replace(source, steps=(*source.steps, step), split=str(self.split))


def _trains(start: int, time: Array, limits: _Limits) -> BoolArray:
    """Return which of successive rows train."""
    low, high, before = limits
    places = np.arange(start, start + len(time))
    return (places >= low) & (places < high) & (time < before)


def training_part(setup: StreamSetup, path: Path, folder: Path | None = None) -> LogStream:
    """Return the training samples of a log, read block by block; arguments and errors as of :func:`stream_log`."""
    stream = stream_log(path, setup.columns, folder=folder)
    if setup.split is None:
        return stream
    return TrainingPart(stream.table, stream.columns, stream.folder, split=setup.split)
