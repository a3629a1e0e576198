"""The robot model's own parameters beside the identified ones: torque errors, and the bodies link by link."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from dynident.results.nominal import bodies_table, errors_table, link_changes, links_table, missing_reason
from dynident.results.plausibility import plausibility_lines
from dynident.results.report.sections.base import ReportSection
from dynident.results.report.subject import Subject


@dataclass(frozen=True)
class Nominal(ReportSection):
    """Errors of the nominal parameters on the same samples, and masses, centres and inertias side by side."""

    title: ClassVar = "Nominal and identified parameters"

    def context(self, subject: Subject) -> dict[str, Any]:
        changes = link_changes(subject.estimate)
        compared = [each for each in subject.datasets if each.validation.nominal is not None]
        if not (compared or changes) and subject.estimate.model.robot.nominal is not None:
            return {}
        return {
            "errors": [(each, errors_table(each.validation)) for each in compared],
            "links": links_table(changes) if changes else None,
            "bodies": bodies_table(changes) if changes else None,
            "reason": missing_reason(subject.estimate),
            "plausibility": plausibility_lines(
                subject.estimate, subject.held_out[0].validation if subject.held_out else None
            ),
        }
