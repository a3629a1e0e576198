"""What the residual of a quick fit still follows: springs, drift, friction curves, a tilt, the clock, a scale."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

from dynident.estimation.doctor._quick_fit import PLAIN
from dynident.estimation.doctor._trend_findings import believable, rival_findings, trend_finding
from dynident.estimation.doctor.base import Check, Finding, Subject
from dynident.model.friction import FRICTION


@dataclass(frozen=True)
class ResidualTrends(Check):
    """Springs, counterbalances, drift, warming friction, curved friction, tilted bases, wrong clocks, torque scales."""

    stage: ClassVar[int] = 2

    def findings(self, subject: Subject) -> Sequence[Finding]:
        trends = subject.trends
        if trends is None:
            return []
        # a case with friction that the quick fit has not has chosen its friction already
        chosen = subject.case.choose_friction or any(
            FRICTION.name_of(part) not in PLAIN for part in subject.case.friction
        )
        return [
            finding
            for blame in trends.blames
            if not (chosen and blame.cause.name == "friction curve") and believable(blame)
            for finding in (trend_finding(blame, trends.fit), *rival_findings(blame, trends.fit))
        ]
