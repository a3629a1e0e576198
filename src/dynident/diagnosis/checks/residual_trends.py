"""What the residual of a quick fit still follows: springs, drift, friction curves, a tilt, the clock, a scale."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

from dynident.diagnosis.causes.quick_fit import beyond_quick_fit
from dynident.diagnosis.causes.trend_findings import TRENDS, believed, rival_findings, trend_finding
from dynident.diagnosis.checks.base import Check, CheckedLog
from dynident.diagnosis.finding import Finding


@dataclass(frozen=True)
class ResidualTrends(Check):
    """Springs, counterbalances, drift, friction drift, sub-linear friction, tilt, time scale, torque scales."""

    stage: ClassVar[int] = 2
    tells: ClassVar[tuple[str, ...]] = TRENDS

    def findings(self, subject: CheckedLog) -> Sequence[Finding]:
        trends = subject.trends
        if trends is None:
            return []
        # a case with friction that the quick fit has not has chosen its friction already
        chosen = subject.case.choose_friction or bool(beyond_quick_fit(subject.case))
        return [
            finding
            for blame in trends.blames
            if not (chosen and blame.cause.name == "friction curve")
            for told in [believed(blame, subject.trend_scale)]
            if told is not None
            for finding in (trend_finding(told, trends.fit), *rival_findings(told, trends.fit, subject.trend_scale))
        ]
