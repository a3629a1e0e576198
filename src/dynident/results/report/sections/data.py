"""Data and filter: the logs, what was done to them, and the files they come from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, ClassVar

import numpy as np

from dynident.results.report.sections.base import ReportSection
from dynident.results.report.subject import Dataset, Subject
from dynident.results.text import MISSING, Table, columns_of, format_number, in_words, label, plain_value, term


@dataclass(frozen=True)
class SourceFile:
    """A file of the fit or of a test: its name, rows, hash, and the steps from its rows to those of the figures."""

    use: str
    path: str
    rows: str
    sha256: str
    steps: tuple[str, ...]


@dataclass(frozen=True)
class DataSection(ReportSection):
    """Logs, filter and sources."""

    title: ClassVar = "Data and filter"

    def context(self, subject: Subject) -> dict[str, Any]:
        if not subject.datasets:
            return {}
        filters = {dataset.name: _facts(dataset.validation.filter) for dataset in subject.datasets}
        # The rate of the samples kept and the delay follow from the logs and change no figure by themselves.
        own = ("rate_hz", "delay_s")
        told = [{k: v for k, v in data.validation.filter.items() if k not in own} for data in subject.datasets]
        same = all(facts == told[0] for facts in told)
        return {
            "logs": _logs(subject),
            "filters": {"": next(iter(filters.values()))} if same else filters,
            "sources": _sources(subject),
            "units": in_words(asdict(subject.estimate.columns.units)),
        }


def _facts(filter: Mapping[str, Any]) -> list[tuple[str, str]]:
    return [(term(key), plain_value(value)) for key, value in filter.items() if value is not None]


def _logs(subject: Subject) -> Table:
    columns = columns_of("used for", "log", ">samples", ">duration [s]", ">rate [Hz]")
    return Table(columns, tuple(row for dataset in subject.datasets for row in _log_rows(dataset)))


def _log_rows(dataset: Dataset) -> list[tuple[str, ...]]:
    validation = dataset.validation
    rows = []
    for name, part in zip(validation.logs, dataset.rows, strict=True):
        time = validation.time[part]
        duration = float(time[-1] - time[0]) if len(time) > 1 else 0.0
        rate = 1.0 / float(np.median(np.diff(time))) if duration > 0 and not dataset.thinned else float("nan")
        alone = str(validation.samples) if len(validation.logs) == 1 else MISSING
        samples = alone if dataset.thinned else str(len(time))
        rows.append((dataset.name, label(name), samples, format_number(duration), format_number(rate)))
    return rows


def _sources(subject: Subject) -> list[SourceFile]:
    """Return the files of the fit (provenance ``logs``: a mapping as of :class:`Source` each) and of the tests."""
    fit = [entry for entry in subject.estimate.provenance.get("logs", ()) if isinstance(entry, Mapping)]
    used = [("Training", entry) for entry in fit] + [("Test", asdict(source)) for source in subject.sources]
    return [
        SourceFile(
            use,
            label(entry["path"]) if entry.get("path") else "simulated",
            plain_value(entry.get("rows") or None),
            plain_value(entry.get("sha256") or None),
            tuple(str(step) for step in entry.get("steps", ())),
        )
        for use, entry in used
    ]
