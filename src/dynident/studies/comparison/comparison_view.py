"""The table of a comparison: what each estimator came to, for the terminal and for the report."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from dynident.identification.estimate.validation import Validation
from dynident.identification.search.box_search import SearchRun
from dynident.results.report.subject import Comparison
from dynident.results.text import format_number
from dynident.studies.comparison.contest import Outcome, like_the_best

#: Of a search, what its convergence trace shows.
_OBJECTIVES = {"l1": "F (9) [N m]", "l2": "mean squared error [N² m²]"}

#: Short words for what a method counts.
_COUNTED = {"iterations": "iter.", "simulations": "sim.", "evaluations": "eval."}


def comparison_rows(outcomes: Sequence[Outcome]) -> tuple[dict[str, Any], ...]:
    """Return a line of the table for each outcome, in their order; columns that nobody has are left out."""
    tested = any(outcome.test is not None for outcome in outcomes)
    known = any(outcome.parameter_error is not None for outcome in outcomes)
    best = min(outcomes, key=lambda outcome: outcome.figure, default=None)
    return tuple(_row(outcome, best.test if best and tested else None, known) for outcome in outcomes)


def comparison_of(outcomes: Sequence[Outcome]) -> Comparison:
    """Return the comparison as a report shows it: the table, and the traces of searches with the same objective."""
    runs = [(outcome.method, outcome.estimate.run) for outcome in outcomes if outcome.estimate is not None]
    searches = [(method, run) for method, run in runs if isinstance(run, SearchRun)]
    norms = [run.settings["norm"] for _, run in searches]
    shown = [(method, run) for method, run in searches if run.settings["norm"] == norms[0]]
    optima = [run.optimum for _, run in shown if run.optimum is not None]
    same = bool(optima) and float(np.ptp(optima)) <= 1e-6 * max(optima)
    return Comparison(
        rows=comparison_rows(outcomes),
        traces={method: run.trace or () for method, run in shown},
        optimum=min(optima) if same else None,
        objective=_OBJECTIVES.get(norms[0], "objective") if norms else "objective",
    )


def _row(outcome: Outcome, best: Validation | None, known: bool) -> dict[str, Any]:
    estimate, test = outcome.estimate, outcome.test
    found = estimate is not None
    row: dict[str, Any] = {"method": outcome.method}
    if best is not None:
        row["test error"] = percent(test.total_relative_error) if test is not None else None
        row["as the best"] = ("yes" if like_the_best(test, best) else "no") if test is not None else None
    row["training error"] = percent(estimate.train.total_relative_error) if found else None
    row["above wls"] = percent(outcome.above) if np.isfinite(outcome.above) else None
    if known:
        row["parameter error"] = percent(outcome.parameter_error) if outcome.parameter_error is not None else None
    row["consistent"] = ("yes" if estimate.consistency.consistent else "NO") if found else None
    row["worst"] = outcome.worst or None
    row["work"] = ", ".join(f"{count} {_COUNTED[name]}" for name, count in outcome.effort.items()) or None
    row["time [s]"] = format_number(outcome.seconds, 2)
    if not found:
        row["remark"] = f"failed: {outcome.failure}"
    elif outcome.verdict:
        row["remark"] = outcome.verdict
    return row


def percent(fraction: float) -> str:
    """Return a fraction in percent with four digits, so that near ones are told apart; no finer than a thousandth."""
    figure = 100.0 * fraction
    if not np.isfinite(figure) or figure >= 999.5:
        return ">999 %"
    if 0 < figure < 5e-4:
        return "<0.001 %"
    return f"{format_number(figure, 4 if figure >= 0.1 else 2)} %"
