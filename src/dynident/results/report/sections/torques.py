"""Measured and predicted torques, on the data of the fit and on those held out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from dynident.results.figures import TorqueBands, TorqueSignals, torque_chart
from dynident.results.report.sections.base import Drawing, ReportSection, drawn, left_out
from dynident.results.report.subject import MOST_DRAWN, Dataset, Subject
from dynident.results.text import (
    Table,
    columns_of,
    format_number,
    format_percent,
    in_words,
    label,
    pretty_unit,
    rest_words,
)

#: Bytes of all figures together that go into the numbers behind them; a value takes 8/3.
_BUDGET = 1_000_000

#: Values of a signal that show all that the figure of a usual log can.
_MOST = 12_000

#: Rows of numbers in a figure: time, three lines, two bands.
_ROWS = 6


@dataclass(frozen=True)
class Torques(ReportSection):
    """A figure per joint with the data of the fit and the tests side by side; all are zoomed together."""

    title: ClassVar = "Torques"

    def context(self, subject: Subject) -> dict[str, Any]:
        shown = subject.datasets[:MOST_DRAWN]
        if not shown:
            return {}
        captions = [(dataset.name, _caption(dataset)) for dataset in shown]
        bands = [(dataset.name, table) for dataset in shown if (table := _bands(dataset))]
        return {"figures": _figures(shown), "captions": captions, "bands": bands, "left_out": left_out(subject)}


def _caption(dataset: Dataset) -> str:
    validation = dataset.validation
    several = "; a gap stands between two logs" if len(validation.logs) > 1 else ""
    error = format_percent(validation.total_relative_error)
    words = rest_words(validation)
    error += f", which {words}" if words else ""
    said = f"{dataset.logs}{several}. Total relative error {error}. Filter: {in_words(validation.filter)}."
    return f"{said} {dataset.remark}".rstrip()


def _figures(shown: Sequence[Dataset]) -> list[Drawing]:
    found = [dataset.validation for dataset in shown]
    time, measured, predicted = (
        np.concatenate([getattr(v, name) for v in found]) for name in ("time", "measured", "predicted")
    )
    first = np.cumsum([0, *(len(v.time) for v in found)])
    starts = tuple(int(start + row) for v, row in zip(found, first, strict=False) for start in v.starts)
    parts = tuple((dataset.name.lower(), dataset.held_out) for dataset in shown for _ in dataset.validation.starts)
    widths = [v.half_widths() or (np.full_like(v.measured, np.nan),) * 2 for v in found]
    narrow, wide = (np.concatenate([pair[k] for pair in widths]) for k in (0, 1))
    held = [v.held or (v.predicted,) * 2 for v in found]
    low, high = (np.concatenate([pair[k] for pair in held]) for k in (0, 1))
    is_held = any(v.held is not None for v in found)
    detail = min(_MOST, int(_BUDGET / (8 / 3 * _ROWS * len(found[0].joints))))
    charts = []
    for i, fit in enumerate(found[0].joints):
        bands = TorqueBands(narrow[:, i], wide[:, i]) if np.any(np.isfinite(wide[:, i])) else None
        signals = TorqueSignals(time, measured[:, i], predicted[:, i], starts, bands, parts)
        if is_held:
            signals = replace(signals, held=(low[:, i], high[:, i]))
        charts.append(drawn(torque_chart(fit.name, fit.unit, signals, detail), "torque", fit.name))
    return charts


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
    columns = columns_of(
        "joint", ">of the parameters [±]", ">with the noise of the fit [±]", "unit", ">samples inside [%]"
    )
    return Table(columns, rows) if rows else None
