"""What a check of a log is, what it sees, and what it finds."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, ClassVar, Literal

import numpy as np

from dynident.errors import DynidentError
from dynident.estimation.doctor._earlier_causes import Known, known_bodies
from dynident.estimation.doctor._quick_fit import PLAIN, QuickFit, quick_fit
from dynident.estimation.doctor._recording import Recording
from dynident.estimation.doctor._trend_causes import Trends
from dynident.estimation.estimate import Estimate
from dynident.estimation.friction.delay import Delay, find_delays
from dynident.experiment.case_file.case import Case
from dynident.model.base_parameters import base_parameters
from dynident.model.friction import FRICTION

#: A delay counts from this many of its standard deviations on.
SURE_DELAY = 5.0

Severity = Literal["error", "warning", "note"]

#: The severities, the gravest first.
SEVERITIES: tuple[Severity, ...] = ("error", "warning", "note")


@dataclass(frozen=True)
class Finding:
    """One thing that was seen in a log.

    Attributes:
        severity: ``error``: the log is refused or the result would be wrong; ``warning``: the result suffers;
            ``note``: worth knowing.
        name: What it is, such as ``torque sign``.
        joint: Joints that it is about, separated by commas; empty where it is the whole log.
        evidence: What was seen, with figures.
        remedy: What to do, with the key of the case file where there is one.
        numbers: The figures of the evidence.
        explains: Names of findings that follow from this one and are not told beside it.
    """

    severity: Severity
    name: str
    joint: str
    evidence: str
    remedy: str
    numbers: Mapping[str, float] = field(default_factory=dict)
    explains: tuple[str, ...] = ()

    def figures(self) -> dict[str, Any]:
        """Return the finding as plain data for JSON; a number that does not exist is None."""
        numbers = {key: float(value) if np.isfinite(value) else None for key, value in self.numbers.items()}
        texts = ("severity", "name", "joint", "evidence", "remedy")
        return {**{text: getattr(self, text) for text in texts}, "numbers": numbers}

    def line(self) -> str:
        """Return the finding in one line."""
        of = f" ({self.joint})" if self.joint else ""
        return f"{self.severity}: {self.name}{of}: {self.evidence}; {self.remedy}"


@dataclass(frozen=True)
class Subject:
    """A log under examination.

    Attributes:
        case: Robot, columns and preparation.
        raw: The log as its file has it.
        sound: The same after the safe mends: time runs forward, every value is finite.
        earlier: An estimate of the same robot that bodies are held against; None for the description.
    """

    case: Case
    raw: Recording
    sound: Recording
    earlier: Estimate | None = None

    @cached_property
    def fit(self) -> QuickFit | None:
        """A fit of few rows by weighted least squares; None where the log has no torques or too few rows."""
        return quick_fit(self.case, self.sound.log)

    @cached_property
    def delay(self) -> Delay | None:
        """The delay of the torque; ``applied`` is 0 where it may well be none."""
        if self.fit is None:
            return None
        more = [part for part in self.case.friction if FRICTION.name_of(part) not in PLAIN and not part.needs]
        model = replace(self.fit.model, friction=(*self.fit.model.friction, *more))  # a bend passes for a lead
        base = base_parameters(model) if more else self.fit.base
        try:
            (found,), _ = find_delays(model, base, [self.fit.log], self.fit.how)
        except DynidentError:
            return None
        sure = abs(found.seconds) > SURE_DELAY * found.deviation
        return replace(found, applied=found.seconds if sure else 0.0)

    @cached_property
    def trends(self) -> Trends | None:
        """What the residual follows once the delay of the torque is taken out; None where there is no fit."""
        if self.fit is None:
            return None
        late = 0.0 if self.delay is None else self.delay.applied
        fit = replace(self.fit, how=replace(self.fit.how, delay_s=late)) if late else self.fit
        return Trends(fit, self.fit.gravity_observers)

    @cached_property
    def known(self) -> Known | None:
        """What the earlier estimate knows of the bodies; None where there is none, or it knows nothing of them."""
        if self.fit is None or self.earlier is None:
            return None
        return known_bodies(self.earlier, self.fit.model, self.fit.base)


class Check(ABC):
    """A look at one side of a log; pure, never changes anything.

    Attributes:
        stage: 0 looks at the raw file, 1 at the mended signals, 2 at a quick fit. A stage is left out after an error
            in an earlier one that no mend removes.
    """

    stage: ClassVar[int] = 1

    @abstractmethod
    def findings(self, subject: Subject) -> Sequence[Finding]:
        """Return what was found, nothing where all is well."""


def listed(names: Sequence[str]) -> str:
    """Return the names of joints as one text."""
    return ", ".join(names)
