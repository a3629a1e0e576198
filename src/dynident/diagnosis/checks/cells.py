"""Values that are none: not finite, alternating between two publishers, far out of line, or stale."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from dynident.case.evidence.positions import STILL, travel
from dynident.data.log import Log
from dynident.diagnosis.checks.base import Check, CheckedLog
from dynident.diagnosis.finding import Finding, listed
from dynident.diagnosis.repair import MOST_LOST, broken_rows

#: Share of rows at which a signal jumps to zero from which that is told of arms of one or two joints: there a zero of
#: all may be a value. With more joints one such row is enough.
FLIPS, FEW = 0.005, 2

#: Size of the row before, as a share of the usual one, from which a jump to zero is none of the motion.
AWAY = 0.2

#: A value that leaves the line through its neighbours by this many robust deviations is a spike.
SPIKE = 25.0

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
        return [*missing, *flips, *([] if flips else _spikes(subject))]


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
        usual = np.quantile(np.abs(values), 0.99, axis=0)
        size = np.max(np.abs(values) / np.maximum(usual, max(LAST_DIGIT * usual.max(), 1e-12)), axis=1)
        empty = np.all(values == 0, axis=1)
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
        middle = np.median(np.stack([values[k : len(values) - 4 + k] for k in range(5)]), axis=0)
        away = np.abs(values[2:-2] - middle)
        floor = np.maximum(1.4826 * np.median(away, axis=0), 1e-3 * np.ptp(middle, axis=0))
        alone = np.abs(values[4:] - values[:-4]) < 0.5 * away  # a step, as of friction at a reversal, does not return
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
