"""Preprocessing, a family of filters, and the one verb that runs them: resample, filter, trim, thin out."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from dynident.arrays import Array, BoolArray, IntArray
from dynident.data.log import Log
from dynident.data.preprocessing._closed_brakes import closed_brakes
from dynident.data.preprocessing._held_rows import first_of_each_reading
from dynident.data.preprocessing._local_polynomials import fractional_shift, shifted
from dynident.data.preprocessing._thinning import Thinning
from dynident.data.preprocessing.base import Filter
from dynident.data.turns import jumps_of_a_turn
from dynident.errors import BadOption, LogMismatch
from dynident.plugins import Family

FILTERS: Family[Filter] = Family("dynident.data.preprocessing", Filter, "filter")  # type: ignore[type-abstract]

#: Steps that differ by less than this share of the median step count as uniform.
UNIFORM = 1e-3

#: A longer gap in time, in s, is not bridged where nothing else is stated (nor one shorter than ten steps refused).
LONGEST_GAP = 0.5

#: A longer gap, in s, is not proposed to be bridged: the rows of its straight line, though left out, take memory.
BRIDGED = 300.0

#: What to do about a gap that is not bridged.
SPLIT = "split the log there"

#: Beyond these a value is no measurement: rad or m, N m or N, A.
LARGEST = {"q": 1e4, "torque": 1e7, "current": 1e6}

#: A longer delay of the torque, in s, is another fault.
LONGEST_DELAY = 1.0

#: Rows a period of the cut-off that lose nothing: a Butterworth of order 4, run twice, leaves 2e-5 of the amplitude at
#: four times its cut-off, half the rate of such rows, so that nothing folds back.
ROWS_PER_PERIOD = 8.0

#: Samples a second that are kept where neither a rate is stated nor a cut-off.
ROWS_A_SECOND = 200.0

#: A joint that is slow for less time than this, in s, is turning round, not resting.
SHORTEST_REST = 0.1


@dataclass(frozen=True)
class Preprocessing:
    """How a log becomes rows of the observation matrix.

    Attributes:
        filter: The filter part.
        rate_hz: Samples a second that are kept; None: as ``rows_per_period`` says.
        trim_s: Seconds left out at both ends, where filters have no past or future.
        standstill: Speed in rad/s below which a joint is at rest when it stays there, of slides times their travel;
            its static friction is then unknown.
        rest: ``mask`` leaves samples at rest out of the fit, ``keep`` takes them in.
        delay_s: By how much the torque of the log lags behind its positions, in s; the motion is shifted by it. None:
            identification estimates it for each log.
        rows_per_period: Rows a period of the filter's cut-off that are kept where no rate is stated, 200 a second where
            a filter states no cut-off for both sides; None keeps all.
        longest_gap_s: Longest gap in time, in s, that a straight line bridges; rows so near it that the line shows are
            left out. A longer one is refused, unless it is shorter than ten steps.
    """

    filter: Filter
    rate_hz: float | None = None
    trim_s: float = 0.0
    standstill: float = 0.0
    rest: str = "mask"
    delay_s: float | None = 0.0
    rows_per_period: float | None = None
    longest_gap_s: float = LONGEST_GAP

    def __post_init__(self) -> None:
        if self.rows_per_period is not None and not self.rows_per_period > 2:
            raise BadOption("rows_per_period", self.rows_per_period, "give more than 2, such as 8")
        if self.rate_hz is not None and not self.rate_hz > 0:
            raise BadOption("rate_hz", self.rate_hz, "give the samples a second to keep, above 0")
        if not self.trim_s >= 0:
            raise BadOption("trim_s", self.trim_s, "give seconds, 0 or more")
        if not self.standstill >= 0:
            raise BadOption("standstill", self.standstill, "give a speed, 0 or more")
        if self.rest not in ("mask", "keep"):
            raise BadOption("rest", self.rest, "choose 'mask' or 'keep'")
        if not 0 < self.longest_gap_s < np.inf:
            raise BadOption("longest_gap_s", self.longest_gap_s, "give seconds, above 0")
        if self.delay_s is not None and not abs(self.delay_s) <= LONGEST_DELAY:
            step = f"give seconds between -{LONGEST_DELAY:g} and {LONGEST_DELAY:g}, or 'auto'"
            raise BadOption("delay_s", self.delay_s, step)

    def rows_hz(self, rate: float) -> float | None:
        """Return the samples a second that are kept of ``rate`` samples a second; None for all."""
        if self.rate_hz is not None or self.rows_per_period is None:
            return self.rate_hz
        cutoff = self.filter.bandwidth()
        return self.rows_per_period * cutoff if cutoff is not None and self.filter.reach(rate) else ROWS_A_SECOND

    def statement(self) -> dict[str, object]:
        """Return what must stand beside every figure: the filter, the samples kept, and the samples at rest."""
        rows = {"rate_hz": self.rate_hz, "trim_s": self.trim_s, "standstill": self.standstill, "rest": self.rest}
        delay = {"delay_s": "auto" if self.delay_s is None else self.delay_s} if self.delay_s != 0 else {}
        gaps = {"longest_gap_s": self.longest_gap_s} if self.longest_gap_s != LONGEST_GAP else {}
        return {**self.filter.statement(), **rows, **delay, **gaps}


def default_preprocessing() -> Preprocessing:
    """Return the default: zero-phase Butterworth, order 4, on both sides at a cut-off that identification chooses."""
    filter = FILTERS.make("butterworth")
    return Preprocessing(filter, trim_s=0.5, standstill=0.02, rows_per_period=ROWS_PER_PERIOD)


@dataclass(frozen=True)
class Prepared:
    """A preprocessed log and which of its rows count.

    Attributes:
        log: On a uniform grid, with q, dq, ddq and torque filtered, all rows.
        keep: Rows that are used, ascending, shape (N,).
        how: The preprocessing.
        every: One row in how many is used.
        delay_s: By how much the motion was shifted to stand beside its torque, in s.
    """

    log: Log
    keep: IntArray
    how: Preprocessing
    every: int = 1
    delay_s: float = 0.0

    @cached_property
    def kept(self) -> Log:
        """The log of the rows that are used."""
        return self.log.rows(self.keep, f"{len(self.keep)} of {self.log.samples} samples kept, one in {self.every}")

    @cached_property
    def thinning(self) -> Thinning | None:
        """The filter of both sides at one sample in ``every``; None where the rows that are used stand otherwise."""
        apart = np.diff(self.keep)
        if not len(apart) or self.every < 2 or np.any(apart % self.every):
            return None
        return self.how.filter.thinning(self.log.rate, self.every)

    def sparser(self, rows_per_period: float) -> Prepared:
        """Return the log with so many rows in a period of the filter's cut-off, as a comparison of models needs.

        Under the filter rows that stand closer say next to nothing that their neighbours do not. Where nothing is
        filtered all rows stay.
        """
        bandwidth = self.how.filter.bandwidth()
        if bandwidth is None or not self.how.filter.reach(self.log.rate):
            return self
        step = int(self.log.rate / self.every / (rows_per_period * bandwidth))
        return self if step < 2 else replace(self, keep=self.keep[::step], every=self.every * step)

    def with_earlier_torque(self, delay_s: float) -> Prepared:
        """Return the log with a delay of its torque taken out of the torque, so that the rows of the motion stay."""
        torque = fractional_shift(np.asarray(self.log.torque), -delay_s * self.log.rate)
        time, slack = self.log.time[self.keep] + delay_s, 1e-6 / self.log.rate
        inside = (time >= self.log.time[0] - slack) & (time <= self.log.time[-1] + slack)
        log = replace(self.log, torque=torque)
        return replace(self, log=log, keep=self.keep[inside], delay_s=self.delay_s + delay_s)

    def statement(self) -> dict[str, object]:
        """Return what must stand beside every figure; ``rate_hz`` is the rate of the rows that are used."""
        return {**self.how.statement(), "rate_hz": round(self.log.rate / self.every, 6)}

    def smooth(self, signals: Array) -> Array:
        """Return signals over all rows, shape (k, rows), filtered as the torque was."""
        return self.how.filter.smooth(signals, self.log.rate)


def preprocess(log: Log, how: Preprocessing) -> Prepared:
    """Return the log with q, dq, ddq and torque ready for the regressor; time is made uniform first.

    Raises:
        LogMismatch: Too few samples for the filter, the trim or the rate, a value that is no finite number, or a
            position that starts again after a whole turn.
    """
    check_finite(log)
    check_turns(log)
    return thinned(_filtered(log, how), how, how.delay_s or 0.0)


def _filtered(log: Log, how: Preprocessing) -> Log:
    """Return a log on a uniform grid, filtered, and likewise the motion before it."""
    even, before = resample(log, how.longest_gap_s), log.before
    if len(spells := closed_brakes(even)):  # what is measured there and near it is left out as near a gap
        gaps = spells if even.gaps is None else np.concatenate([even.gaps, spells])
        source = replace(even.source, braked=tuple((float(start), float(end)) for start, end in spells))
        even = replace(even, gaps=gaps, source=source)
    found = how.filter.apply(even)
    if not isinstance(before, Log):
        return found
    start = 1 + max((-1, *_long_gaps(before, how.longest_gap_s)))
    before = before.rows(slice(start, None), "since the last gap") if start else before
    return replace(found, before=_filtered(before, how) if before.samples >= 10 else None)


def thinned(filtered: Log, how: Preprocessing, delay_s: float = 0.0) -> Prepared:
    """Return a filtered log with its motion shifted by the delay of the torque, and the rows of it that are used.

    Args:
        filtered: The log on a uniform grid, filtered.
        how: The preprocessing; its own delay is left aside.
        delay_s: By how much the torque lags behind the positions, in s.

    Raises:
        LogMismatch: Too few samples are left.
    """
    if delay_s:
        filtered = shifted(filtered, delay_s)
    start, end = filtered.time[0] + how.trim_s, filtered.time[-1] - how.trim_s
    start, end = max(start, filtered.time[0] + delay_s), min(end, filtered.time[-1] + delay_s)
    slack = 1e-6 / filtered.rate
    keep = np.flatnonzero((filtered.time >= start - slack) & (filtered.time <= end + slack))
    rows = how.rows_hz(filtered.rate)
    if rows is not None:
        # A tie, such as 500 Hz to 200, goes the same way whatever the rounding of the time stamps.
        keep = keep[:: max(1, int(np.ceil(filtered.rate / rows - 0.51)))]
    every = int(keep[1] - keep[0]) if len(keep) > 1 else 1
    near = _near_gaps(filtered.gaps, filtered.time[keep], how.filter)
    if near.any():
        keep = keep[~near]
        count = int(np.count_nonzero(near))
        filtered = filtered.with_step(f"{count} samples near gaps in time or with closed brakes left out")
        filtered = replace(filtered, source=replace(filtered.source, gap_samples=count))
    if len(keep) < 2:
        kept = f"{len(keep)} of {filtered.samples} samples are left after {how.trim_s:.3g} s trimmed at each end"
        evidence = f"its {filtered.duration:.3g} s are too short: {kept}"
        raise LogMismatch(filtered.name, evidence, "give a longer log, or trim less")
    return Prepared(filtered, keep, how, every, delay_s)


def _near_gaps(gaps: Array | None, time: Array, filter: Filter) -> BoolArray:
    """Return which of the times are so near a gap of the recording that the straight line over it shows.

    It shows where the gap is more than a fifth of the shortest period that passes the filter, which carries it a period
    to either side.
    """
    period = 0.0 if filter.bandwidth() is None else 1.0 / float(filter.bandwidth() or 1.0)
    near = np.zeros(len(time), bool)
    for start, end in () if gaps is None else gaps:
        if end - start > 0.2 * period:
            near |= (time > start - period) & (time < end + period)
    return near


def check_turns(log: Log) -> None:
    """Refuse positions that start again after a whole turn, of which no filter makes a motion.

    Raises:
        LogMismatch: A position that jumps by a turn between two samples.
    """
    counts = jumps_of_a_turn(log.q, time=log.time)
    if np.any(counts):
        wrapped = {name: int(count) for name, count in zip(log.joints, counts, strict=True) if count}
        evidence = "positions jump by a whole turn between two samples: " + ", ".join(
            f"{name} {count} times" if count > 1 else f"{name} once" for name, count in wrapped.items()
        )
        step = f"have the turns counted on in the case file (log: {{wrapped: [{', '.join(wrapped)}]}})"
        raise LogMismatch(log.name, evidence, step)


def check_finite(log: Log, before: int = 0) -> None:
    """Refuse a log with a value that is no measurement; ``before`` are the samples of the whole log before it.

    Raises:
        LogMismatch: A value that is no finite number, or too large to be one.
    """
    for name, values in {"time": log.time[:, None], **log.signals()}.items():
        most = LARGEST.get(name, np.inf)
        if not values.size or (-most < values.min() and values.max() < most):  # not a number is neither
            continue
        bad = ~(np.abs(values) < most) | ~np.isfinite(values)
        if np.any(bad):
            row, column = np.argwhere(bad)[0]
            of = "" if name == "time" else f" of {log.joints[column]}"
            evidence = f"{name}{of} is {values[row, column]:g} at sample {before + row + 1}"
            raise LogMismatch(log.name, evidence, "repair the recording or leave these samples out")


def at_rest(dq: Array, velocity: float | Array, rate: float, shortest: float = SHORTEST_REST) -> BoolArray:
    """Return where each joint rests: slower than ``velocity`` for ``shortest`` seconds or longer, shape (N, n).

    A joint that only passes through zero speed is not at rest: its friction changes sign, but is known.

    Args:
        dq: Velocities on a uniform grid, shape (N, n).
        velocity: In rad/s or m/s, one or one for each joint, shape (n,); 0 for nowhere at rest.
        rate: Samples a second.
        shortest: In s.
    """
    slow = np.abs(dq) < velocity
    edges = np.diff(np.pad(slow.astype(np.int8), ((1, 1), (0, 0))), axis=0)
    resting = np.zeros_like(slow)
    for joint in range(dq.shape[1]):
        starts, ends = np.flatnonzero(edges[:, joint] == 1), np.flatnonzero(edges[:, joint] == -1)
        for start, end in zip(starts, ends, strict=True):
            resting[start:end, joint] = end - start >= shortest * rate
    return resting


def resample(log: Log, longest_gap: float | None = None) -> Log:
    """Return the log, one row of each reading, on a uniform grid at its median rate, by linear interpolation.

    Args:
        log: As it came.
        longest_gap: A longer gap in time, in s, is refused; None for half a second.

    Raises:
        LogMismatch: Fewer than ten samples, time that does not run forward, or a long gap in it.
    """
    if log.samples < 10:
        raise LogMismatch(log.name, f"only {log.samples} samples", "an identification needs seconds of motion")
    steps = np.diff(log.time)
    if np.any(steps <= 0):
        row = int(np.argmax(steps <= 0)) + 1
        evidence = f"time does not run forward at sample {row + 1} ({log.time[row - 1]:.6g} to {log.time[row]:.6g} s)"
        raise LogMismatch(log.name, evidence, "sort the rows or remove the repeated ones")
    check_gaps(log, longest_gap)
    log = first_of_each_reading(log)
    steps = np.diff(log.time)
    middle = float(np.median(steps))
    if np.max(np.abs(steps - middle)) <= UNIFORM * middle:
        return log
    count = round(log.duration / middle) + 1
    if count > 10 * log.samples:
        evidence = f"a median step of {middle:.3g} s where {log.samples} samples last {log.duration:.4g} s"
        raise LogMismatch(log.name, evidence, "log the time of the measurement: samples came in bursts")
    time = log.time[0] + log.duration * np.linspace(0, 1, count)
    moved = {
        name: np.column_stack([np.interp(time, log.time, column) for column in values.T])
        for name, values in log.signals().items()
    }
    wide = np.flatnonzero(steps > 5 * middle)
    gaps = np.concatenate(
        [np.zeros((0, 2)) if log.gaps is None else log.gaps, np.stack([log.time[wide], log.time[wide + 1]], axis=1)]
    )
    jitter = f"steps of {steps.min() * 1e3:.3g} to {steps.max() * 1e3:.3g} ms"
    return replace(
        log.with_step(f"resampled to {(count - 1) / log.duration:.5g} Hz ({jitter})"), time=time, gaps=gaps, **moved
    )


def check_gaps(log: Log, longest_gap: float | None = None) -> None:
    """Refuse a log with a gap in time longer than ``longest_gap`` in s; None for half a second, and no other to state.

    Raises:
        LogMismatch: It has one.
    """
    if long := _long_gaps(log, longest_gap):
        steps = np.diff(log.time)
        row = max(long, key=lambda place: steps[place])
        remedy = SPLIT if longest_gap is None else gap_remedy(float(steps[row]))
        place = f"sample {row + 1}, {log.time[row] - log.time[0]:.4g} s from its start"
        raise LogMismatch(log.name, f"a gap of {steps[row]:.4g} s after {place}", remedy)


def _long_gaps(log: Log, longest_gap: float | None) -> list[int]:
    """Return the samples after which a gap follows that is not bridged."""
    if log.samples < 2:
        return []
    steps = np.diff(log.time)
    least = longest_step(float(np.median(steps)), LONGEST_GAP if longest_gap is None else longest_gap)
    return np.flatnonzero(steps > least).tolist()


def longest_step(middle: float, longest_gap: float = LONGEST_GAP) -> float:
    """Return the longest step in s that is no gap in time: a stated time, and ten median steps at least."""
    return max(longest_gap, 10 * middle)


def gap_remedy(seconds: float) -> str:
    """Return what to do about a gap in time that is not bridged."""
    if seconds > BRIDGED:
        return SPLIT
    return f"leave the samples near it out (preprocessing: {{longest_gap_s: {bridge_over(seconds):g}}}), or {SPLIT}"


def bridge_over(seconds: float) -> float:
    """Return the ``longest_gap_s`` that bridges a gap, of two digits."""
    return float(f"{1.1 * seconds:.2g}")
