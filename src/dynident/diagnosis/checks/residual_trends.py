"""What the residual of a quick fit still follows: springs, drift, friction curves, a tilt, the clock, a scale."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

from dynident.diagnosis.causes.trend_findings import (
    TRENDS,
    believed,
    rival_findings,
    standing,
    trend_finding,
)
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
        frames, blames = standing(trends, trends.blames)
        return frames + [
            finding
            for blame in blames
            if blame.cause.name not in subject.described
            for told in [believed(blame, subject.trend_scale)]
            if told is not None
            for finding in (trend_finding(told, trends.fit), *rival_findings(told, trends.fit, subject.trend_scale))
        ]
