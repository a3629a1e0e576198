"""What was found from the logs before the fit: cut-off, delays, friction parts, non-linear fields."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, ClassVar

from dynident.results.choices import choice_tables, cutoff_table
from dynident.results.report.combinations import combination
from dynident.results.report.sections.base import ReportSection
from dynident.results.report.subject import Subject
from dynident.results.text import Table


@dataclass(frozen=True)
class ChoicesSection(ReportSection):
    """Cut-off, delays, the friction of each joint, fields of friction parts; left out where nothing was tried."""

    title: ClassVar = "Model selection"

    def context(self, subject: Subject) -> dict[str, Any]:
        choices, cutoff = subject.estimate.choices, _cutoff(subject)
        reason = "" if choices.cutoff_choice is None else choices.cutoff_choice.reason
        tables = choice_tables(choices, subject.estimate.model)
        return {"tables": tables, "reason": reason, "cutoff": cutoff} if tables or reason or cutoff else {}


def _cutoff(subject: Subject) -> Table | None:
    """Return the table of the cut-off with base parameters as mathematics."""
    table, base = cutoff_table(subject.estimate.choices), subject.estimate.base
    if table is None:
        return None
    rows = (
        (*row[:2], combination(base, base.names.index(row[2])) if row[2] in base.names else row[2], row[3])
        for row in table.rows
    )
    return replace(table, rows=tuple(rows))
