"""Time that runs back or stands still."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from dynident.case.evidence.rows import out_of_order, sortable
from dynident.diagnosis.checks.base import Check, CheckedLog
from dynident.diagnosis.finding import Finding
from dynident.diagnosis.repair import MOST_LOST, repeated_rows

#: A day in s, and how near a step back is to one where times of day start again.
_DAY, _NEAR = 86400.0, 60.0

#: What to do about more rows with the time of the row before than can be left out.
SEVERAL = "write the time with more digits, or keep one of two publishers of the signal"


@dataclass(frozen=True)
class TimeOrder(Check):
    """Rows that repeat the one before, rows out of order, a clock that starts again, equal time stamps."""

    stage: ClassVar[int] = 0

    def findings(self, subject: CheckedLog) -> Sequence[Finding]:
        log = subject.raw.log
        finite = np.isfinite(log.time)
        found = []
        repeated = repeated_rows(log)
        if repeated.any():
            first = subject.raw.place(int(np.argmax(repeated)))
            evidence = f"{repeated.sum()} of {log.samples} rows repeat the row before them, the first in {first}"
            remedy = f"leave them out (log: {{repeats: drop}}; '{subject.fix}' writes the log without them)"
            found.append(Finding("error", "repeated rows", "", evidence, remedy, {"rows": int(repeated.sum())}))
        keep = finite & ~repeated
        time, samples = log.time[keep], np.flatnonzero(keep)
        back = np.flatnonzero(np.diff(time) < 0)
        if len(back):
            first = subject.raw.place(int(samples[back[0] + 1]))
            count = int(np.count_nonzero(out_of_order(time)))
            times = "once, in" if len(back) == 1 else f"{len(back)} times, first in"
            evidence = f"time runs back {times} {first}; rows out of order: {count}"
            numbers = {"places": len(back), "rows": count}
            if sortable(time, [values[keep] for values in log.signals().values()]):
                remedy = f"sort the rows ('{subject.fix}' writes them sorted)"
                found.append(Finding("error", "rows out of order", "", evidence, remedy, numbers))
            else:
                why = "the clock was set back, or logs were joined in one file"
                if np.all(np.abs(np.diff(time)[back] + _DAY) < _NEAR):
                    why = "the time of day starts again at midnight; dates beside the times keep it one log"
                remedy = f"split the file there into separate logs: {why}"
                explains = ("spikes", "gap in time")
                found.append(Finding("error", "time runs back", "", evidence, remedy, numbers, explains))
        same = np.flatnonzero(np.diff(time) == 0)
        if len(same):
            first = subject.raw.place(int(samples[same[0] + 1]))
            evidence = f"{len(same)} rows have the time of the row before and other values, the first in {first}"
            remedy = f"leave them out: '{subject.fix}' writes the log without them"
            if len(same) > MOST_LOST * len(time):
                remedy = SEVERAL
            found.append(Finding("error", "equal time stamps", "", evidence, remedy, {"rows": len(same)}))
        return found
