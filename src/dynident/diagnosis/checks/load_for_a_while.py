"""A load that is carried for a part of a log: gripped and let go, or a tool that is changed on the way."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from dynident.diagnosis.causes.load_in_part import SHORTEST_S, SPELLS, load_in_part
from dynident.diagnosis.checks.base import Check, CheckedLog
from dynident.diagnosis.finding import CONSEQUENCES, UNLIKE_OTHERS, Finding, Severity, spells_in_words

#: Times by which the residual variance is smaller with the load, over the joints (right logs: 1.2 at most).
FALL = 2.0

#: Residual that is left with it in its spells over that at other times, at most (loads 3.7; a contact 13 and more).
LEFT = 7.0

#: Residual over the deviation of a joint's torque from which the result is wrong.
LARGE = 0.05

#: Normal deviate of 95 %, and largest half-width of the mass, over it, with which it is told.
Z95, NARROW = 1.96, 0.5


@dataclass(frozen=True)
class LoadForAWhile(Check):
    """Spells in which a load at the flange explains the log far better than one that is always there, or never."""

    stage: ClassVar[int] = 2

    #: What such a load looks like besides.
    explains: ClassVar[tuple[str, ...]] = (
        *CONSEQUENCES,
        *("contact", UNLIKE_OTHERS, "another robot", "torque scale of all", "coupling", "robot model differs"),
    )

    def findings(self, subject: CheckedLog) -> Sequence[Finding]:
        fit = subject.fit
        load = None if fit is None else load_in_part(fit)
        if fit is None or load is None or load.left > LEFT or load.fall < max(FALL, load.fall_of_offsets):
            return []
        spans, half_width = subject.spans(fit, load.there, SHORTEST_S, 0.0), Z95 * load.std
        is_told = half_width < NARROW * load.mass
        mass = f"a load at the flange of {load.mass:.3g} +- {half_width:.1g} kg" if is_told else "a load at the flange"
        evidence = (
            f"{mass} from {spells_in_words(spans, SPELLS)} after the start, and none at other times: with it the "
            f"residual variance is {load.fall:.2g} times smaller (product over the joints)"
        )
        remedy = (
            f"{subject.without(fit, spans)}, or take a log without a load; 'dynident payload ESTIMATE LOG' weighs it, "
            "by an estimate without it"
        )
        numbers = {"first": spans[0][0], "last": spans[-1][1], "fall": load.fall}
        severity: Severity = "error" if np.max(fit.relative[fit.moves], initial=0.0) > LARGE else "warning"
        numbers |= {"mass": load.mass, "half_width": half_width} if is_told else {}
        return [Finding(severity, "load for a while", load.joint, evidence, remedy, numbers, self.explains)]
