"""A Monte Carlo benchmark as tables for the terminal and as one self-contained page.

Of real logs, a scoreboard: one table, published figures beside ours.
"""

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
from dynident.studies.benchmark.real_sets import Published, Scoreboard
from dynident.studies.benchmark.summary import MethodRow
from dynident.studies.comparison.comparison_view import percent

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


SCORES_NOTE = (
    "Error: |measured - predicted| / |measured|, all joints; held out: of unseen rows. RMSE: of those against the "
    "torque before any filter, joint by joint. Published figures stand beside ours with their source; rows, filters "
    "and models are their own."
)

#: A result with the name of its set and its method.
Result = tuple[str, str, Mapping[str, Any]]


def scoreboard_table(board: Scoreboard, results: Sequence[Result]) -> Table:
    """Return every set with our methods by their test error, then the published figures, then failures."""
    columns = columns_of(
        "set", "who", ">test error [%]", ">training error [%]", "RMSE by joint", "consistent", ">time [s]", "remark"
    )
    rows: list[tuple[str, ...]] = []
    for each in board.sets:
        own = [(method, result) for name, method, result in results if name == each.name]
        good = sorted((pair for pair in own if not pair[1].get("failure")), key=lambda pair: _figure(pair[1]))
        rows += [_ours(each.name, method, result) for method, result in good]
        rows += [_theirs(figure) for figure in board.published if figure.set == each.name and own]
        bad = [(method, result) for method, result in own if result.get("failure")]
        rows += [_broken(each.name, method, result) for method, result in bad]
    return Table(columns, tuple(rows), SCORES_NOTE)


def _figure(result: Mapping[str, Any]) -> float:
    for name in ("test_error", "training_error"):
        if result.get(name) is not None:
            return float(result[name])
    return float("inf")


def _percent(value: float | None) -> str:
    return MISSING if value is None else percent(value).removesuffix(" %")


def _ours(name: str, method: str, result: Mapping[str, Any]) -> tuple[str, ...]:
    joints = " ".join(
        MISSING if fit["rmse_unfiltered"] is None else format_number(fit["rmse_unfiltered"], 3)
        for fit in result.get("joints", ())
    )
    return (
        label(name),
        label(method),
        _percent(result.get("test_error")),
        _percent(result.get("training_error")),
        joints or MISSING,
        "yes" if result.get("physically_consistent") else "NO",
        format_number(float(result["seconds"]), 2),
        label(result["verdict"]) if result.get("verdict") else "",
    )


def _theirs(figure: Published) -> tuple[str, ...]:
    values = " ".join(format_number(value, 3) for value in figure.rmse_unfiltered)
    said = "; ".join(filter(None, [figure.source, figure.remark]))
    errors = (_percent(figure.test_error), _percent(figure.training_error))
    who = f"published: {label(figure.who)}"
    return label(figure.set), who, *errors, values or MISSING, MISSING, MISSING, label(said)


def _broken(name: str, method: str, result: Mapping[str, Any]) -> tuple[str, ...]:
    why = label(result["failure"])
    return (
        label(name),
        label(method),
        MISSING,
        MISSING,
        MISSING,
        MISSING,
        format_number(float(result["seconds"]), 2),
        why,
    )


def best_of_sets(board: Scoreboard, results: Sequence[Result]) -> list[str]:
    """Return a sentence a set: which method has the smallest test error, and how many are within 1 % of it."""
    said = []
    for each in board.sets:
        own = [(_figure(result), method) for name, method, result in results if name == each.name and _tested(result)]
        if own:
            best, method = min(own)
            near = sum(figure <= 1.01 * best for figure, _ in own) - 1
            beside = f", {near} more within 1 % of that" if near else ""
            said.append(f"{label(each.name)}: {label(method)} with {percent(best)}{beside}")
    return said


def _tested(result: Mapping[str, Any]) -> bool:
    return not result.get("failure") and result.get("test_error") is not None


def write_scoreboard_page(
    path: str | PathLike[str], board: Scoreboard, results: Sequence[Result], command: str = ""
) -> None:
    """Write the scoreboard as one HTML file that asks nothing of any network.

    Raises:
        FileError: The file cannot be written.
    """
    table = scoreboard_table(board, results)
    groups = []
    for each in board.sets:
        rows = tuple(row[1:] for row in table.rows if row[0] == label(each.name))
        if rows:
            groups.append((label(each.name), Table(table.columns[1:], rows)))
    context = {
        "source": "; ".join(best_of_sets(board, results)),
        "note": SCORES_NOTE,
        "command": command,
        "figures": [],
        "tables": groups,
        "failures": [],
    }
    lead = (counted(len(groups), "set"), counted(len(results), "result"))
    part = ReportPart("benchmark", "Real logs", "benchmark.html", context)
    write_atomically(path, build_page("Scoreboard", "real robots", lead, [part]))
