"""Signals of few distinct values."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from dynident.arrays import Array
from dynident.case.evidence.positions import STILL, travel
from dynident.data.log import smallest_step
from dynident.diagnosis.checks.base import Check, CheckedLog
from dynident.diagnosis.finding import Finding, Severity, listed

#: Steps of a signal over its usual range (its 1st to 99th percentile) below which it is coarse: positions are
#: differentiated twice, which makes steps of theirs count more.
FEWEST_STEPS = {"positions": 1000, "torques": 64}

#: Steps below which a signal says little, and the finding is a warning.
FEW_STEPS = 64


@dataclass(frozen=True)
class Resolution(Check):
    """Quantised positions and torques, torques that never change."""

    stage: ClassVar[int] = 1

    def findings(self, subject: CheckedLog) -> Sequence[Finding]:
        log = subject.sound.log
        found = []
        for signal, values in (("positions", log.q), ("torques", log.torque)):
            if values is None:
                continue
            counted = (travel(log.q) >= STILL) | (signal != "positions")  # a joint at rest is told as such
            each = zip(log.joints, values.T, counted, strict=True)
            steps = {name: steps_of(column) for name, column, counts in each if counts}
            coarse = {name: count for name, count in steps.items() if 0 < count < FEWEST_STEPS[signal]}
            if coarse:
                least = min(coarse.values())
                enough = FEWEST_STEPS[signal]
                evidence = (
                    f"the {signal} have {least:.0f} quantisation steps over their range; at least {enough} are needed"
                )
                remedy = "log more digits, or the raw counts; quantisation degrades the parameters of these joints"
                severity: Severity = "warning" if least < FEW_STEPS else "note"
                name = f"coarse {signal}"
                found.append(Finding(severity, name, listed(list(coarse)), evidence, remedy, {"steps": least}))
        if log.torque is not None:
            flat = [name for name, column in zip(log.joints, log.torque.T, strict=True) if np.ptp(column) == 0]
            if flat:
                remedy = "map the column that measures it (log: columns: torque)"
                found.append(Finding("error", "torque never changes", listed(flat), "one value in all rows", remedy))
        return found


def steps_of(column: Array) -> float:
    """Return how many of its smallest steps a signal (N,) spans between its 1st and 99th percentile; 0 for none.

    Infinite where it has no levels (:func:`smallest_step`).
    """
    low, high = np.quantile(column, [0.01, 0.99])
    if high <= low:
        return 0.0
    step = smallest_step(column)
    return float((high - low) / step) if step else np.inf
