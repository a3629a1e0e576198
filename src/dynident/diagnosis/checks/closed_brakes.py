"""Pauses in which brakes hold the arm, and no drive does."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from dynident.arrays import Array
from dynident.data.preprocessing._closed_brakes import closed_brakes
from dynident.diagnosis.checks.base import Check, CheckedLog
from dynident.diagnosis.finding import Finding, brakes_closed
from dynident.model.friction import Motion

#: Share of a joint's largest torque that the robot model's weight asks for at least, where it states masses.
HELD = 0.1


@dataclass(frozen=True)
class ClosedBrakes(Check):
    """Spells in which all joints stand still and all torques are none, though the arm has weight."""

    stage: ClassVar[int] = 1

    def findings(self, subject: CheckedLog) -> Sequence[Finding]:
        fit = subject.thin
        spells = np.zeros((0, 2)) if fit is None else closed_brakes(fit.log)
        if fit is None or not len(spells):
            return []
        log, asked = fit.log, ""
        weight = _weight(subject, np.stack([log.q[np.searchsorted(log.time, start)] for start in spells.mean(axis=1)]))
        if weight is not None:
            share = weight / np.maximum(np.abs(np.asarray(log.torque)).max(axis=0), 1e-300)
            if share.max() < HELD:
                return []  # nothing to hold
            joint = subject.case.robot.active[int(np.argmax(share))]
            unit = "N" if joint.kind == "prismatic" else "N m"
            asked = f", where the robot model's weight asks for {weight[np.argmax(share)]:.3g} {unit} at {joint.name}"
        seconds, start = float(np.diff(spells, axis=1).sum()), log.time[0]
        evidence = (
            f"{seconds:.3g} of {log.duration:.4g} s {brakes_closed(spells - start)}: all joints stand still and all "
            f"torques are zero{asked}"
        )
        remedy = "fits, errors and alarms leave these samples out; where no brake was closed, look for the lost torques"
        numbers = {"share": seconds / log.duration, "spells": float(len(spells))}
        return [Finding("note", "brakes closed", "", evidence, remedy, numbers)]


def _weight(subject: CheckedLog, places: Array) -> Array | None:
    """Return the largest torque that the robot model asks of each joint at some places (k, n), (n,); None without."""
    fit = subject.thin
    theta = None if fit is None else fit.model.nominal()
    if fit is None or theta is None:
        return None
    bodies = np.where(np.arange(len(theta)) < fit.model.inertial_count, theta, 0.0)
    still = Motion(places, np.zeros_like(places), np.zeros_like(places))
    return np.abs(fit.model.torque(still, bodies)).max(axis=0)
