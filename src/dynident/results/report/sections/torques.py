"""Measured and predicted torques, on the data of the fit and on those held out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from dynident.results.figures import torque_chart
from dynident.results.report.sections.base import Section, drawn, left_out
from dynident.results.report.subject import MOST_DRAWN, Dataset, Subject
from dynident.results.text import format_percent, statement


@dataclass(frozen=True)
class Torques(Section):
    """A figure per joint and data set."""

    title: ClassVar = "Torques"
    template: ClassVar = "torques.html"

    def context(self, subject: Subject) -> dict[str, Any]:
        if not subject.datasets:
            return {}
        groups = [(dataset, _caption(dataset), _figures(dataset)) for dataset in subject.datasets[:MOST_DRAWN]]
        return {"groups": groups, "left_out": left_out(subject)}


def _caption(dataset: Dataset) -> str:
    validation = dataset.validation
    several = "; a gap stands between two logs" if len(validation.logs) > 1 else ""
    error = format_percent(validation.total_relative_error)
    said = f"{dataset.logs}{several}. Total relative error {error}. Filter: {statement(validation.filter)}."
    return f"{said} {dataset.remark}".rstrip()


def _figures(dataset: Dataset) -> list[str]:
    v = dataset.validation
    return [
        drawn(torque_chart(fit.name, fit.unit, v.time, v.measured[:, i], v.predicted[:, i], v.starts))
        for i, fit in enumerate(v.joints)
    ]
