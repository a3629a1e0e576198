"""Base parameters: what was identified, and how well each is known."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from dynident.identification.estimate.estimate import Estimate
from dynident.results.figures import Intervals, interval_chart
from dynident.results.report.combinations import combination
from dynident.results.report.sections.base import Drawing, ReportSection, drawn
from dynident.results.report.subject import Subject
from dynident.results.short_answer import not_significant
from dynident.results.text import Table, format_number, parameters_table, pretty_unit


@dataclass(frozen=True)
class Parameters(ReportSection):
    """The values with their intervals as a chart for each unit, and as a table."""

    title: ClassVar = "Base parameters"

    def context(self, subject: Subject) -> dict[str, Any]:
        estimate = subject.estimate
        return {
            "table": _table(estimate),
            "charts": [_chart(estimate, unit) for unit in dict.fromkeys(estimate.base.units)],
            "count": estimate.base.count,
            "significant": estimate.base.count - len(not_significant(estimate)),
            "standard": len(estimate.base.parameters),
            "inertial": estimate.inertial_base_parameters,
            "condition_number": format_number(estimate.condition_number, 3),
        }


def _chart(estimate: Estimate, unit: str) -> Drawing:
    """Draw the values of a unit with their 95 % intervals, the largest first."""
    own = np.array([each == unit for each in estimate.base.units])
    order = [k for k in np.argsort(-np.abs(estimate.beta), kind="stable") if own[k]]
    names = tuple(estimate.base.names[k] for k in order)
    found = Intervals(names, estimate.beta[order], estimate.half_widths()[order])
    shown = pretty_unit(unit)
    title = "Without unit" if shown == "1" else f"In {shown}"
    return drawn(interval_chart(title, shown, found), "base-parameters", unit)


def _table(estimate: Estimate) -> Table:
    """Return the table of the terminal with the combinations as mathematics."""
    table, base = parameters_table(estimate), estimate.base
    rows = ((row[0], combination(base, k), *row[2:]) for k, row in enumerate(table.rows))
    return replace(table, rows=tuple(rows))
