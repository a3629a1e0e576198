"""An estimate as one text, as HTML of a notebook and as a pandas frame."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import Any

import numpy as np

from dynident.diagnosis.verdict import verdict_of
from dynident.diagnosis.warnings import warnings_of
from dynident.errors import BadArgument, MissingDependency
from dynident.identification.estimate.estimate import Estimate
from dynident.identification.estimate.validation import Validation
from dynident.identification.residuals.quantiles import student_share
from dynident.results.short_answer import error_lines, summary_lines
from dynident.results.table_width import wrap_text
from dynident.results.text import (
    Column,
    Table,
    columns_of,
    fits_table,
    format_number,
    format_value,
    heading_text,
    label,
    plain,
    pretty_unit,
    shorten,
)
from dynident.results.verdict import cause_lines, headline

#: Letters of a parameter's name that a text has room for.
NAME_WIDTH = 30

#: Letters of a line of text.
WIDTH = 80


def summary_text(estimate: Estimate, test: Validation | None = None) -> str:
    """Return an estimate as text of 80 columns: verdict, data, figures by joint, base parameters with t and p.

    Args:
        estimate: The estimate.
        test: Its figures on data that had no part in the fit.

    Raises:
        BadArgument: Something else in place of the figures.
    """
    if test is not None and not isinstance(test, Validation):
        step = "give a Validation: estimate.summary(di.validate(estimate, log))"
        raise BadArgument("test", f"{type(test).__name__} where a Validation is wanted", step)
    facts = [line for fact in _facts(estimate, test) for line in wrap_text(fact, WIDTH) or [fact]]
    lines = [*facts, ""]
    for title, validation in (("test data", test), ("training data", estimate.train)):
        if validation is not None:
            lines += [title, plain(_narrow(fits_table(validation))), ""]
    lines += ["base parameters (95 % interval)", plain(significance_table(estimate))]
    return "\n".join(lines)


def summary_html(estimate: Estimate) -> str:
    """Return an estimate as HTML for a notebook: verdict, figures by joint, base parameters folded away."""
    facts = "".join(f"<li>{escape(line)}</li>" for line in _facts(estimate, None))
    title = escape(label(estimate.model.robot.name))
    return (
        f"<div><b>dynident estimate: {title}</b><ul>{facts}</ul>{_html(_narrow(fits_table(estimate.train)))}"
        f"<details><summary>{estimate.base.count} base parameters</summary>"
        f"{_html(significance_table(estimate), [label(name) for name in estimate.base.names])}</details></div>"
    )


def to_frame(estimate: Estimate) -> Any:
    """Return the base parameters as a pandas frame, by name.

    Raises:
        MissingDependency: pandas is not installed.
    """
    try:
        import pandas
    except ModuleNotFoundError as error:
        raise MissingDependency("a data frame", "pandas", "pandas") from error
    half = estimate.half_widths()
    values = {
        "value": estimate.beta,
        "std": estimate.std,
        "t": t_statistics(estimate),
        "p": p_values(estimate),
        "lower": estimate.beta - half,
        "upper": estimate.beta + half,
        "unit": list(estimate.base.units),
    }
    return pandas.DataFrame(values, index=pandas.Index(list(estimate.base.names), name="parameter"))


def t_statistics(estimate: Estimate) -> np.ndarray:
    """Return value over standard deviation of each base parameter, shape (b,); infinite without deviation."""
    spread = estimate.std
    return np.divide(estimate.beta, spread, out=np.full(len(spread), np.inf), where=spread > 0)


def p_values(estimate: Estimate) -> np.ndarray:
    """Return the two-sided p-value of each base parameter against zero, shape (b,), by Student's t."""
    degrees = np.full(len(estimate.beta), np.inf) if estimate.degrees is None else np.asarray(estimate.degrees)
    return 2.0 * student_share(-np.abs(t_statistics(estimate)), degrees)


def significance_table(estimate: Estimate) -> Table:
    """Return the base parameters with standard deviation, t, p and interval, narrow enough for a terminal."""
    half = estimate.half_widths()
    rows = []
    for k, (name, unit) in enumerate(zip(estimate.base.names, estimate.base.units, strict=True)):
        value, spread = format_value(float(estimate.beta[k]), float(estimate.std[k]))
        t, p = float(t_statistics(estimate)[k]), float(p_values(estimate)[k])
        low, high = (format_number(float(estimate.beta[k] + sign * half[k]), 3) for sign in (-1, 1))
        shown = shorten(label(name), NAME_WIDTH)
        rows.append((shown, value, spread, f"{t:.1f}", f"{p:.3f}", low, high, pretty_unit(unit)))
    heads = ("value", "std", "t", "P>|t|", "lower", "upper")
    columns = columns_of("parameter", *(Column(head, numeric=True) for head in heads), "unit")
    return Table(columns, tuple(rows))


def _facts(estimate: Estimate, test: Validation | None) -> list[str]:
    verdict = verdict_of(estimate, test)
    missing = "no test log: name one with --test, the training error is optimistic"
    step = "no test log, the training error is optimistic: estimate.summary(di.validate(estimate, log))"
    first = [step if line == missing else line for line in error_lines(estimate, test)]
    known = [headline(verdict)] if headline(verdict) else []
    causes = list(cause_lines(verdict))
    if causes and "case" not in estimate.provenance:
        causes.append(
            "keys in these remedies are those of a case file; without one change the arrays or the robot, and call "
            "identify again"
        )
    warnings = () if causes else warnings_of(estimate, test)
    return [*known, *causes, *first, *summary_lines(estimate, test), *(f"warning: {text}" for text in warnings)]


def _narrow(table: Table) -> Table:
    """Return a table without the columns that a narrow terminal goes without."""
    kept = [k for k, column in enumerate(table.columns) if not column.detail]
    return Table(tuple(table.columns[k] for k in kept), tuple(tuple(row[k] for k in kept) for row in table.rows))


def _html(table: Table, names: Sequence[str] = ()) -> str:
    """Return a table as HTML; the whole names of its rows show where the pointer is on a row."""
    heads = "".join(f"<th>{escape(heading_text(column))}</th>" for column in table.columns)
    titles = [f' title="{escape(name)}"' for name in names] or [""] * len(table.rows)
    cells = ["".join(f"<td>{escape(cell)}</td>" for cell in row) for row in table.rows]
    rows = "".join(f"<tr{title}>{own}</tr>" for title, own in zip(titles, cells, strict=True))
    return f"<table><thead><tr>{heads}</tr></thead><tbody>{rows}</tbody></table>"
