"""What the model leaves: figures of the residual, over speed and over frequency."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from markupsafe import Markup

from dynident.model.robot import Robot
from dynident.results.figures import line_chart, residual_chart
from dynident.results.figures.chart import WIDTH
from dynident.results.figures.residuals import spectrum, thinned
from dynident.results.report.sections.base import ReportSection, drawn, left_out
from dynident.results.report.subject import MOST_DRAWN, Dataset, Subject
from dynident.results.text import MISSING, Table, columns_of, format_number, format_to, label, pretty_unit

#: Share of the largest density below which a spectrum is not drawn: what a filter leaves of nothing.
_FAINT = 1e-4


@dataclass(frozen=True)
class Residuals(ReportSection):
    """Size, memory, dependence on speed and spectrum of the residual."""

    title: ClassVar = "Residuals"

    def context(self, subject: Subject) -> dict[str, Any]:
        robot = subject.estimate.model.robot
        groups = [
            (dataset, [*_over_speed(dataset, robot), *_spectra(dataset, robot)])
            for dataset in subject.datasets[:MOST_DRAWN]
        ]
        return {"table": _table(subject), "groups": groups, "left_out": left_out(subject)} if groups else {}


def _table(subject: Subject) -> Table:
    columns = columns_of(
        "data",
        "joint",
        "unit",
        ">mean",
        ">std",
        ">largest",
        ">at [s]",
        ">correlation of neighbours",
        ">correlation factor",
    )
    rows = []
    for dataset in subject.datasets:
        validation = dataset.validation
        for i, fit in enumerate(validation.joints):
            residual = validation.residual[:, i]
            top = int(np.argmax(np.abs(residual)))
            centred = residual - residual.mean()
            power = float(centred @ centred)
            known = power > 0 and not dataset.thinned
            memory = float(centred[1:] @ centred[:-1]) / power if known else float("nan")
            factor = MISSING if dataset.held_out else format_number(subject.estimate.correlation_factors[i], 3)
            sizes = _alike(residual.mean(), residual.std(), residual[top])
            when = f"{float(validation.time[top]):.2f}"
            numbers = (*sizes, when, MISSING if np.isnan(memory) else f"{memory:.2f}")
            rows.append((dataset.name, label(fit.name), pretty_unit(fit.unit), *numbers, factor))
    return Table(columns, tuple(rows))


def _alike(mean: float, deviation: float, largest: float) -> tuple[str, str, str]:
    """Return three figures of a residual, all with the decimals that give the deviation three digits."""
    shown = format_number(deviation, 3)
    if "e" in shown:
        return format_number(mean, 3), shown, format_number(largest, 3)
    place = -len(shown.partition(".")[2])
    return format_to(mean, place), shown, format_to(largest, place)


def _over_speed(dataset: Dataset, robot: Robot) -> list[Markup]:
    v = dataset.validation
    return [
        drawn(
            residual_chart(fit.name, fit.unit, _speed_unit(fit.unit), v.dq[:, i], v.residual[:, i]),
            *("residual-over-speed", dataset.name, fit.name),
        )
        for i, fit in enumerate(v.joints)
    ]


def _speed_unit(unit: str) -> str:
    return "rad/s" if unit == "N m" else "m/s"


def _spectra(dataset: Dataset, robot: Robot) -> list[Markup]:
    """Return a figure for the turning joints and one for the sliding ones."""
    v = dataset.validation
    if dataset.thinned:  # what is left out would come back as other frequencies
        return []
    frequency, density = thinned(*spectrum(v.residual, v.time, v.starts))
    if not len(frequency) or not np.all(density.max(axis=0) > 0):
        return []
    density = np.where(density < _FAINT * density.max(), np.nan, density)
    charts = []
    for unit in dict.fromkeys(robot.units):
        lines = [
            (name, frequency, density[:, i])
            for i, (name, u) in enumerate(zip(robot.joint_names, robot.units, strict=True))
            if u == unit
        ]
        heading = f"density [{pretty_unit(unit)}/√Hz]"
        chart = line_chart("Spectrum", lines, "frequency [Hz]", heading, log=(True, True), size=(WIDTH, 170.0))
        charts.append(drawn(chart, "residual-spectrum", dataset.name, "" if unit == "N m" else "forces"))
    return charts
