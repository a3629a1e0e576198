"""Positions that jump by a whole turn."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from dynident.diagnosis.checks.base import Check, CheckedLog
from dynident.diagnosis.finding import Finding, listed
from dynident.diagnosis.repair import wraps


@dataclass(frozen=True)
class EncoderWrap(Check):
    """Encoder wrap: jumps of a turn between two samples."""

    def findings(self, subject: CheckedLog) -> Sequence[Finding]:
        counts = wraps(subject.raw.log, subject.case.robot)
        if not counts:
            return []
        told = ", ".join(f"{joint} {count}" for joint, count in counts.items())
        evidence = f"jumps of a whole turn between two samples: {told}"
        remedy = f"count the turns on (log: {{wrapped: [{', '.join(counts)}]}}; '{subject.fix}' writes the log so)"
        numbers = {"jumps": sum(counts.values())}
        explains = ("joint limits", "velocity mismatch")
        return [Finding("error", "encoder wrap", listed(list(counts)), evidence, remedy, numbers, explains)]
