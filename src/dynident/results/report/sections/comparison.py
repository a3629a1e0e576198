"""Estimators side by side."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from dynident.results.report.sections.base import ReportSection
from dynident.results.report.subject import Subject
from dynident.results.text import comparison_table


@dataclass(frozen=True)
class ComparisonSection(ReportSection):
    """The table of the comparison, where there is one."""

    title: ClassVar = "Comparison of estimators"

    def context(self, subject: Subject) -> dict[str, Any]:
        if not subject.comparison.rows:
            return {}
        return {"table": comparison_table(subject.comparison.rows)}
