"""Positions that jump by a whole turn."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

from dynident.estimation.doctor._mending import wraps
from dynident.estimation.doctor.base import Check, Finding, Subject, listed


@dataclass(frozen=True)
class EncoderWrap(Check):
    """Jumps of a turn between two samples, as of a counter that starts again."""

    stage: ClassVar[int] = 1

    def findings(self, subject: Subject) -> Sequence[Finding]:
        counts = wraps(subject.raw.log, subject.case.robot)
        if not counts:
            return []
        told = ", ".join(f"{joint} {count}" for joint, count in counts.items())
        evidence = f"jumps of a whole turn between two samples: {told}"
        remedy = f"count the turns on (log: {{wrapped: [{', '.join(counts)}]}}; --fix OUT writes the log so)"
        numbers = {"jumps": sum(counts.values())}
        explains = ("joint limits", "velocity mismatch")
        return [Finding("error", "encoder wrap", listed(list(counts)), evidence, remedy, numbers, explains)]
