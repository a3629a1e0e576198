"""The samples of a log before a case exists: its values as they stand in the file, rate, gaps, rest, band."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from dynident.arrays import Array
from dynident.case.draft.yaml_words import few
from dynident.case.evidence.positions import STILL, travel
from dynident.case.evidence.rows import MOST_LOST, out_of_order, same_as_before, sortable
from dynident.data.formats import LogFormat, LogTable, open_log
from dynident.data.formats.base import MIN_SAMPLES
from dynident.data.preprocessing import BRIDGED, longest_step
from dynident.data.split import EPISODE, episode_rows
from dynident.errors import LogFormatError, NoNumbers

#: Rows from which a draft is made at most: a quarter of an hour at 1 kHz.
MOST_ROWS = 1 << 20

#: The cut-off is this many times the band of the motion; see docs/which-filter.md.
CUTOFF_FACTOR = 10.0

#: Why columns are left out that are not finite.
NO_NUMBERS = "no numbers in these columns (all or nearly all are nan)"

#: Limits of the cut-off: in Hz, and as a share of the sampling rate.
LEAST_CUTOFF, LARGEST_SHARE = 2.0, 0.2

#: Share of the power of the positions that lies in the band of a motion.
BAND_SHARE = 0.999

#: Travel, as a share of the largest in a log, below which a joint only sways, or its encoder is coarse.
SWAYS = 0.005

#: What to do with signals in several files.
ONE_FILE = "put their columns side by side into one, at the times of one clock (docs/log-formats.md)"

#: What names faulty rows, and what repairs those that are safe to repair.
_NAMED, _FIXED = "'dynident check' with this case names the rows", "its --fix OUT.csv"


@dataclass(frozen=True)
class LogReading:
    """A log in the units of its file.

    Attributes:
        path: The file as it was given.
        time: Time of the rows that are used, shape (N,), running forward.
        signals: Values by signal, each (N, k).
        rows: Rows that were read.
        notes: What is wrong with it, in words.
        remedies: What to do about each note.
        is_head: Whether the file has more rows.
        repeated: Rows that repeat the row before them.
        episodes: Recordings that the file holds; the first of them is read.
    """

    path: str
    time: Array
    signals: Mapping[str, Array]
    rows: int
    notes: tuple[str, ...] = ()
    remedies: tuple[str, ...] = ()
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
        NoNumbers: Columns hold no number in any or nearly any row.
        LogFormatError: A cell is no number, or too few rows can be used.
    """
    names = list(dict.fromkeys([time, *(name for group in columns.values() for name in group)]))
    names += [EPISODE] if EPISODE in table.header and EPISODE not in names else []
    for name in names:
        if name not in table.header:
            step = "all logs of one case have the same columns; make a case for each kind of log"
            if {*names} & {*table.header} <= {time}:
                step = f"signals of one motion in several files: {ONE_FILE}; of several kinds of log make a case each"
            raise LogFormatError(table.path, table.line, f"no column '{name}' as in the first log", step)
    values, is_head = _head(table, names)
    rows = len(values)
    lost = np.count_nonzero(~np.isfinite(values), axis=0)
    if empty := [name for name, count in zip(names, lost, strict=True) if count and count >= (1 - MOST_LOST) * rows]:
        told = f"{few(empty, 4)}: not finite in {lost.max()} of {rows} rows"
        raise NoNumbers(table.path, table.line, empty, told, "read other columns, or lock the joints that have none")
    parts = episode_rows(values[:, names.index(EPISODE)]) if EPISODE in names else [slice(None)]
    sound, notes = _sound(values[parts[0]], rows)
    same = same_as_before([sound])
    forward = sound[:, 0] > np.maximum.accumulate(np.concatenate([[-np.inf], sound[:, 0]]))[:-1]
    behind = int(np.count_nonzero(~forward & ~same))
    if behind:
        step = f"{_NAMED}; split the log where its time runs back, or write the time with more digits"
        if not (np.diff(sound[:, 0]) < 0).any() and behind <= MOST_LOST * rows:
            step = f"{_NAMED}, and {_FIXED} leaves them out"
        notes.append((f"time repeats or runs back in {behind} rows", step))
    values = sound[forward]
    if len(values) < MIN_SAMPLES:
        step = "sort the rows, or split the log where its time runs back; " * bool(behind)
        why = "".join(f"; {note}" for note, _ in notes)
        why += f", most of them in '{names[int(np.argmax(lost))]}'" * bool(lost.any())
        step += "an identification needs seconds of motion"
        raise LogFormatError(table.path, table.line, f"only {len(values)} rows that can be used{why}", step)
    place = {name: k for k, name in enumerate(names)}
    signals = {signal: values[:, [place[name] for name in group]] for signal, group in columns.items()}
    told, remedies = tuple(note for note, _ in notes), tuple(step for _, step in notes)
    repeated = int(np.count_nonzero(same))
    return LogReading(table.path, values[:, 0], signals, rows, told, remedies, is_head, repeated, len(parts))


def _sound(values: Array, rows: int) -> tuple[Array, list[tuple[str, str]]]:
    """Return finite rows, sorted where that is safe, and what was wrong, each with what to do.

    Args:
        values: Rows, their time first, shape (N, c).
        rows: Rows of the log.
    """
    notes = list[tuple[str, str]]()
    finite = np.isfinite(values).all(axis=1)
    lost = int(np.count_nonzero(~finite))
    if lost:
        step = f"{_NAMED}, and {_FIXED} leaves them out" if lost <= MOST_LOST * len(values) else _NAMED
        notes.append((f"{lost} of {rows} rows hold values that are not finite", step))
    values = values[finite]
    moved = int(np.count_nonzero(out_of_order(values[:, 0])))
    if moved and sortable(values[:, 0], [values]):
        notes.append((f"{moved} of {rows} rows are out of order", f"{_NAMED}, and {_FIXED} sorts them"))
        values = values[np.argsort(values[:, 0], kind="stable")]
    return values, notes


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


def longest_part(time: Array) -> slice:
    """Return the most rows without a gap that is too long to be bridged, of a time in s, shape (N,)."""
    steps = np.diff(time)
    cuts = np.flatnonzero(steps > longest_step(float(np.median(steps)), BRIDGED)) + 1
    ends = [0, *cuts.tolist(), len(time)]
    return max(map(slice, ends, ends[1:]), key=lambda rows: rows.stop - rows.start)


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
