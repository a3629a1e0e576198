"""The torques against the bodies of the description: a payload, a counterbalance that carries weight, one scale."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from dynident.diagnosis.causes.against_estimate import with_rotors
from dynident.diagnosis.causes.against_robot_model import Against
from dynident.diagnosis.causes.cause_search import Blame
from dynident.diagnosis.causes.quick_fit import asks_inertia
from dynident.diagnosis.causes.trend_findings import believed, rival_findings, trend_finding
from dynident.diagnosis.checks.base import Check, CheckedLog
from dynident.diagnosis.finding import Finding, Severity

#: Share of what free bodies would explain that the told causes must explain together, or the description is too far
#: off to blame one thing.
ENOUGH = 0.6

#: Share of the largest torque of the bodies from which a load is a warning: descriptions are off by less.
MATTERS = 0.1


@dataclass(frozen=True)
class DescribedBodies(Check):
    """Load at the flange, counterbalance, and common scale of the torques, against the robot model."""

    stage: ClassVar[int] = 2

    def findings(self, subject: CheckedLog) -> Sequence[Finding]:
        trends = subject.trends
        theta = None if trends is None else trends.fit.model.nominal()
        if trends is None or theta is None:
            return []
        described = with_rotors(theta, trends.fit.model, subject.case.robot)
        if subject.known is not None and not subject.known.agrees(trends.fit.base.from_standard(described)):
            return []  # what the earlier estimate says of the bodies is what the torques are held against
        asked = asks_inertia(subject.case)
        against = Against(trends, theta, None if asked else subject.case.robot)
        explained, found = 0.0, []
        for blame in against.blames:
            explained += blame.gain
            found.append(blame)
        share = explained / max(against.excess, 1e-9)
        if share < ENOUGH:
            return []
        return [finding for blame in found for finding in _findings(blame, against) if believed(blame) is not None]


def _findings(blame: Blame, against: Against) -> list[Finding]:
    """Return what is said of a cause and of its rivals; of a wrong body nothing is, unless a load is its rival."""
    found = [] if blame.cause.name == "described body" else [_finding(blame, against)]
    loads = [rival for rival in blame.rivals if rival.cause.name == "load at the flange"]
    other = f"{blame.cause.name}" + f" ({blame.cause.joint})" * bool(blame.cause.joint)
    for finding in (_finding(load, against) for load in loads):
        told = f"not distinguishable from {other}: {finding.evidence}"
        found.append(replace(finding, severity="note", evidence=told))
    return [*found, *rival_findings(blame, against.fit)]


def _finding(blame: Blame, against: Against) -> Finding:
    if blame.cause.name != "load at the flange":
        return trend_finding(blame, against.fit)
    mass, deviation = against.load(blame)
    strongest = int(np.argmax(blame.torque))
    told = f"by {mass:+.3g} kg (+- {2 * deviation:.2g} kg)"
    if abs(mass) < 2 * deviation:  # moments are sure, the mass is not
        joint = against.fit.model.robot.joint_names[strongest]
        told = f"by {blame.torque[strongest]:.3g} N m (or N) rms at {joint}, its mass is not determined"
    evidence = f"the load at the flange differs from the robot model {told} (t = {blame.certainty:.0f})"
    remedy = "remove the payload or tool, or add it to the robot model; check the last link"
    bodies = np.sqrt(np.mean(against.bodies**2, axis=0))
    heavy = float(blame.torque.max()) > MATTERS * float(bodies.max()) and abs(mass) > 4 * deviation
    severity: Severity = "warning" if heavy else "note"
    numbers = {"mass_kg": mass, "std_kg": deviation, "t": blame.certainty}
    return Finding(severity, "load at the flange", "", evidence, remedy, numbers)
