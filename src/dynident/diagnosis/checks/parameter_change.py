"""A load that is taken up, put down or exchanged within a log, or a gain or zero that changes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from dynident.data.preprocessing._closed_brakes import spells_in_words
from dynident.diagnosis.causes.parameter_change import PART_S, parameter_change
from dynident.diagnosis.causes.signs_of_all import READING_CONSEQUENCES
from dynident.diagnosis.checks.base import Check, CheckedLog
from dynident.diagnosis.finding import UNLIKE_OTHERS, Finding

#: Spells that are told at most.
TOLD = 6

#: Name of the finding.
CHANGE = "parameter change"


@dataclass(frozen=True)
class ParameterChangeWithin(Check):
    """Parts of a log whose bodies contradict those of the rest, with friction of their own as well."""

    stage: ClassVar[int] = 2
    tells: ClassVar[tuple[str, ...]] = (CHANGE,)

    #: What a mixture of two sets of parameters looks like besides.
    explains: ClassVar[tuple[str, ...]] = (
        *READING_CONSEQUENCES,
        *(UNLIKE_OTHERS, "another robot", "robot model differs", "coupling", "torque scales"),
    )

    def findings(self, subject: CheckedLog) -> Sequence[Finding]:
        fit = subject.fit
        change = None if fit is None else parameter_change(fit)
        if fit is None or change is None:
            return []
        spans = subject.spans(fit, change.rows, 2.0 * PART_S, 0.0)
        joint = fit.model.robot.joint_names[int(np.argmax(change.times))]
        evidence = (
            f"from {spells_in_words(spans, TOLD)} after the start the bodies are others than in the rest of the log: "
            f"with those of the other part the residual of {joint} is {change.times.max():.3g} times that with its own"
        )
        remedy = (
            "look for a load that was taken up, put down or exchanged then, or for a gain or zero that changed; write "
            "the rows of either part into a file of its own, and identify with the one whose load the robot model has "
            "('dynident payload ESTIMATE LOG' then weighs the load of the other)"
        )
        numbers = {"first": spans[0][0], "last": spans[-1][1], "times": float(change.times.max())}
        return [Finding("error", CHANGE, joint, evidence, remedy, numbers, self.explains)]
