"""Steps of the time: its unit, gaps, lost rows and jitter, and a cut-off that they cannot carry."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from dynident.case.evidence.rows import POSSIBLE_STEPS, is_step, time_units
from dynident.data.formats._units import UNITS, unit_of
from dynident.data.preprocessing import gap_remedy, longest_step
from dynident.diagnosis.checks.base import Check, CheckedLog
from dynident.diagnosis.finding import Finding, Severity
from dynident.diagnosis.new_log import IN_MEMORY

#: Median steps from which a step is a gap.
LONG = 10.0

#: Share of the median step by which steps scatter (root mean square) before interpolation shows in the derivatives.
JITTER = 0.5

#: Share of the median step by which steps may scatter (root mean square) about whole multiples of it where rows are
#: missing (steps of any length scatter by 0.29), share of the scatter that is left then at most, and share of missing
#: rows from which they are a warning.
WHOLE_STEPS, MOST, MANY_LOST = 0.15, 0.7, 0.02

#: Share of the steps that are long from which they are no lost rows, but stamps that come in bursts.
SELDOM = 0.2

#: Share of the samples below the speed that counts as a joint's largest.
FAST = 0.999

#: Largest speed over its limit below which no robot is recorded, and between which it is usual.
CRAWLS, PLAUSIBLE = 2e-3, (0.02, 1.5)


@dataclass(frozen=True)
class TimeSteps(Check):
    """The unit of the time, a cut-off that its steps cannot carry, gaps, missing rows and jitter."""

    stage: ClassVar[int] = 0

    def findings(self, subject: CheckedLog) -> Sequence[Finding]:
        log = subject.sound.log
        steps = np.diff(log.time)
        steps = steps[np.isfinite(steps) & (steps > 0)]
        if len(steps) < 9:
            evidence = f"{log.samples} rows with a time of their own"
            return [Finding("error", "too few rows", "", evidence, "record seconds of motion", {"rows": log.samples})]
        middle = float(np.median(steps))
        if not is_step(middle) or _is_slow(subject, middle):
            return [_unit(subject, middle)]
        written = np.diff(subject.raw.log.time)  # with the rows that have values missing
        steps = written if np.all(written > 0) else steps
        steps = steps[steps <= LONG * middle]
        counts = np.maximum(np.rint(steps / middle), 1.0)
        lost = _lost_rows(steps, counts, middle)
        steps = steps - (counts - 1.0) * middle if lost else steps
        return [*_cutoff(subject), *_gaps(subject, middle), *lost, *_jitter(steps, middle)]


def _speed_share(subject: CheckedLog) -> float:
    """Return the largest speed of a joint over its limit, by the positions; NaN where no joint states one."""
    log, limits = subject.sound.log, np.array([joint.limits.velocity for joint in subject.case.robot.active])
    steps = np.diff(log.time)[:, None]
    speeds = np.abs(np.diff(log.q, axis=0)) / np.where(steps > 0, steps, np.inf)
    shares = np.nanquantile(speeds, FAST, axis=0) / np.where(np.isfinite(limits) & (limits > 0), limits, np.nan)
    return float(np.nanmax(shares)) if np.isfinite(shares).any() else float("nan")


def _is_slow(subject: CheckedLog, middle: float) -> bool:
    """Return whether the motion is far too slow for a robot, and that of another unit of the time is not."""
    if not _speed_share(subject) < CRAWLS:
        return False
    shares = _speed_shares(subject, _other_units(subject, middle)[:1])
    return bool(shares and PLAUSIBLE[0] <= shares[0] <= PLAUSIBLE[1])


def _other_units(subject: CheckedLog, middle: float) -> list[str]:
    """Return units of the time under which the step is usual, else possible, that of the likeliest speed first."""
    unit = subject.raw.columns.units.time
    (one, per), _ = unit_of("time", unit)
    plain = middle * per / one
    found = [word for word in time_units(plain) or time_units(plain, POSSIBLE_STEPS) if word != unit]
    doubts = [
        max(PLAUSIBLE[0] / share, share / PLAUSIBLE[1], 1.0) if share > 0 else 1.0
        for share in _speed_shares(subject, found)
    ]
    return [found[k] for k in np.argsort(doubts, kind="stable")]


def _speed_shares(subject: CheckedLog, units: Sequence[str]) -> list[float]:
    """Return the largest speed over its limit under other units of the time."""
    (one, per), share = unit_of("time", subject.raw.columns.units.time)[0], _speed_share(subject)
    return [share * (one * each) / (per * other) for other, each in (UNITS["time"][word][0] for word in units)]


def _unit(subject: CheckedLog, middle: float) -> Finding:
    unit = subject.raw.columns.units.time
    (one, per), _ = unit_of("time", unit)
    plain = middle * per / one
    usual = _other_units(subject, middle)
    counter = "of a counter state the sampling rate instead (log: columns: {time: 200 Hz})"
    remedy = f"check the column; {counter}"
    if usual:
        rate = UNITS["time"][usual[0]][0][1] / plain
        remedy = f"state its unit (log: units: {{time: {usual[0]}}}, {rate:.4g} samples a second then); {counter}"
        if subject.raw.log.source.path in IN_MEMORY:
            (one, per), _ = unit_of("time", usual[0])
            remedy = f"write time = time * {one / per:g} if it is in {usual[0]}, {rate:.4g} samples a second then"
    evidence = f"the median step is {plain:.4g} {unit}, {1 / middle:.4g} samples a second"
    if is_step(middle):
        evidence += f"; no joint is faster than {_speed_share(subject):.2%} of its speed limit"
    return Finding("error", "time unit", "", evidence, remedy, {"median_step_s": middle})


def _cutoff(subject: CheckedLog) -> list[Finding]:
    """Return what is said of a stated cut-off that the sampling rate cannot carry."""
    cutoff, rate = subject.case.preprocessing.filter.bandwidth(), subject.sound.log.rate
    if cutoff is None or cutoff < rate / 2:
        return []
    evidence = f"{rate:.4g} samples a second cannot carry a cut-off of {cutoff:g} Hz"
    remedy = f"state cutoff_hz: auto, or one below {rate / 2:.4g} Hz (preprocessing: filter); or correct units: time"
    return [Finding("error", "cut-off frequency", "", evidence, remedy, {"cutoff_hz": cutoff, "rate_hz": rate})]


def _gaps(subject: CheckedLog, middle: float) -> list[Finding]:
    log = subject.sound.log
    steps = np.diff(log.time)
    long = np.flatnonzero(steps > LONG * middle)
    if not len(long):
        return []
    worst = int(long[np.argmax(steps[long])])
    where = subject.sound.place(worst)
    many = f"{len(long)} gaps, the longest" if len(long) > 1 else "a gap"
    evidence = f"{many} of {steps[worst]:.4g} s after {where}; the median step is {middle:.4g} s"
    numbers = {"gaps": len(long), "longest_s": float(steps[worst])}
    if steps[worst] > longest_step(middle, subject.case.preprocessing.longest_gap_s):
        return [Finding("error", "gap in time", "", evidence, gap_remedy(float(steps[worst])), numbers)]
    remedy = "samples near them are left out of the fit; look for what stopped the recorder"
    return [Finding("warning", "gap in time", "", evidence, remedy, numbers)]


def _lost_rows(steps: np.ndarray, counts: np.ndarray, middle: float) -> list[Finding]:
    """Return that rows are missing, where ``counts`` times the median step explains most of how the steps scatter."""
    lost, places, most = int(np.sum(counts - 1)), int(np.sum(counts > 1)), int(counts.max()) - 1
    rest, scatter = (float(np.sqrt(np.mean(off**2))) / middle for off in (steps - counts * middle, steps - middle))
    if not 0 < places < SELDOM * len(steps) or rest > min(WHOLE_STEPS, MOST * scatter):
        return []
    share = lost / (len(steps) + lost)
    where = f"in {places} places, up to {most} in a row" if places > 1 else "in one place"
    evidence = f"{lost} rows ({100 * share:.2g} %) are missing {where}; the median step is {1e3 * middle:.4g} ms"
    remedy = "look for what stops the recorder; missing rows are interpolated"
    severity: Severity = "warning" if share > MANY_LOST else "note"
    return [Finding(severity, "lost rows", "", evidence, remedy, {"rows": lost, "share": share})]


def _jitter(steps: np.ndarray, middle: float) -> list[Finding]:
    scatter = float(np.sqrt(np.mean((steps - middle) ** 2))) / middle
    if scatter <= 0.05:
        return []
    low, high = 1e3 * steps.min(), 1e3 * steps.max()
    evidence = f"steps of {low:.3g} to {high:.3g} ms around {1e3 * middle:.4g} ms ({100 * scatter:.0f} % rms)"
    remedy = "log the time of the measurement, not of its arrival; the rows are interpolated to equal steps"
    return [
        Finding("warning" if scatter > JITTER else "note", "time jitter", "", evidence, remedy, {"rms_share": scatter})
    ]
