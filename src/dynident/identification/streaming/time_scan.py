"""What must be known of the time of a whole log before its first window is filtered: rate, gaps, length."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from dynident.arrays import Array
from dynident.data.formats import LogStream
from dynident.data.log import Source
from dynident.data.preprocessing import LONGEST_GAP, UNIFORM, gap_remedy, longest_step
from dynident.data.preprocessing.base import Filter
from dynident.errors import LogMismatch

#: Distinct steps that are kept at most while the median is looked for.
_DISTINCT = 1 << 18

#: Gaps that are kept at most.
_MOST_GAPS = 1 << 18

#: Samples of a grid that are made at a time.
_GRID = 1 << 16


class StreamedMedian:
    """The median of a stream of numbers, exact, in constant memory.

    Values far from the middle are only counted. It is exact as long as the middle of what has come stays among the
    middle half of what is kept, which the steps of a clock do.
    """

    def __init__(self) -> None:
        self._values, self._counts = np.empty(0), np.empty(0, dtype=np.int64)
        self._waiting: list[Array] = []
        self._size = 0
        self._below = self._above = 0

    def add(self, values: Array) -> None:
        """Take values, shape (m,)."""
        self._waiting.append(np.array(values))
        self._size += len(values)
        if self._size >= _DISTINCT:
            self._settle()

    def value(self) -> float:
        """Return the median of all values; NaN where it is no longer known, or there are none."""
        self._settle()
        total = self._below + int(self._counts.sum()) + self._above
        ends = self._below + np.cumsum(self._counts)
        middle = [(total - 1) // 2, total // 2]
        if not total or middle[0] < self._below or middle[1] >= total - self._above:
            return float("nan")
        low, high = self._values[np.searchsorted(ends, middle, side="right")]
        return float(0.5 * (low + high))  # as numpy.median takes it

    def _settle(self) -> None:
        if not self._waiting:
            return
        fresh = np.concatenate(self._waiting)
        self._waiting, self._size = [], 0
        if self._below or self._above:
            inside = (fresh >= self._values[0]) & (fresh <= self._values[-1])
            self._below += int(np.sum(fresh < self._values[0]))
            self._above += int(np.sum(fresh > self._values[-1]))
            fresh = fresh[inside]
        found, counts = np.unique(fresh, return_counts=True)
        self._values, places = np.unique(np.concatenate([self._values, found]), return_inverse=True)
        self._counts = np.bincount(
            places, weights=np.concatenate([self._counts, counts]), minlength=len(self._values)
        ).astype(np.int64)
        if len(self._values) > _DISTINCT:
            ends = np.cumsum(self._counts)
            first, last = np.searchsorted(ends, [ends[-1] // 4, ends[-1] - ends[-1] // 4])
            self._below += int(self._counts[:first].sum())
            self._above += int(self._counts[last + 1 :].sum())
            self._values, self._counts = self._values[first : last + 1], self._counts[first : last + 1]


@dataclass(frozen=True)
class TimeScan:
    """The time of a whole log.

    Attributes:
        samples: Samples of the log.
        first: Time of the first, in s.
        last: Time of the last, in s.
        step: Median step, in s.
        shortest: Shortest step, in s.
        longest: Longest step, in s.
        after: Row after which it is, counted from 1.
        gaps: Start and end of steps that may be gaps, in s, shape (g, 2).
        source: Where the log comes from.
    """

    samples: int
    first: float
    last: float
    step: float
    shortest: float
    longest: float
    after: int
    gaps: Array
    source: Source

    @property
    def is_even(self) -> bool:
        """Whether the rows stand on a uniform grid as they are."""
        return max(self.longest - self.step, self.step - self.shortest) <= UNIFORM * self.step

    @property
    def count(self) -> int:
        """Samples of the uniform grid."""
        return self.samples if self.is_even else round((self.last - self.first) / self.step) + 1

    def grid(self, start: int, stop: int) -> Array:
        """Return times of the uniform grid of a log that has none, as :func:`resample` makes it, shape (m,)."""
        share = np.arange(start, stop, dtype=np.float64) * (1.0 / (self.count - 1))
        if stop == self.count:
            share[-1] = 1.0
        return self.first + (self.last - self.first) * share

    def rate(self) -> float:
        """Return the samples a second of the uniform grid, in Hz."""
        if self.is_even:
            return 1.0 / self.step
        median, before = StreamedMedian(), self.first
        for start in range(1, self.count, _GRID):
            time = self.grid(start, min(start + _GRID, self.count))
            median.add(np.diff(time, prepend=before))
            before = float(time[-1])
        return 1.0 / median.value()

    def gaps_for(self, filter: Filter) -> tuple[Array, float]:
        """Return the gaps over which a straight line shows, shape (g, 2), and how far the filter carries them, in s."""
        period = _period(filter)
        steps = self.gaps[:, 1] - self.gaps[:, 0]
        return self.gaps[steps > max(5 * self.step, 0.2 * period)], period


def _period(filter: Filter) -> float:
    return 0.0 if filter.bandwidth() is None else 1.0 / float(filter.bandwidth() or 1.0)


def scan_time(stream: LogStream, filter: Filter, longest_gap: float = LONGEST_GAP) -> TimeScan:
    """Return the facts of the time of a log; a gap longer than ``longest_gap`` s is refused.

    Raises:
        LogFormatError: An unsound row.
        LogMismatch: A long gap, rows in bursts, or a rate that changes on the way.
    """
    reading = stream.times()
    found = _facts(reading, 0.2 * _period(filter))
    scan = TimeScan(*found, source=reading.result)
    _check(scan, stream.table.path, longest_gap)
    return scan


def _facts(blocks: Iterable[Array], shortest_gap: float) -> tuple[int, float, float, float, float, float, int, Array]:
    median, gaps, held = StreamedMedian(), list[Array](), 0
    samples, first, last, usual = 0, np.nan, np.nan, np.nan
    low, high, after = np.inf, 0.0, 0
    for time, steps in _steps(blocks):
        samples += len(time)
        first = float(time[0]) if np.isnan(first) else first
        last = float(time[-1])
        if not len(steps):
            continue
        median.add(steps)
        usual = float(np.median(steps)) if np.isnan(usual) else usual
        low = min(low, float(steps.min()))
        if steps.max() > high:
            high, after = float(steps.max()), samples - len(steps) + int(np.argmax(steps))
        wide = np.flatnonzero(steps > max(shortest_gap, 2.5 * usual))
        held += len(wide)
        if len(wide) and held <= _MOST_GAPS:
            ends = time[len(time) - len(steps) :][wide]
            gaps.append(np.stack([ends - steps[wide], ends], axis=1))
    known = np.concatenate(gaps) if gaps and held <= _MOST_GAPS else np.empty((0, 2))
    return samples, first, last, median.value(), low, high, after, known


def _steps(blocks: Iterable[Array]) -> Iterator[tuple[Array, Array]]:
    """Yield times and the steps to each of them; the first time of all has none."""
    before: float | None = None
    for time in blocks:
        if len(time):
            yield time, np.diff(time) if before is None else np.diff(time, prepend=before)
            before = float(time[-1])


def _check(scan: TimeScan, path: str, longest_gap: float) -> None:
    """Refuse what no uniform grid can be laid over, as :func:`resample` does."""
    if not np.isfinite(scan.step):
        evidence = "its rate changes on the way, or it has many gaps"
        raise LogMismatch(path, evidence, "split it where the rate changes")
    if scan.longest > longest_step(scan.step, longest_gap):
        place = f"sample {scan.after}"
        if len(scan.gaps):
            at = scan.gaps[np.argmax(np.diff(scan.gaps)), 0]
            place += f", {at - scan.first:.4g} s from its start"
        raise LogMismatch(path, f"a gap of {scan.longest:.4g} s after {place}", gap_remedy(scan.longest))
    if scan.count > 10 * scan.samples:
        evidence = (
            f"a median step of {scan.step:.3g} s where {scan.samples} samples last {scan.last - scan.first:.4g} s"
        )
        raise LogMismatch(path, evidence, "log the time of the measurement: samples came in bursts")
