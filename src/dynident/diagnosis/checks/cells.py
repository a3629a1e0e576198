"""Values that are none: not finite, alternating between two publishers, far out of line, or stale."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from dynident.arrays import Array, IntArray
from dynident.case.evidence.positions import STILL, travel
from dynident.data.log import Log, smallest_step
from dynident.diagnosis.causes.thin_fit import CUTOFF_HZ
from dynident.diagnosis.checks.base import ROUNDING, Check, CheckedLog
from dynident.diagnosis.finding import Finding, Severity, listed
from dynident.diagnosis.repair import MOST_LOST, broken_rows

#: Share of rows at which a signal jumps to zero from which that is told of arms of one or two joints: there a zero of
#: all may be a value. With more joints one such row is enough.
FLIPS, FEW = 0.005, 2

#: Size of the row before, as a share of the usual one, from which a jump to zero is none of the motion.
AWAY = 0.2

#: Counts of an encoder up to which a value is the last one of a joint that comes to rest, and no jump.
COUNTS = 2.5

#: A value that leaves the line through its neighbours by this many robust deviations is a spike, and the deviation of
#: these neighbours from their median over its own up to which it is.
SPIKE, APART = 25.0, 1.0 / 3.0

#: Times as long as usual that a position stays the same, and as far as usual that it goes then, in median changes of so
#: many to either side; speeds, of the motion around, that the two make; time steps beyond which a gap is the reason.
LONGER, AROUND, CAUGHT_UP, GAP = 4.0, 5, (0.5, 2.0), 2.0

#: Size of a joint's signal, as a share of the largest joint's, below which it is the last digit of a joint at rest.
LAST_DIGIT = 0.01


@dataclass(frozen=True)
class Cells(Check):
    """NaN, publishers that alternate, spikes and values held over many rows."""

    stage: ClassVar[int] = 0

    def findings(self, subject: CheckedLog) -> Sequence[Finding]:
        missing = _not_finite(subject)
        if broken_rows(subject.sound.log).any():  # too many to leave out: nothing else can be said
            return missing
        flips = _flips(subject)
        return [*missing, *flips, *([] if flips else [*_spikes(subject), *_held(subject)])]


def _not_finite(subject: CheckedLog) -> list[Finding]:
    log = subject.raw.log
    bad = broken_rows(log)
    if not bad.any():
        return []
    share = float(bad.mean())
    first = subject.raw.place(int(np.argmax(bad)))
    where = f"most of them in {subject.raw.column_of(*_worst(log))}"
    evidence = f"{bad.sum()} of {log.samples} rows ({100 * share:.2g} %), the first in {first}, {where}"
    remedy = f"'{subject.fix}' writes the log without them"
    name = "values that are not finite"
    if share > MOST_LOST:
        remedy, name = "too many to leave out; look for a driver that does not publish the signal", "signal missing"
    return [Finding("error", name, "", evidence, remedy, {"rows": int(bad.sum()), "share": share})]


def _worst(log: Log) -> tuple[str, int]:
    """Return the signal and the joint that lack most values; ``time`` and 0 where the time does."""
    lacking = {"time": np.array([np.count_nonzero(~np.isfinite(log.time))])}
    lacking |= {name: np.count_nonzero(~np.isfinite(values), axis=0) for name, values in log.signals().items()}
    signal = max(lacking, key=lambda name: lacking[name].max())
    return signal, int(np.argmax(lacking[signal]))


def _flips(subject: CheckedLog) -> list[Finding]:
    """A second publisher fills whole rows of the signal with zeros while the arm is elsewhere."""
    found = []
    for signal, values in subject.sound.log.signals().items():
        if len(values) < 9:
            continue
        empty = np.all(values == 0, axis=1)
        if not empty.any():
            continue
        usual = np.quantile(np.abs(values), 0.99, axis=0)
        steps = np.array([smallest_step(column) for column in values.T])
        far = np.where(np.abs(values) > COUNTS * steps, np.abs(values), 0.0)
        size = np.max(far / np.maximum(usual, max(LAST_DIGIT * usual.max(), 1e-12)), axis=1)
        into = empty[1:] & (size[:-1] > AWAY)
        share = float(into.mean())
        if share > (FLIPS if values.shape[1] <= FEW else 0.0):
            row = subject.sound.place(int(np.argmax(into)) + 1)
            evidence = f"{signal} of all joints jumps to zero at {into.sum()} rows ({100 * share:.2g} %), first {row}"
            remedy = "two publishers write this signal, or messages are lost: record the one that measures it"
            found.append(Finding("error", "two publishers", "", evidence, remedy, {"share": share}))
    return found


def _spikes(subject: CheckedLog) -> list[Finding]:
    log = subject.sound.log
    found = []
    for signal in ("q", "torque"):
        values = getattr(log, signal)
        if values is None or len(values) < 9:
            continue
        near = [values[k : len(values) - 4 + k] for k in range(5)]
        middle = _middle(*near)
        away = np.abs(values[2:-2] - middle)
        floor = np.maximum(1.4826 * np.median(away, axis=0), 1e-3 * np.ptp(middle, axis=0))
        alone = np.abs(values[4:] - values[:-4]) < 0.5 * away  # a step, as of friction at a reversal, does not return
        alone &= _middle(*(np.abs(one - middle) for one in near)) < APART * away  # a bend has neighbours on its way
        spikes = alone & (away > SPIKE * np.maximum(np.maximum(floor, np.quantile(away, 0.99, axis=0) / 4), 1e-12))
        if signal == "q":
            spikes &= travel(values) >= STILL  # of a joint at rest its last digit
        if spikes.any():
            joints = [name for name, any_ in zip(log.joints, spikes.any(axis=0), strict=True) if any_]
            row = subject.sound.place(int(np.argmax(spikes.any(axis=1))) + 2)
            many = f"{spikes.sum()} values of {signal} are isolated outliers, the first in {row}"
            evidence = many if spikes.sum() > 1 else f"1 value of {signal} is an isolated outlier, in {row}"
            remedy = "leave these rows out, or use a robust estimator (estimator: huber)"
            numbers = {"values": int(spikes.sum())}
            found.append(Finding("warning", "spikes", listed(joints), evidence, remedy, numbers))
    return found


def _middle(a: Array, b: Array, c: Array, d: Array, e: Array) -> Array:
    """Return the median of five signals, value by value."""
    low, high = np.maximum(np.minimum(a, b), np.minimum(c, d)), np.minimum(np.maximum(a, b), np.maximum(c, d))
    return np.maximum(np.minimum(e, low), np.minimum(np.maximum(e, low), high))


def _held(subject: CheckedLog) -> list[Finding]:
    """Positions that messages are missing of: the last one is repeated while the joint moves on, and then it jumps."""
    log = subject.sound.log
    cutoff = subject.case.preprocessing.filter.bandwidth() or CUTOFF_HZ
    lag = max(1, round(log.rate / (2.0 * cutoff))) if len(log.time) > 1 else 1
    places, shares = [held_at(log.time, column) for column in log.q.T], np.zeros(log.q.shape[1])
    for i, (begins, ends) in enumerate(places):
        if len(begins) and len(log.time) > 3 * lag:
            moving = np.ones(len(log.time), bool)
            for begin, end in zip(begins, ends, strict=True):
                moving[begin + 1 : end] = False
            smooth = np.interp(log.time, log.time[moving], log.q[moving, i])
            wrong, right = (_bend(each, lag) for each in (log.q[:, i] - smooth, smooth))
            shares[i] = wrong / max(right, 1e-300)
    if not shares.any():
        return []
    joints = [name for name, share in zip(log.joints, shares, strict=True) if share]
    times = sum(len(begins) for begins, _ in places)
    longest = max(int((ends - begins).max()) for begins, ends in places if len(begins))
    row = subject.sound.place(int(min(begins[0] for begins, _ in places if len(begins))))
    evidence = (
        f"a position repeats one value for up to {longest} samples while the joint moves, and then catches up, "
        f"{'once, from' if times == 1 else f'{times} times, first from'} {row}; that makes {shares.max():.2g} of the "
        f"acceleration below {cutoff:g} Hz"
    )
    remedy = "leave these rows out, and look for messages that are lost between the encoder and the log"
    severity: Severity = "warning" if shares.max() > ROUNDING else "note"
    numbers = {"places": times, "share": float(shares.max())}
    return [Finding(severity, "positions held", listed(joints), evidence, remedy, numbers)]


def _bend(column: Array, lag: int) -> float:
    """Return the root mean square of the second difference of a signal (N,), averaged over ``lag`` rows."""
    sums = np.cumsum(np.concatenate([[0.0], column - column.mean()]))
    means = (sums[lag:] - sums[:-lag]) / lag
    return float(np.sqrt(np.mean((means[2 * lag :] - 2.0 * means[lag:-lag] + means[: -2 * lag]) ** 2)))


def held_at(time: Array, column: Array) -> tuple[IntArray, IntArray]:
    """Return the rows in which held positions begin, and those in which they have caught up, shape (K,) each.

    A value stays for several times as many rows as those around it, and the next step is as many times as far: a joint
    that comes to rest, and one whose encoder is coarse, go on with a usual step.

    Args:
        time: Time of the rows in s, shape (N,).
        column: Positions of a joint, shape (N,).
    """
    rows = 1 + np.flatnonzero(np.diff(column))
    if len(rows) < 2 * AROUND + 2:
        return np.zeros(0, int), np.zeros(0, int)
    waited, moved = np.diff(rows), np.abs(column[rows[1:]] - column[rows[1:] - 1])
    held, steps = np.flatnonzero(waited >= LONGER), np.diff(time)  # others wait for a row at least
    if not len(held):
        return np.zeros(0, int), np.zeros(0, int)
    near = np.clip(held[:, None] + np.r_[-AROUND:0, 1 : AROUND + 1], 0, len(waited) - 1)
    longer, farther = (each[held] / np.median(each[near], axis=1) for each in (waited, moved))
    is_held = (longer >= LONGER) & (farther >= LONGER) & (moved[held] >= LONGER * smallest_step(column))
    is_held &= (CAUGHT_UP[0] * longer <= farther) & (farther <= CAUGHT_UP[1] * longer)
    held = held[is_held & (steps[rows[1:][held] - 1] <= GAP * np.median(steps))]
    return rows[:-1][held], rows[1:][held]
