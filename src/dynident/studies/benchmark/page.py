"""A Monte Carlo benchmark as tables for the terminal and as one self-contained page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from os import PathLike
from typing import Any

import numpy as np

from dynident.files import write_atomically
from dynident.results.figures import line_chart
from dynident.results.report.builder import ReportPart, build_page
from dynident.results.report.sections.base import drawn
from dynident.results.text import (
    MISSING,
    Table,
    columns_of,
    counted,
    format_number,
    format_percent,
    label,
    shorten,
)
from dynident.studies.benchmark.experiment import Experiment
from dynident.studies.benchmark.summary import MethodRow

NOTE = (
    "Medians over the draws. Parameters: |found - true| / |true|; weighted: each in units of its column's norm. "
    "Torque: the same of torques on another motion, without noise. Coverage: 95 % intervals that hold the truth."
)

#: Longest reason of a failure in a table.
_WHY = 90


def condition_name(row: MethodRow, experiment: Experiment) -> str:
    """Return a condition in words."""
    level = next((level for level in experiment.noise if level.name == row.noise), None)
    noise = "" if level is None else f" ({level.position:g} rad, {level.torque:g} N m)"
    return f"{label(row.robot)}, noise {label(row.noise)}{noise}, {row.rate:g} Hz"


def by_condition(rows: Sequence[MethodRow], experiment: Experiment) -> dict[str, list[MethodRow]]:
    """Return the rows of each condition, by its name in words."""
    found: dict[str, list[MethodRow]] = {}
    for row in rows:
        found.setdefault(condition_name(row, experiment), []).append(row)
    return found


def condition_table(rows: Sequence[MethodRow]) -> Table:
    """Return the methods of one condition, the best first."""
    columns = columns_of(
        "method",
        ">draws",
        ">failed",
        ">parameters [%]",
        ">weighted [%]",
        ">torque [%]",
        ">torque, 90th [%]",
        ">consistent [%]",
        ">coverage [%]",
        ">iterations",
        ">simulations",
        ">time [s]",
    )
    return Table(columns, tuple(_cells(row) for row in rows), NOTE)


def _cells(row: MethodRow) -> tuple[str, ...]:
    def share(value: float) -> str:
        return format_percent(value, sign=False)

    def count(value: float) -> str:
        return f"{value:.4g}" if np.isfinite(value) else MISSING

    return (
        label(row.method),
        str(row.draws),
        str(row.failures),
        share(row.medians["parameter_distance"]),
        share(row.medians["weighted_distance"]),
        share(row.medians["torque_distance"]),
        share(row.tails["torque_distance"]),
        share(row.consistent),
        share(row.coverage),
        count(row.means["iterations"]),
        count(row.means["simulations"]),
        format_number(row.medians["seconds"], 2),
    )


def failure_lines(rows: Sequence[MethodRow]) -> list[str]:
    """Return why methods failed, the most frequent reason of each."""
    said = {}
    for row in rows:
        if row.failures:
            said.setdefault((row.method, row.why), 0)
            said[row.method, row.why] += row.failures
    return [
        f"{label(method)} failed {counted(count, 'time')}: {shorten(label(why), _WHY)}"
        for (method, why), count in said.items()
    ]


def write_benchmark_page(
    path: str | PathLike[str], experiment: Experiment, rows: Sequence[MethodRow], command: str = ""
) -> None:
    """Write the benchmark as one HTML file that asks nothing of any network.

    Raises:
        FileError: The file cannot be written.
    """
    groups = by_condition(rows, experiment)
    context = {
        "source": experiment.source,
        "note": NOTE,
        "command": command,
        "figures": [*_noise_figures(experiment, rows)],
        "tables": [(name, condition_table(found)) for name, found in groups.items()],
        "failures": failure_lines(rows),
    }
    counts = {"draw": experiment.draws, "condition": len(groups), "method": len(experiment.entrants)}
    lead = tuple(counted(count, word) for word, count in counts.items())
    parts = [ReportPart("benchmark", label(experiment.title), "benchmark.html", context)]
    write_atomically(path, build_page("Benchmark", ", ".join(experiment.models), lead, parts))


def _noise_figures(experiment: Experiment, rows: Sequence[MethodRow]) -> list[Any]:
    """Draw the distance of torques over the noise of the encoders, for each robot, rate and torque noise."""
    levels = {level.name: level for level in experiment.noise}
    figures = []
    for robot in experiment.models:
        for torque in sorted({level.torque for level in experiment.noise}):
            for rate in experiment.rates:
                own = [r for r in rows if r.robot == robot and r.rate == rate and levels[r.noise].torque == torque]
                lines = _lines(own, levels)
                if lines:
                    title = f"{label(robot)}, {rate:g} Hz, torque noise {torque:g} N m"
                    drawing = line_chart(
                        title, lines, "noise of the encoders [rad]", "torque distance [%]", log=(True, True)
                    )
                    figures.append(drawn(drawing, "benchmark", robot, f"{rate:g}", f"{torque:g}"))
    return figures


def _lines(rows: Sequence[MethodRow], levels: Mapping[str, Any]) -> list[tuple[str, np.ndarray, np.ndarray]]:
    """Return a line a method with two points or more, both axes above zero."""
    found = []
    for method in dict.fromkeys(row.method for row in rows):
        points = sorted(
            (levels[row.noise].position, 100.0 * row.medians["torque_distance"])
            for row in rows
            if row.method == method and levels[row.noise].position > 0 and row.medians["torque_distance"] > 0
        )
        if len(points) > 1:
            found.append((method, np.array([p[0] for p in points]), np.array([p[1] for p in points])))
    return found
