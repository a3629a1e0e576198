"""One thing that was seen in a log: severity, evidence and next step."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

Severity = Literal["error", "warning", "note"]

#: The severities, the gravest first.
SEVERITIES: tuple[Severity, ...] = ("error", "warning", "note")

#: Name of the finding of a log that parameters of the others do not explain.
UNLIKE_OTHERS = "unlike other logs"

#: Name of the finding of a log that is too short for a fit, beside which no other cause is looked for.
SHORT = "short log"

#: Name of the finding of joints whose torque the model predicts worse than a constant.
UNEXPLAINED = "torque not explained"

#: Name of the finding of a position that is counted from the base.
ABSOLUTE = "absolute angle"

#: Share of a joint's residual variance that a cause explains, from which the result suffers of it.
EXPLAINED = 0.5

#: Share of the variation of a joint's torque, root mean squares, from which next to nothing of it is explained.
LOST = 0.75

#: Positions and torques whose clocks run apart: a delay of all torques that grows along the log.
CLOCKS = "two clocks"

#: What follows from a wrong sign, order, scale, coupling or mounting, and is not told beside it.
CONSEQUENCES = (
    "torque scale",
    "scale not determined",
    "torque unit",
    "torque delay",
    "joint elasticity",
    "torque hysteresis",
    "position zero",
    "position scale",
    "time scale",
    CLOCKS,
    "spring",
    "rotor inertia",
    "counterbalance",
    "torque ripple",
    "drift",
    "friction drift",
    "friction curve",
    "tilt",
    "load at the flange",
    "end stop",
    "inconsistent links",
    UNEXPLAINED,
)

#: Spells that are named, and time in s from which four digits do not tell where they are, as of clocks from 1970 on.
TOLD, ROUNDED = 5, 1e4


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
        beside: Label of the likelier finding that the log does not tell this one from; empty where it stands alone.
    """

    severity: Severity
    name: str
    joint: str
    evidence: str
    remedy: str
    numbers: Mapping[str, float] = field(default_factory=dict)
    explains: tuple[str, ...] = ()
    beside: str = ""

    @property
    def label(self) -> str:
        """Its name and the joints that it is about."""
        return f"{self.name} ({self.joint})" if self.joint else self.name

    def figures(self) -> dict[str, Any]:
        """Return the finding as plain data for JSON; a number that does not exist is None."""
        numbers = {key: float(value) if np.isfinite(value) else None for key, value in self.numbers.items()}
        texts = ("severity", "name", "joint", "evidence", "remedy")
        return {**{text: getattr(self, text) for text in texts}, "numbers": numbers}

    def line(self) -> str:
        """Return the finding in one line."""
        return f"{self.severity}: {self.label}: {self.evidence}; {self.remedy}"


def listed(names: Sequence[str]) -> str:
    """Return the names of joints as one text."""
    return ", ".join(names)


def brakes_closed(spells: Iterable[Iterable[float]]) -> str:
    """Return when brakes are closed, in words; ``spells`` are starts and ends in s, (k, 2)."""
    return f"with closed brakes ({spells_in_words(spells, TOLD)})"


def spells_in_words(spells: Iterable[Iterable[float]], most: int) -> str:
    """Return starts and ends in s, (k, 2), in words, ``most`` of them."""
    told = [" to ".join(f"{time:{'.4g' if time < ROUNDED else '.1f'}}" for time in spell) + " s" for spell in spells]
    return f"{', '.join(told[:most])}{', ...' * (len(told) > most)}"


def ordered(found: Sequence[Finding], others: Sequence[Finding] = ()) -> tuple[Finding, ...]:
    """Return findings with the gravest first, those that another one of these or of ``others`` explains left out.

    Of two that explain each other the graver one stays, or the first.
    """
    elsewhere = {name for finding in others for name in finding.explains}
    first: dict[tuple[str, str], Finding] = {}
    for finding in sorted(found, key=_rank):  # two checks may see one thing: the gravest tells it
        first.setdefault((finding.name, finding.joint), finding)
    told = list(first.values())
    kept = [
        own
        for k, own in enumerate(told)
        if own.name not in elsewhere
        and not any(own.name in other.explains for other in told[:k])
        and not any(own.name in other.explains and other.name not in own.explains for other in told[k + 1 :])
    ]
    return tuple(sorted(kept, key=_rank))


def _rank(finding: Finding) -> tuple[int, bool]:
    return SEVERITIES.index(finding.severity), finding.name != UNLIKE_OTHERS
