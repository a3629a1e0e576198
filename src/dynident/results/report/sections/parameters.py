"""Base parameters: what was identified, and how well each is known."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from dynident.errors import BadOption
from dynident.identification.estimate.estimate import Estimate
from dynident.results.figures import deviation_chart
from dynident.results.report.combinations import combination
from dynident.results.report.judgement import WELL_KNOWN
from dynident.results.report.sections.base import ReportSection, drawn
from dynident.results.report.subject import Subject
from dynident.results.short_answer import LOST
from dynident.results.text import Table, format_number, format_percent, parameters_table


@dataclass(frozen=True)
class Parameters(ReportSection):
    """The table of base parameters and a chart of the least known.

    Attributes:
        most: Bars in the chart.
    """

    most: int = 24

    title: ClassVar = "Base parameters"
    template: ClassVar = "parameters.html"

    def __post_init__(self) -> None:
        if self.most < 1:
            raise BadOption("most", self.most, "give 1 or more")

    def context(self, subject: Subject) -> dict[str, Any]:
        estimate = subject.estimate
        relative = estimate.relative_std
        order = np.argsort(-np.where(np.isnan(relative), np.inf, relative), kind="stable")[: self.most]
        chart = deviation_chart([estimate.base.names[k] for k in order], relative[order], limits=(WELL_KNOWN,))
        count = estimate.base.count
        return {
            "table": _table(estimate),
            "chart": drawn(chart, "relative-deviations") if count else "",
            "count": count,
            "standard": len(estimate.base.parameters),
            "inertial": estimate.inertial_base_parameters,
            "condition_number": format_number(estimate.condition_number, 3),
            "shown": len(order),
            "well": format_percent(WELL_KNOWN),
            "lost": format_percent(LOST),
        }


def _table(estimate: Estimate) -> Table:
    """Return the table of the terminal with the combinations as mathematics."""
    table, base = parameters_table(estimate), estimate.base
    rows = ((row[0], combination(base, k), *row[2:]) for k, row in enumerate(table.rows))
    return replace(table, rows=tuple(rows))
