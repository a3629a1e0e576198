"""Signals of few distinct values."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dynident.case.evidence.positions import FEW_VALUES, STILL, rounding_share, steps_of, travel
from dynident.diagnosis.causes.thin_fit import CUTOFF_HZ
from dynident.diagnosis.checks.base import ROUNDING, Check, CheckedLog
from dynident.diagnosis.finding import Finding, Severity, listed

#: Steps of a torque over its usual range (its 1st to 99th percentile) below which it is coarse, and of any signal below
#: which it says little, and the finding is a warning.
FEW_STEPS = FEW_VALUES


@dataclass(frozen=True)
class Resolution(Check):
    """Quantised positions and torques, torques that never change."""

    def findings(self, subject: CheckedLog) -> Sequence[Finding]:
        log = subject.sound.log
        cutoff = subject.case.preprocessing.filter.bandwidth() or CUTOFF_HZ
        found = []
        for signal, values in (("positions", log.q), ("torques", log.torque)):
            if values is None:
                continue
            is_position = signal == "positions"
            counted = (travel(log.q) >= STILL) | (not is_position)  # a joint at rest is told as such
            each = zip(log.joints, values.T, counted, strict=True)
            columns = {name: column for name, column, counts in each if counts}
            steps = {name: steps_of(column) for name, column in columns.items()}
            shares = {
                name: rounding_share(log.time, columns[name], count, cutoff) if is_position else FEW_STEPS / count
                for name, count in steps.items()
                if 0 < count < np.inf
            }
            coarse = {name: steps[name] for name, share in shares.items() if share > (ROUNDING if is_position else 1.0)}
            if coarse:
                least = min(coarse.values())
                worst = max(shares[name] for name in coarse)
                enough = f"at least {FEW_STEPS} are needed"
                if is_position:
                    enough = f"rounding makes up to {worst:.2g} of the acceleration below {cutoff:g} Hz"
                evidence = f"the {signal} have {least:.0f} quantisation steps over their range; {enough}"
                remedy = "log more digits, or the raw counts; quantisation degrades the parameters of these joints"
                severity: Severity = "warning" if least < FEW_STEPS else "note"
                name = f"coarse {signal}"
                found.append(Finding(severity, name, listed(list(coarse)), evidence, remedy, {"steps": least}))
        if log.torque is not None:
            flat = [name for name, column in zip(log.joints, log.torque.T, strict=True) if np.ptp(column) == 0]
            if flat:
                remedy = "map the column that measures it (log: columns: torque); a gripper is locked (locked: "
                remedy += f"{{{flat[-1]}: POSITION}}) and its columns left out"
                found.append(Finding("error", "torque never changes", listed(flat), "one value in all rows", remedy))
        return found
