"""The torques against the bodies of an earlier estimate: what has changed since."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from dynident.diagnosis.causes.against_estimate import Since
from dynident.diagnosis.causes.cause_search import Blame
from dynident.diagnosis.causes.trend_findings import believed, trend_finding
from dynident.diagnosis.checks.base import Check, CheckedLog
from dynident.diagnosis.finding import Finding

#: Share of the largest torque of the bodies from which a load is a warning.
MATTERS = 0.1


@dataclass(frozen=True)
class EarlierBodies(Check):
    """Load, counterbalance, spring, torque scale or tilt that differ from an earlier estimate."""

    stage: ClassVar[int] = 2

    def findings(self, subject: CheckedLog) -> Sequence[Finding]:
        if subject.trends is None or subject.known is None:
            return []
        since = Since(subject.trends, subject.known)
        return [
            _finding(each, None if each is blame else blame, since)
            for blame in since.search.blames()
            for each in (blame, *blame.rivals)
            if believed(each) is not None
        ]


def _finding(blame: Blame, better: Blame | None, since: Since) -> Finding:
    """Return what is said of a cause; ``better`` is the likelier one that the log does not tell it from."""
    found = _load(blame, since) if blame.cause.name == "load at the flange" else trend_finding(blame, since.fit)
    told = "against the earlier estimate: "
    if better is not None:
        of = f" ({better.cause.joint})" * bool(better.cause.joint)
        told += f"not distinguishable from {better.cause.name}{of}: "
    return replace(found, severity=found.severity if better is None else "note", evidence=told + found.evidence)


def _load(blame: Blame, since: Since) -> Finding:
    mass, deviation = float(blame.values[-1]), float(blame.deviations[-1])
    told = f"of {mass:+.3g} kg (+- {2 * deviation:.2g} kg)"
    if abs(mass) < 2 * deviation:  # moments are sure, the mass is not
        strongest = int(np.argmax(blame.torque))
        joint = since.fit.model.robot.joint_names[strongest]
        told = f"of {blame.torque[strongest]:.3g} N m (or N) rms at {joint}, its mass is not determined"
    evidence = f"a load at the flange {told} (t = {blame.certainty:.0f})"
    remedy = "remove the payload or tool, or add it to the robot model"
    bodies = np.sqrt(np.mean(since.bodies**2, axis=0))
    heavy = float(blame.torque.max()) > MATTERS * float(bodies.max()) and abs(mass) > 4 * deviation
    numbers = {"mass_kg": mass, "std_kg": deviation, "t": blame.certainty}
    return Finding("warning" if heavy else "note", "load at the flange", "", evidence, remedy, numbers)
