"""The scoreboard on real logs: one table, published figures beside ours."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from os import PathLike
from typing import Any

from dynident.files import write_atomically
from dynident.results.report.builder import ReportPart, build_page
from dynident.results.text import MISSING, Table, columns_of, counted, format_number, label
from dynident.studies.benchmark.real_sets import Published, Scoreboard
from dynident.studies.comparison.comparison_view import percent

NOTE = (
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
    return Table(columns, tuple(rows), NOTE)


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
        "note": NOTE,
        "command": command,
        "figures": [],
        "tables": groups,
        "failures": [],
    }
    lead = (counted(len(groups), "set"), counted(len(results), "result"))
    part = ReportPart("benchmark", "Real logs", "benchmark.html", context)
    write_atomically(path, build_page("Scoreboard", "real robots", lead, [part]))
