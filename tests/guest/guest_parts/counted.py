"""How many parameters there are."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from dynident.results.report.sections import ReportSection
from dynident.results.report.subject import Subject


@dataclass(frozen=True)
class Counted(ReportSection):
    """The number of base parameters in one sentence."""

    title: ClassVar = "Counted by a guest"
    template: ClassVar = "counted.html"

    def context(self, subject: Subject) -> dict[str, Any]:
        return {"robot": subject.estimate.model.robot.name, "count": len(subject.estimate.beta)}
