"""What the motion does not tell."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from dynident.diagnosis.causes.quick_fit import ENOUGH
from dynident.diagnosis.checks.base import Check, CheckedLog
from dynident.diagnosis.finding import SHORT, Finding, Severity, listed
from dynident.model.reduction import triangle_of

#: Condition number with unit columns and weighted rows above which noise decides some parameters, and above which
#: they are not determined.
POOR, NONE = 1000.0, 1e7

#: Names of parameters that are told.
TOLD = 3

#: Multiple of the values that a fit needs at least that a log should have.
GOOD = 3.0


@dataclass(frozen=True)
class Excitation(Check):
    """Length of the log, condition number of the observation matrix and parameters that the motion does not excite."""

    stage: ClassVar[int] = 2

    def findings(self, subject: CheckedLog) -> Sequence[Finding]:
        fit = subject.pooled or subject.thin  # with rows that are cut off, as the motion is in them too
        if fit is None or not fit.has_rows_enough:
            return _short(subject)
        weights = 1.0 / np.sqrt(fit.plain.variances)
        size = fit.base.count
        parts = []
        for (own, triangle), weight in zip(fit.triangles, weights, strict=True):
            columns = triangle[: len(own), : len(own)]
            full = np.zeros((len(columns), size))
            full[:, own] = weight * columns
            parts.append(full)
        matrix = triangle_of(np.concatenate(parts))
        norms = np.linalg.norm(matrix, axis=0)
        _, values, directions = np.linalg.svd(matrix / np.where(norms > 0, norms, 1.0), full_matrices=False)
        condition = float(values[0] / max(values[-1], 1e-300))
        if condition <= POOR:
            return []
        weak = values < values[0] / POOR
        share = np.abs(directions[weak]).max(axis=0)
        names = ", ".join(fit.base.parameters[fit.base.independent[k]].name for k in np.argsort(-share)[:TOLD])
        told = f"{int(weak.sum())} poorly excited direction" + "s" * (int(weak.sum()) != 1)
        evidence = f"condition number {condition:.3g} ({told}), above all the base parameters of {names}"
        remedy = "record a motion that moves all joints fast and far at once (dynident excite)"
        resting = [name for name, moves in zip(fit.model.robot.joint_names, fit.moves, strict=True) if not moves]
        if resting:
            evidence += f"; nearly all samples of {listed(resting)} are at rest"
            remedy += ", or lock what rests (locked: in the case file)"
        name, grave = ("poor excitation", condition > NONE)
        return [Finding("error" if grave else "warning", name, "", evidence, remedy, {"condition": condition})]


def _short(subject: CheckedLog) -> list[Finding]:
    """Return that a log is too short for a fit; a note where it is held against an estimate, which needs no fit."""
    fit = subject.thin
    if fit is None:
        return []
    count, seconds, bandwidth = fit.base.count, subject.sound.log.duration, fit.how.filter.bandwidth() or 1.0
    evidence = (
        f"{seconds:.3g} s are too short for {count} base parameters: {fit.values:.0f} independent torque values in "
        f"motion below {bandwidth:.3g} Hz, where a fit needs more than {ENOUGH * count:.0f}"
    )
    needed = GOOD * ENOUGH * count / (2.0 * bandwidth * len(subject.sound.log.joints)) + 2.0 * fit.how.trim_s
    remedy = f"record at least {np.ceil(needed):.0f} s in which all joints move; other causes are looked for then"
    severity: Severity = "error" if fit.values < count else "warning"
    severity = "note" if subject.earlier is not None else severity
    numbers = {"seconds": seconds, "values": fit.values, "parameters": count, "needed_s": needed}
    return [Finding(severity, SHORT, "", evidence, remedy, numbers)]
