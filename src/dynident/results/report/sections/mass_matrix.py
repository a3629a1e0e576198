"""The mass matrix in the middle of the motion, with the deviation of each element."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from dynident.identification.uncertainty.propagation import mass_matrix
from dynident.results.report.sections.base import ReportSection
from dynident.results.report.subject import Subject
from dynident.results.text import Column, Table, format_given, format_value, label


@dataclass(frozen=True)
class MassMatrix(ReportSection):
    """M(q) at the mean posture of the fit."""

    title: ClassVar = "Mass matrix"

    def context(self, subject: Subject) -> dict[str, Any]:
        estimate = subject.estimate
        joints, posture = estimate.model.robot.active, estimate.middle
        value, deviations = mass_matrix(estimate, posture)
        names = [label(joint.name) for joint in joints]
        rows = tuple(
            (name, *(" ± ".join(format_value(float(v), float(s))) for v, s in zip(*row, strict=True)))
            for name, row in zip(names, zip(value, deviations, strict=True), strict=True)
        )
        said = ", ".join(
            f"{name} {format_given(float(f'{q:.3g}'))} {'rad' if joint.kind == 'revolute' else 'm'}"
            for name, joint, q in zip(names, joints, posture, strict=True)
        )
        return {
            "table": Table((Column("joint"), *(Column(name, numeric=True) for name in names)), rows),
            "posture": said,
        }
