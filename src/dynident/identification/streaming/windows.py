"""A log in windows: each is filtered with so much of its neighbours that its rows are those of the whole log.

A window's log runs beyond its rows on both sides, so all that looks to either side (the filter of the regressor, runs
of standstill) finds there what it needs. Its time starts at 0.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from dynident.arrays import Array, BoolArray, IntArray
from dynident.data.formats import LogStream
from dynident.data.log import Log, Source
from dynident.data.preprocessing import SHORTEST_REST, Prepared, Preprocessing, check_finite, check_turns
from dynident.data.preprocessing._held_rows import first_of_each_reading
from dynident.data.preprocessing._local_polynomials import POINTS, shifted
from dynident.errors import LogMismatch
from dynident.identification.streaming.time_scan import TimeScan

#: Samples of a window without its margins, at least.
TILE = 1 << 16


@dataclass(frozen=True)
class Window:
    """Some samples of a log, filtered.

    Attributes:
        prepared: The log with margins, and its rows that are used.
        inner: The samples of the log that are the window's own.
        time: Time of the rows that are used, in s of the file, shape (N,).
        start: First of its own samples, counted through the whole log.
        stop: Behind the last of them.
    """

    prepared: Prepared
    inner: slice
    time: Array
    start: int
    stop: int


@dataclass(frozen=True)
class Piece:
    """Some samples of a log as they were read, with their neighbours.

    Attributes:
        log: The samples, on the uniform grid.
        start: Number of the first of them in the whole log.
        own: Those that the window is for.
        used: Which of these are used, counted from the first of them.
    """

    log: Log
    start: int
    own: slice
    used: IntArray


@dataclass(frozen=True)
class Windows:
    """How a log is cut.

    Attributes:
        scan: The time of the whole log.
        how: The preprocessing.
        rate: Samples a second of the uniform grid, in Hz.
        span: Samples to either side that the filter of the signals takes.
        margin: Samples to either side that a window keeps when it is filtered.
        every: One row in how many is used.
    """

    scan: TimeScan
    how: Preprocessing
    rate: float
    span: int
    margin: int
    every: int

    @classmethod
    def of(cls, scan: TimeScan, how: Preprocessing, path: str) -> Windows:
        """Return the windows for a log.

        Raises:
            LogMismatch: The filter needs the whole log at once, or the delay of the torque is not stated.
        """
        rate = scan.rate()
        span = how.filter.span(rate)
        if span is None:
            kind = how.statement()["kind"]
            evidence = f"the filter '{kind}' needs the whole log at once, so it cannot be run on a stream"
            raise LogMismatch(path, evidence, "choose butterworth, five_point or as_given")
        if how.delay_s is None:
            step = "estimate it on a part of the log with --delay auto, and state the value: --delay 0.004"
            raise LogMismatch(path, "the time delay between torque and position is not estimated on a stream", step)
        margin = max(how.filter.reach(rate), int(np.ceil(SHORTEST_REST * rate)) + 2)
        span += 0 if how.delay_s == 0 else int(np.ceil(abs(how.delay_s) * rate)) + POINTS
        rows = how.rows_hz(rate)
        every = 1 if rows is None else max(1, int(np.ceil(rate / rows - 0.51)))
        return cls(scan, how, rate, span, margin, every)

    @property
    def tile(self) -> int:
        """Samples of a window without its margins."""
        return max(TILE, 4 * (self.span + self.margin))

    @property
    def count(self) -> int:
        """Number of windows."""
        return -(-self.scan.count // self.tile)

    def pieces(self, stream: LogStream, meaning: Callable[[Log], Log], first: int = 0) -> Iterator[Piece]:
        """Yield what the windows of a log from number ``first`` on are made of.

        Args:
            stream: The log.
            meaning: What the case makes of rows as they are read.
            first: Number of windows that are left out.

        Raises:
            LogMismatch: A value that is no number.
        """
        tape = _Tape(_on_grid(stream, self.scan, meaning))
        total, overlap, used = self.scan.count, self.span + self.margin, _Used(self)
        for number in range(self.count):
            start, stop = number * self.tile, min((number + 1) * self.tile, total)
            low, high = max(0, start - overlap), min(total, stop + overlap)
            tape.read_to(high)
            log = tape.log(low, high)
            own = slice(start - low, stop - low)
            rows = used.rows(log.time[own], start)
            if number >= first:
                yield Piece(log, low, own, rows)

    def window(self, piece: Piece) -> Window:
        """Return the window of a piece: its samples filtered.

        Raises:
            LogMismatch: Too few samples for the filter.
        """
        log, low, own = piece.log, piece.start, piece.own
        # Counted from 0, steps of the time are as exact as the rate needs.
        local = replace(log, time=np.arange(log.samples) / self.rate)
        filtered = self.how.filter.apply(local)
        if self.how.delay_s:
            filtered = shifted(filtered, self.how.delay_s)
        first, last = max(0, own.start - self.margin), min(log.samples, own.stop + self.margin)
        cut = filtered.rows(slice(first, last), "window")
        inner = slice(own.start - first, own.stop - first)
        keep = piece.used + inner.start
        prepared = Prepared(cut, keep, self.how, self.every, self.how.delay_s or 0.0)
        return Window(prepared, inner, log.time[first:last][keep], low + own.start, low + own.stop)


class _Used:
    """Which samples of a log are used: inside the trim, one in so many, not near gaps."""

    def __init__(self, windows: Windows) -> None:
        scan, how = windows.scan, windows.how
        first, last = (scan.first, scan.last)
        delay = how.delay_s or 0.0
        slack = 1e-6 / windows.rate
        self._start = max(first + how.trim_s, first + delay) - slack
        self._end = min(last - how.trim_s, last + delay) + slack
        self._every = windows.every
        self._gaps, self._period = scan.gaps_for(how.filter)
        self._origin: int | None = None

    def rows(self, time: Array, start: int) -> IntArray:
        """Return which of successive samples are used, counted from the first of them."""
        inside = (time >= self._start) & (time <= self._end)
        if not inside.any():
            return np.empty(0, dtype=np.int64)
        places = np.flatnonzero(inside)
        if self._origin is None:
            self._origin = start + int(places[0])
        places = places[(places + start - self._origin) % self._every == 0]
        return places[~self._near(time[places])]

    def _near(self, time: Array) -> BoolArray:
        near = np.zeros(len(time), bool)
        if not len(time):
            return near
        low, high = time[0] - self._period, time[-1] + self._period
        for a, b in self._gaps[(self._gaps[:, 1] > low) & (self._gaps[:, 0] < high)]:
            near |= (time > a - self._period) & (time < b + self._period)
        return near


class _Tape:
    """Successive blocks of a log of which some part is at hand."""

    def __init__(self, blocks: Iterator[Log]) -> None:
        self._blocks, self._held = blocks, list[Log]()
        self._start = self._stop = 0

    def read_to(self, stop: int) -> None:
        """Read on until sample ``stop`` is there."""
        while self._stop < stop:
            block = next(self._blocks)
            self._held.append(block)
            self._stop += block.samples

    def log(self, start: int, stop: int) -> Log:
        """Return the samples from ``start`` to ``stop``; those before are let go of."""
        signals = {
            name: np.concatenate([getattr(block, name) for block in self._held])[start - self._start :]
            for name in ("time", *self._held[0].signals())
        }
        self._held, self._start = [replace(self._held[0], **signals)], start
        return self._held[0].rows(slice(0, stop - start), "window")


def _on_grid(stream: LogStream, scan: TimeScan, meaning: Callable[[Log], Log]) -> Iterator[Log]:
    """Yield the samples of a log on its uniform grid, with joints and torques."""
    done, before = 0, None
    for block in stream.blocks():
        log = meaning(block)
        check_finite(log, done)
        if not done:
            _check_readings(stream.table.path, log)
        whole = log if before is None else _joined(before, log)
        check_turns(whole)
        done += log.samples
        before = whole.rows(slice(-1, None), "last row")
        if scan.is_even:
            yield log
            continue
        moved = _interpolated(whole, scan, done == scan.samples)
        if moved is not None:
            yield moved


def _check_readings(path: str, log: Log) -> None:
    """Refuse a log whose first rows show each reading several times, which :func:`resample` sees to of a whole log."""
    if held := first_of_each_reading(log).source.steps[len(log.source.steps) :]:
        evidence = f"{held[0].split(':')[0]}: a stream would take its steps for motion"
        step = "write one row of each reading, with its time; identify does so itself for logs up to 512 MiB"
        raise LogMismatch(path, evidence, step)


def _joined(first: Log, second: Log) -> Log:
    signals = {
        name: np.concatenate([getattr(first, name), getattr(second, name)]) for name in ("time", *second.signals())
    }
    return replace(second, **signals)


def _interpolated(log: Log, scan: TimeScan, last: bool) -> Log | None:
    """Return the samples of the grid from the first sample of a log to before its last, with it at the end of all."""
    place = (scan.count - 1) / (scan.last - scan.first)
    low = max(0, int(np.floor((log.time[0] - scan.first) * place)) - 2)
    high = scan.count if last else min(scan.count, int(np.ceil((log.time[-1] - scan.first) * place)) + 3)
    grid = scan.grid(low, high)
    inside = (grid >= log.time[0]) if last else (grid >= log.time[0]) & (grid < log.time[-1])
    if not inside.any():
        return None
    time = grid[inside]
    signals = {
        name: np.column_stack([np.interp(time, log.time, column) for column in values.T])
        for name, values in log.signals().items()
    }
    return replace(log, time=time, **signals)


def steps_of(windows: Windows, meaning: Log, source: Source) -> tuple[str, ...]:
    """Return in words what was done to the samples of a log: as read, by the case, on the way to the windows."""
    scan = windows.scan
    found = [*source.steps, *meaning.source.steps]
    if not scan.is_even:
        jitter = f"steps of {scan.shortest * 1e3:.3g} to {scan.longest * 1e3:.3g} ms"
        found.append(f"resampled to {(scan.count - 1) / (scan.last - scan.first):.5g} Hz ({jitter})")
    return tuple(found)
