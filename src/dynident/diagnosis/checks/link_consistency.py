"""Links that cannot be consistent with the torques, beyond noise and model error."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

from dynident.diagnosis.causes.body_consistency import DRAWS, inconsistency
from dynident.diagnosis.checks.base import Check, CheckedLog
from dynident.diagnosis.finding import Finding


@dataclass(frozen=True)
class LinkConsistency(Check):
    """Rise of the residual that links of positive mass density cost, against a parametric bootstrap."""

    stage: ClassVar[int] = 2

    def findings(self, subject: CheckedLog) -> Sequence[Finding]:
        found = None if subject.fit is None else inconsistency(subject.fit)
        if found is None:
            return []
        evidence = (
            f"links of positive mass density raise the residual by {100 * found.rise:.2g} %; noise and model error of "
            f"this log raise it by at most {100 * found.chance:.2g} % in {DRAWS} draws; {found.link} is held most"
        )
        remedy = (
            f"check torque scales, gear ratios and signs of the joints up to {found.link}, and lengths and axes of the "
            "robot model"
        )
        numbers = {"rise": found.rise, "chance": found.chance}
        return [Finding("warning", "inconsistent links", "", evidence, remedy, numbers)]
