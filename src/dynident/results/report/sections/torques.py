"""Measured and predicted torques, on the data of the fit and on those held out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from dynident.results.figures import TorqueBands, torque_chart
from dynident.results.report.sections.base import ReportSection, drawn, left_out
from dynident.results.report.subject import MOST_DRAWN, Dataset, Subject
from dynident.results.text import Column, Table, format_number, format_percent, label, pretty_unit, statement

#: Bytes of all figures together that go into the numbers behind them; a value takes 8/3.
_BUDGET = 1_600_000

#: Values of a signal that show all that the figure of a usual log can.
_MOST = 12_000

#: Rows of numbers in a figure: time, three lines, two bands of two edges each.
_ROWS = 8


@dataclass(frozen=True)
class Torques(ReportSection):
    """A figure per joint and data set; the figures of a data set are zoomed together."""

    title: ClassVar = "Torques"
    template: ClassVar = "torques.html"

    def context(self, subject: Subject) -> dict[str, Any]:
        if not subject.datasets:
            return {}
        shown = subject.datasets[:MOST_DRAWN]
        figures = max(1, len(shown) * subject.estimate.model.robot.dof)
        detail = min(_MOST, int(_BUDGET / (8 / 3 * _ROWS * figures)))
        groups = [(dataset, _caption(dataset), _figures(dataset, detail), _bands(dataset)) for dataset in shown]
        return {"groups": groups, "left_out": left_out(subject)}


def _caption(dataset: Dataset) -> str:
    validation = dataset.validation
    several = "; a gap stands between two logs" if len(validation.logs) > 1 else ""
    error = format_percent(validation.total_relative_error)
    said = f"{dataset.logs}{several}. Total relative error {error}. Filter: {statement(validation.filter)}."
    return f"{said} {dataset.remark}".rstrip()


def _figures(dataset: Dataset, detail: int) -> list[str]:
    v, widths = dataset.validation, dataset.validation.half_widths()
    found = []
    for i, fit in enumerate(v.joints):
        bands = None if widths is None else TorqueBands(widths[0][:, i], widths[1][:, i])
        signals = v.time, v.measured[:, i], v.predicted[:, i]
        chart = torque_chart(fit.name, fit.unit, *signals, v.starts, bands, detail=detail)
        found.append(drawn(chart, "torque", dataset.name, fit.name))
    return found


def _bands(dataset: Dataset) -> Table | None:
    """Return how wide the bands are and how many rows lie inside; None where they are not known."""
    rows = tuple(
        (
            label(joint["name"]),
            format_number(joint["parameters"], 2),
            format_number(joint["whole"], 2),
            pretty_unit(joint["unit"]),
            format_percent(joint["inside"], sign=False),
        )
        for joint in dataset.validation.bands()
    )
    columns = (
        Column("joint"),
        Column("of the parameters", "±", numeric=True),
        Column("with the noise of the fit", "±", numeric=True),
        Column("unit"),
        Column("samples inside", "%", numeric=True),
    )
    return Table(columns, rows) if rows else None
