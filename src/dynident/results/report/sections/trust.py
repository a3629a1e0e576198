"""How far to trust the estimate: tests of the residual, influence, bias, cross-validation, extrapolation."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from dynident.results.report.sections.base import ReportSection
from dynident.results.report.subject import Subject
from dynident.results.text import MISSING, Table, columns_of, format_number, format_percent, label


@dataclass(frozen=True)
class Trust(ReportSection):
    """What the diagnostics say; left out where none were made and no log leaves what the fit has seen."""

    title: ClassVar = "Diagnostics"

    def context(self, subject: Subject) -> dict[str, Any]:
        estimate = subject.estimate
        found, envelope = estimate.diagnostics, estimate.envelope
        departures = [test.departure for test in subject.tests if test.departure is not None]
        leaving = [] if envelope is None else [departure.sentence(envelope) for departure in departures]
        sentences = [*(found["verdicts"] if found else ()), *filter(None, leaving)]
        if not sentences:
            return {}
        tables = [] if found is None else [_joints(found), _parts(found), *map(_folds, found["cross_validation"])]
        return {"sentences": [label(sentence) for sentence in sentences], "tables": tables}


def _joints(found: Mapping[str, Any]) -> tuple[str, Table]:
    columns = columns_of("joint", ">whiteness: p-value", ">constant variance: p-value")
    rows = tuple(
        (label(joint["name"]), *(format_number(joint[key], 2) for key in ("whiteness_p", "constant_variance_p")))
        for joint in found["joints"]
    )
    return "Residual tests by joint", Table(columns, rows)


def _parts(found: Mapping[str, Any]) -> tuple[str, Table]:
    columns = columns_of("part of the logs", ">leverage [%]", ">Cook's distance")
    rows = tuple(
        (f"{k} of {len(found['parts'])}", format_number(100 * part["leverage"], 2), _number(part["cook"]))
        for k, part in enumerate(found["parts"], start=1)
    )
    return "Influence of parts of the logs", Table(columns, rows)


def _folds(found: Mapping[str, Any]) -> tuple[str, Table]:
    columns = columns_of("left out", ">samples", ">relative error")
    rows = tuple((label(fold["name"]), str(fold["rows"]), _share(fold["relative_error"])) for fold in found["folds"])
    return f"Cross-validation over {found['over']} ({found['estimator']})", Table(columns, rows)


def _number(value: float | None) -> str:
    return MISSING if value is None else format_number(value, 2)


def _share(value: float | None) -> str:
    return MISSING if value is None else format_percent(value)
