"""The identified model along the motion of a log in simulation: what was run, and the largest position errors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from dynident.results.model_export_view import condition_line, followed_line, not_run_lines, runs_table
from dynident.results.report.sections.base import ReportSection
from dynident.results.report.subject import Subject


@dataclass(frozen=True)
class Simulation(ReportSection):
    """Runs of the model under computed torque and PD; nothing where nothing was simulated."""

    title: ClassVar = "Simulation along the motion of a log"

    def context(self, subject: Subject) -> dict[str, Any]:
        if subject.motion is None:
            return {}
        return {
            "motion": followed_line(subject.motion),
            "runs": runs_table(subject.motion),
            "lines": [*not_run_lines(subject.motion), condition_line(subject.motion)],
        }
