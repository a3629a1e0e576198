"""Logged velocities against the derivative of the positions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dynident.arrays import Array, BoolArray
from dynident.case.evidence.positions import STILL, travel
from dynident.case.evidence.velocities import VelocityPair, is_near, velocity_pair
from dynident.data.log import Log
from dynident.diagnosis.checks.base import Check, CheckedLog
from dynident.diagnosis.finding import Finding, listed

#: Correlations from which two signals are the same motion, and below which they are not.
SAME, OTHER = 0.9, 0.6

#: Ratio off one by which a velocity has another scale.
SCALE = 0.03

#: Ratio off one that is told where all joints have it, and how many of their deviations it must be.
CLOCK, ALIKE_STD = 1e-3, 4.0

#: Ratios that a unit explains.
_UNITS = {180.0 / np.pi: "deg/s", 1e3: "mm/s"}


@dataclass(frozen=True)
class Velocity(Check):
    """Unit, sign, order, scale and lag of dq by the derivative of q."""

    def findings(self, subject: CheckedLog) -> Sequence[Finding]:
        log = subject.sound.log
        pair = None if log.dq is None else velocity_pair(log.time, log.q, log.dq)
        return [] if pair is None else _told(subject, log, pair)


def _told(subject: CheckedLog, log: Log, pair: VelocityPair) -> list[Finding]:
    names, alike, ratio = log.joints, pair.correlations, pair.ratios
    moving = pair.moving & (travel(log.q) >= STILL)
    own = np.diagonal(alike)
    found, odd = [], np.zeros(len(names), bool)
    for i in np.flatnonzero(moving & (np.abs(own) < OTHER)):
        others = [k for k in np.flatnonzero(moving) if k != i and abs(alike[i, k]) > SAME]
        odd[i] = True
        if others:
            evidence = (
                f"dq of {names[i]} follows the position of {names[others[0]]} (correlation {alike[i, others[0]]:.3f})"
            )
            remedy = "name the columns in the order of the joints (log: columns: {q: [...], dq: [...]})"
            found.append(Finding("error", "velocity order", names[i], evidence, remedy, {"correlation": own[i]}))
        else:
            evidence = f"dq does not follow the derivative of q (correlation {own[i]:.3f})"
            remedy = "check both columns (log: columns)"
            found.append(Finding("warning", "velocity mismatch", names[i], evidence, remedy, {"correlation": own[i]}))
    turned = moving & (own < -OTHER)
    if turned.any():
        remedy = "one of the two has the wrong sign; leave dq out (log: columns: {dq: none}) or correct its column"
        joints = [name for name, wrong in zip(names, turned, strict=True) if wrong]
        evidence = "dq and the derivative of q have opposite signs"
        found.append(
            Finding("error", "velocity sign", listed(joints), evidence, remedy, {"correlation": float(own.min())})
        )
    good = moving & ~odd & ~turned
    scaled = good & (own > SAME) & (np.abs(ratio - 1) > SCALE)
    found += _scale(names, ratio, scaled, moving) or _clock(ratio[good & (own > SAME)])
    return (
        [*found, *_lag(subject, log, pair, good & ~scaled)] if all(one.severity == "note" for one in found) else found
    )


def _scale(names: Sequence[str], ratio: Array, scaled: BoolArray, moving: BoolArray) -> list[Finding]:
    if not scaled.any():
        return []
    joints = [name for name, wrong in zip(names, scaled, strict=True) if wrong]
    middle = float(np.median(ratio[scaled]))
    numbers = {"ratio": middle}
    evidence = f"dq is {middle:.4g} times the derivative of q"
    for factor, unit in _UNITS.items():
        if is_near(middle, factor):
            remedy = f"state the unit of the velocities (log: units: {{velocity: {unit}}})"
            return [Finding("error", "velocity unit", listed(joints), evidence, remedy, numbers)]
        if is_near(middle, 1 / factor):
            if factor == 1e3 and scaled[moving].all():
                remedy = "state the unit of the time column (log: units: {time: ms})"
                return [Finding("error", "time unit", "", evidence, remedy, numbers)]
            remedy = f"the positions are in {unit.removesuffix('/s')}: state it (log: units: {{position: ...}})"
            name = "positions in degrees" if unit == "deg/s" else "position unit"
            return [Finding("error", name, listed(joints), evidence, remedy, numbers, ("joint limits",))]
    if scaled[moving].all() and np.ptp(ratio[scaled]) < 0.02 * abs(middle):
        remedy = "the ratio is the same at all joints: check the scale of the time column"
        return [Finding("warning", "time scale", "", evidence, remedy, numbers)]
    remedy = "check gear ratio and unit of both columns (log: units)"
    severity = "note" if is_near(middle) else "warning"
    return [Finding(severity, "velocity scale", listed(joints), evidence, remedy, numbers)]


def _clock(ratio: Array) -> list[Finding]:
    """Return the speed of the clock where dq of all joints is off by one small factor."""
    if len(ratio) < 2:
        return []
    middle = float(np.median(ratio))
    spread = max(1.4826 * float(np.median(np.abs(ratio - middle))), CLOCK / 10)
    if abs(middle - 1) < max(CLOCK, ALIKE_STD * spread):
        return []
    evidence = f"dq of all joints is {middle:.4f} times the derivative of q (+-{spread:.1g})"
    remedy = "the clock of the log may have another rate: log the time of the measurement"
    return [Finding("note", "time scale", "", evidence, remedy, {"ratio": middle})]


def _lag(subject: CheckedLog, log: Log, pair: VelocityPair, good: BoolArray) -> list[Finding]:
    """Return the lag of dq behind the derivative of q that most joints have."""
    if not good.any():
        return []
    lag = float(np.median(pair.lags[good]))
    spread = float(1.4826 * np.median(np.abs(pair.lags[good] - lag)))
    if lag == 0.0 or abs(lag) < 3 * spread:
        return []
    used = subject.case.preprocessing.filter.statement().get("kind") == "as_given"
    side = "lags" if lag > 0 else "leads"
    evidence = f"dq {side} the derivative of q by {1e3 * abs(lag):.3g} ms ({abs(lag) * log.rate:.2f} samples)"
    remedy = "differentiate q by a zero-phase filter (preprocessing: filter: butterworth), or log unfiltered velocities"
    if not used:
        remedy = "no action needed: the filter of the case differentiates q itself"
    return [Finding("warning" if used else "note", "velocity lag", "", evidence, remedy, {"lag_s": lag})]
