"""The torques against the bodies of an earlier estimate: what has changed since."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from dynident.estimation.doctor._causes import Blame
from dynident.estimation.doctor._earlier_causes import Since
from dynident.estimation.doctor._trend_findings import believable, trend_finding
from dynident.estimation.doctor.base import Check, Finding, Subject

#: Share of the largest torque of the bodies from which a load is a warning.
MATTERS = 0.1


@dataclass(frozen=True)
class EarlierBodies(Check):
    """A load, a counterbalance, a spring, a scale of torques, a tilt that an earlier estimate did not see."""

    stage: ClassVar[int] = 2

    def findings(self, subject: Subject) -> Sequence[Finding]:
        if subject.trends is None or subject.known is None:
            return []
        since = Since(subject.trends, subject.known)
        return [
            _finding(each, None if each is blame else blame, since)
            for blame in since.search.blames()
            for each in (blame, *blame.rivals)
            if believable(each)
        ]


def _finding(blame: Blame, better: Blame | None, since: Since) -> Finding:
    """Return what is said of a cause; ``better`` is the likelier one that the log does not tell it from."""
    found = _load(blame, since) if blame.cause.name == "load at the flange" else trend_finding(blame, since.fit)
    told = "against the bodies of the earlier estimate: "
    if better is not None:
        of = f" ({better.cause.joint})" * bool(better.cause.joint)
        told += f"the log does not tell it from {better.cause.name}{of}: "
    return replace(found, severity=found.severity if better is None else "note", evidence=told + found.evidence)


def _load(blame: Blame, since: Since) -> Finding:
    mass, deviation = float(blame.values[-1]), float(blame.deviations[-1])
    told = f"of {mass:+.3g} kg (+- {2 * deviation:.2g} kg)"
    if abs(mass) < 2 * deviation:  # moments are sure, the mass is not
        strongest = int(np.argmax(blame.torque))
        joint = since.fit.model.robot.joint_names[strongest]
        told = f"of {blame.torque[strongest]:.3g} N m (or N) rms at {joint}, its mass is not determined"
    evidence = f"a load at the flange {told} (certainty {blame.certainty:.0f})"
    remedy = "a payload or tool that was not there: take it off or describe it"
    bodies = np.sqrt(np.mean(since.bodies**2, axis=0))
    heavy = float(blame.torque.max()) > MATTERS * float(bodies.max()) and abs(mass) > 4 * deviation
    numbers = {"mass_kg": mass, "deviation_kg": deviation, "certainty": blame.certainty}
    return Finding("warning" if heavy else "note", "load at the flange", "", evidence, remedy, numbers)
