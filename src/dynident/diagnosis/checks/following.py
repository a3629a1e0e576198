"""Measured positions against commanded ones: a motion slowed down, and joints that do not follow."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dynident.case.evidence.positions import strays
from dynident.diagnosis.checks.base import Check, CheckedLog
from dynident.diagnosis.finding import Finding, listed


@dataclass(frozen=True)
class Following(Check):
    """Speed scaling and order of the joints, by the commanded positions where they are logged."""

    def findings(self, subject: CheckedLog) -> Sequence[Finding]:
        log = subject.sound.log
        if log.q_ref is None:
            return []
        away = np.sqrt(np.mean((log.q - log.q_ref) ** 2, axis=0))
        astray = strays(log.q, log.q_ref)
        if not astray.any():
            return []
        speed = _speed(log.time, log.q, log.q_ref)
        if astray.sum() > 1 and abs(speed - 1) > 0.02:
            evidence = f"the arm executed its path at {100 * speed:.0f} % of the commanded speed"
            remedy = (
                "a fit of measured positions is not affected; for a comparison with the plan set speed scaling to 100 %"
            )
            return [Finding("warning", "speed scaling", "", evidence, remedy, {"speed": speed})]
        joints = [name for name, wrong in zip(log.joints, astray, strict=True) if wrong]
        evidence = f"positions are up to {away.max():.3g} rad or m (rms) away from the commanded ones"
        remedy = "check order, sign and unit of both (log: columns: q, q_ref)"
        return [Finding("warning", "not following", listed(joints), evidence, remedy, {"rms": float(away.max())})]


def _speed(time: np.ndarray, q: np.ndarray, q_ref: np.ndarray) -> float:
    """Return the factor s in q(t) = q_ref(s t) that leaves the least, between 0.1 and 1.5; 1 where none explains it."""
    clock = time - time[0]

    def left(speed: float) -> float:
        moved = [np.interp(speed * clock, clock, column) for column in q_ref.T]
        inside = speed * clock <= clock[-1]
        return float(np.mean(((q - np.array(moved).T)[inside] / np.maximum(q_ref.std(axis=0), 1e-3)) ** 2))

    grid = np.arange(0.1, 1.5, 0.005)
    values = [left(float(speed)) for speed in grid]
    best = int(np.argmin(values))
    return float(grid[best]) if values[best] < 0.1 * left(1.0) else 1.0
