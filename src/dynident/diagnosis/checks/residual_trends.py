"""What the residual of a quick fit still follows: springs, drift, friction curves, a tilt, the clock, a scale."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from dynident.diagnosis.causes.cause_search import Blame
from dynident.diagnosis.causes.gravity_direction import LEAN
from dynident.diagnosis.causes.quick_fit import QuickFit
from dynident.diagnosis.causes.robot_misfit import GAIN, SURE, held_out_gain
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
            for finding in (_told(told, trends.fit), *rival_findings(told, trends.fit, subject.trend_scale))
        ]


def _told(blame: Blame, fit: QuickFit) -> Finding:
    """Return what is said of a cause; a lean of the base is an error where its remedy predicts unseen samples.

    No other cause explains the log as well then, and the angle is one from which a mounting is told.
    """
    found = trend_finding(blame, fit)
    if blame.cause.name != "tilt" or found.severity != "warning" or blame.rivals:
        return found
    least = np.linalg.norm(blame.values[:2]) - np.linalg.norm(blame.half_widths[:2])
    gain, spread = held_out_gain(fit, blame) if least > np.tan(np.radians(LEAN)) else (0.0, 0.0)
    return replace(found, severity="error") if gain > max(GAIN, SURE * spread) else found
