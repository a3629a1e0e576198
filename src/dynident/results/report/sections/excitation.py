"""The designed motion: curves with their limits, path and surroundings, check, criteria, expected deviations."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from dynident.results.report.plan_context import plan_context
from dynident.results.report.sections.base import ReportSection
from dynident.results.report.subject import Subject


@dataclass(frozen=True)
class ExcitationSection(ReportSection):
    """A plan, where the report has one."""

    title: ClassVar = "Excitation"

    def context(self, subject: Subject) -> dict[str, Any]:
        return {} if subject.plan is None else plan_context(subject.plan)
