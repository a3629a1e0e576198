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
from dynident.diagnosis.causes.trend_findings import believed, is_narrow, rival_findings, standing, trend_finding
from dynident.diagnosis.causes.trend_texts import TRENDS
from dynident.diagnosis.causes.trends import DELAY, ZERO
from dynident.diagnosis.checks.base import Check, CheckedLog
from dynident.diagnosis.finding import CLOCKS, EXPLAINED, Finding

#: Share of a joint's residual variance that a delay of its torque alone, or one that grows along the log, explains from
#: which the result suffers (right logs have no such delay, whatever their friction), and share of the torque from which
#: the result is wrong.
LATE_EXPLAINS, LATE_BY_FAR = 0.3, 0.05


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
            for finding in (
                _told(told, trends.fit, subject.earlier is None),
                *rival_findings(told, trends.fit, subject.trend_scale),
            )
        ]


def _told(blame: Blame, fit: QuickFit, is_alone: bool) -> Finding:
    """Return what is said of a cause: of late torques, and of a lean of the base or a joint's zero where it is sure.

    They are errors where the remedy predicts unseen samples. A lean or a zero is told so where no other cause explains
    the log as well, and the angle is one from which a mounting is told; not a zero where the log is held against an
    estimate, which has the figure.
    """
    found, name = trend_finding(blame, fit), blame.cause.name
    turns = any(one.name == blame.cause.joint and one.kind == "revolute" for one in fit.model.robot.active)
    if name in (CLOCKS, DELAY) and is_narrow(blame) and blame.share > LATE_EXPLAINS:
        found, doubted = replace(found, severity="warning"), blame.share < EXPLAINED or blame.size < LATE_BY_FAR
    elif found.severity == "warning" and (name == "tilt" or (name == ZERO and is_alone and turns)):
        least = np.linalg.norm(blame.values[:2]) - np.linalg.norm(blame.half_widths[:2])
        doubted = bool(blame.rivals) or least <= np.tan(np.radians(LEAN))
    else:
        return found
    gain, spread = (0.0, 0.0) if doubted else held_out_gain(fit, blame)
    return replace(found, severity="error") if gain > max(GAIN, SURE * spread) else found
