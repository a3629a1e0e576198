"""The table of figures: joint by joint, all rows and rows in motion, with the filter beside them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from dynident.results.report.sections.base import ReportSection
from dynident.results.report.subject import Dataset, Subject
from dynident.results.text import Table, fits_table, format_number, rest_table, rest_words, total_error


@dataclass(frozen=True)
class Figures:
    """The tables of one data set."""

    dataset: Dataset
    error: str
    counted: str
    standstill: str
    all_rows: Table
    moving: Table
    at_rest: Table | None


@dataclass(frozen=True)
class ValidationSection(ReportSection):
    """Errors and correlations of each joint."""

    title: ClassVar = "Validation"

    def context(self, subject: Subject) -> dict[str, Any]:
        found = [
            Figures(
                dataset,
                total_error(dataset.validation),
                rest_words(dataset.validation),
                format_number(dataset.validation.standstill, 2),
                fits_table(dataset.validation),
                fits_table(dataset.validation, moving=True),
                rest_table(dataset.validation),
            )
            for dataset in subject.datasets
        ]
        return {"found": found} if found else {}
