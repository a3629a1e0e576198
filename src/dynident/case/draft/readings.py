"""The samples of a log before a case exists: its values as they stand in the file, rate, gaps, rest, band."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from dynident.arrays import Array
from dynident.case.evidence.positions import STILL, travel
from dynident.case.evidence.rows import same_as_before
from dynident.data.formats import LogFormat, LogTable, open_log
from dynident.data.formats._table import MIN_SAMPLES
from dynident.data.preprocessing import longest_step
from dynident.data.split import EPISODE, episode_rows
from dynident.errors import LogFormatError

#: Rows from which a draft is made at most: a quarter of an hour at 1 kHz.
MOST_ROWS = 1 << 20

#: The cut-off is this many times the band of the motion; see docs/which-filter.md.
CUTOFF_FACTOR = 10.0

#: Limits of the cut-off: in Hz, and as a share of the sampling rate.
LEAST_CUTOFF, LARGEST_SHARE = 2.0, 0.2

#: Share of the power of the positions that lies in the band of a motion.
BAND_SHARE = 0.999

#: Travel, as a share of the largest in a log, below which a joint only sways, or its encoder is coarse.
SWAYS = 0.005


@dataclass(frozen=True)
class LogReading:
    """A log in the units of its file.

    Attributes:
        path: The file as it was given.
        time: Time of the rows that are used, shape (N,), running forward.
        signals: Values by signal, each (N, k).
        rows: Rows that were read.
        notes: What is wrong with it, in words.
        is_head: Whether the file has more rows.
        repeated: Rows that repeat the row before them.
        episodes: Recordings that the file holds; the first of them is read.
    """

    path: str
    time: Array
    signals: Mapping[str, Array]
    rows: int
    notes: tuple[str, ...] = ()
    is_head: bool = False
    repeated: int = 0
    episodes: int = 1

    @property
    def step(self) -> float:
        """Median time between two rows, in the unit of the file."""
        return float(np.median(np.diff(self.time)))

    @property
    def duration(self) -> float:
        """Time from the first row to the last, in the unit of the file."""
        return float(self.time[-1] - self.time[0])


def opened(path: str, form: LogFormat | None = None) -> LogTable:
    """Return the columns of a log file, its rows not read yet.

    Raises:
        FileError: The file cannot be read.
        LogFormatError: No sound log, or no format has its suffix.
    """
    return open_log(path) if form is None else form.open(path)


def read_rows(table: LogTable, time: str, columns: Mapping[str, Sequence[str]]) -> LogReading:
    """Return the samples of a log that can be used, and what is wrong with the others.

    Args:
        table: The opened file.
        time: Column of the time.
        columns: Columns by signal.

    Raises:
        LogFormatError: A cell is no number, or too few rows can be used.
    """
    names = list(dict.fromkeys([time, *(name for group in columns.values() for name in group)]))
    names += [EPISODE] if EPISODE in table.header and EPISODE not in names else []
    for name in names:
        if name not in table.header:
            step = "all logs of one case have the same columns; make a case for each kind of log"
            raise LogFormatError(table.path, table.line, f"no column '{name}' as in the first log", step)
    values, is_head = _head(table, names)
    rows, notes = len(values), list[str]()
    parts = episode_rows(values[:, names.index(EPISODE)]) if EPISODE in names else [slice(None)]
    values = values[parts[0]]
    sound = np.isfinite(values).all(axis=1)
    if not sound.all():
        notes.append(f"{np.count_nonzero(~sound)} of {rows} rows hold values that are not finite")
    stamps = np.where(sound, values[:, 0], -np.inf)
    latest = np.maximum.accumulate(np.concatenate([[-np.inf], stamps[:-1]]))
    forward = sound & (values[:, 0] > latest)
    same = same_as_before([values])
    if np.count_nonzero(sound & ~forward & ~same):
        notes.append(f"time repeats or runs back in {np.count_nonzero(sound & ~forward & ~same)} rows")
    values = values[forward]
    if len(values) < MIN_SAMPLES:
        step = "an identification needs seconds of motion"
        raise LogFormatError(table.path, table.line, f"only {len(values)} rows that can be used", step)
    place = {name: k for k, name in enumerate(names)}
    signals = {signal: values[:, [place[name] for name in group]] for signal, group in columns.items()}
    return LogReading(
        table.path, values[:, 0], signals, rows, tuple(notes), is_head, int(np.count_nonzero(sound & same)), len(parts)
    )


def _head(table: LogTable, names: Sequence[str]) -> tuple[Array, bool]:
    """Return some columns of the first samples of a log, and whether there are more."""
    parts, rows = list[Array](), 0
    for values in table.batches(names, 1 << 16):
        parts.append(values)
        rows += len(values)
        if rows > MOST_ROWS:
            break
    return np.concatenate(parts)[:MOST_ROWS], rows > MOST_ROWS


def long_gap(time: Array) -> float:
    """Return the longest gap in s of a time in s that is not bridged where nothing else is stated; 0 for none."""
    steps = np.diff(time)
    longest = float(steps.max())
    return longest if longest > longest_step(float(np.median(steps))) else 0.0


def band(time: Array, q: Array) -> float:
    """Return the frequency in Hz below which 99.9 % of the power of each moving joint's position lies; 0 for none.

    Args:
        time: In s, shape (N,).
        q: Positions in rad or m, shape (N, n). What one that stands still has is noise, whose band is that of
            the log; the same holds for one that sways about its place.
    """
    reach = travel(q)
    moved = q[:, reach >= max(STILL, SWAYS * reach.max())]
    if not moved.shape[1]:
        return 0.0
    count = min(len(time), 1 << 17)
    even = np.linspace(time[0], time[-1], count)
    signals = np.column_stack([np.interp(even, time, column) for column in moved.T])
    window = np.hanning(count)[:, None]
    power = np.abs(np.fft.rfft((signals - signals.mean(axis=0)) * window, axis=0)) ** 2
    shares = np.cumsum(power, axis=0) / np.maximum(power.sum(axis=0), np.finfo(float).tiny)
    frequencies = np.fft.rfftfreq(count, (even[-1] - even[0]) / (count - 1))
    return float(max(frequencies[np.argmax(column >= BAND_SHARE)] for column in shares.T))


def cutoff_from(band_hz: float, rate_hz: float) -> float:
    """Return the cut-off in Hz that a draft proposes for a motion of some band, logged at some rate."""
    return float(f"{min(max(CUTOFF_FACTOR * band_hz, LEAST_CUTOFF), LARGEST_SHARE * rate_hz):.2g}")
