"""Convergence of estimators that search."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from dynident.results.figures import convergence_chart
from dynident.results.report.sections.base import ReportSection, drawn
from dynident.results.report.subject import Subject
from dynident.results.text import Table, columns_of, format_number, format_percent, label


@dataclass(frozen=True)
class Convergence(ReportSection):
    """The objective per iteration: the estimate's ``extras`` (``trace``, ``optimum``) and the comparison's traces."""

    title: ClassVar = "Convergence"

    def context(self, subject: Subject) -> dict[str, Any]:
        traces, optimum = traces_of(subject)
        if not traces:
            return {}
        return {
            "chart": drawn(convergence_chart(traces, optimum, subject.comparison.objective), "convergence"),
            "table": _ends(traces, optimum),
            "optimum": "" if optimum is None else format_number(optimum, 6),
        }


def traces_of(subject: Subject) -> tuple[dict[str, Sequence[float]], float | None]:
    """Return the objective after each iteration by name of the search, and the optimum where it is known."""
    run, comparison = subject.estimate.run, subject.comparison
    traces = {name: trace for name, trace in comparison.traces.items() if _is_trace(trace)}
    if run.trace is not None and _is_trace(run.trace):
        traces.setdefault(subject.estimate.estimator, run.trace)
    return traces, comparison.optimum if comparison.optimum is not None else run.optimum


def _is_trace(found: Sequence[float | None] | None) -> bool:
    """Say whether there is a trace whose numbers are all finite; files have null for others."""
    return bool(found) and all(value is not None and np.isfinite(value) for value in found or ())


def _ends(traces: dict[str, Sequence[float]], optimum: float | None) -> Table:
    columns = columns_of("estimator", ">iterations", ">first", ">last", ">above the optimum [%]")
    rows = []
    for name, trace in traces.items():
        gap = (float(trace[-1]) - optimum) / abs(optimum) if optimum else float("nan")
        ends = (format_number(float(trace[0]), 6), format_number(float(trace[-1]), 6))
        rows.append((label(name), str(len(trace)), *ends, format_percent(gap, sign=False)))
    return Table(columns, tuple(rows))
