"""Standard parameters link by link: mass, centre of mass, inertia, and which of them the data can tell."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from dynident.arrays import Array
from dynident.identification.consistency.labels import labels_of
from dynident.identification.estimate.plausibility import Plausibility
from dynident.model.inertia import TEN, Inertia
from dynident.model.parameters import TEN_UNITS
from dynident.results.nominal import SIGNS
from dynident.results.plausibility import range_end
from dynident.results.report.sections.base import ReportSection
from dynident.results.report.subject import Subject
from dynident.results.text import Column, columns_of, format_number, format_value, label, line_up, pretty_unit

_RANK = list(SIGNS)

#: Of the largest number of its kind: solvers of the conditions find zeros to about a hundred-millionth.
_ROUNDING = 1e-6
_CENTRE = ((6, 9), (7, 9), (8, 9))  # of TEN, what the centre of mass is made of
_INERTIA = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))


@dataclass(frozen=True)
class JudgedBody:
    """A number with the verdict on it."""

    text: str
    sign: str
    verdict: str


@dataclass(frozen=True)
class JudgedTable:
    """Numbers with verdicts, a row for each link.

    Attributes:
        columns: Headings of the numbers.
        rows: Name of the link, its numbers, and a remark.
    """

    columns: tuple[Column, ...]
    rows: tuple[tuple[str, tuple[JudgedBody, ...], str], ...]


@dataclass(frozen=True)
class Bodies(ReportSection):
    """Standard parameters, where the estimator found some."""

    title: ClassVar = "Standard parameters of the links"

    def context(self, subject: Subject) -> dict[str, Any]:
        estimate = subject.estimate
        if estimate.theta is None:
            return {}
        links = estimate.model.robot.links
        names = [label(link.name) for link in links]
        theta = np.asarray(estimate.theta)[: 10 * len(links)].reshape(-1, 10)
        words = [label.word for label in labels_of(estimate)]
        verdicts = [words[10 * i : 10 * i + 10] for i in range(len(links))]
        return {
            "bodies": _bodies(names, theta, verdicts),
            "ten": _ten(names, theta, verdicts, estimate.standard_deviations),
            "known": estimate.standard_deviations is not None,
            "ranges": _ranges(names, Plausibility.of(estimate.run), verdicts),
            "signs": [(sign, verdict) for verdict, sign in SIGNS.items()],
        }


def _bodies(names: Sequence[str], theta: Array, verdicts: Sequence[Sequence[str]]) -> JudgedTable:
    """Return mass, centre of mass and inertia about it; a value is judged by the worst of what it is made of."""
    columns = columns_of(
        "mass [kg]",
        *(Column(f"centre {axis}" if axis == "x" else axis, "m") for axis in "xyz"),
        *(f"I{pair} [kg·m²]" for pair in ("xx", "yy", "zz", "xy", "xz", "yz")),
    )
    values, worst, remarks = [], [], []
    for row, verdict in zip(theta, verdicts, strict=True):
        inertia = Inertia.from_vector(row)
        about = inertia.about_centre
        products = [about[i, j] for i, j in _INERTIA]
        size = np.sqrt(max(np.trace(about), 0.0) / inertia.mass) if inertia.mass > 0 else 0.0
        values.append([inertia.mass, *_rounded(inertia.centre_of_mass, size), *_rounded(np.array(products))])
        whole = _worst(verdict)
        centre = [_worst([verdict[k] for k in parts]) for parts in _CENTRE]
        worst.append([verdict[9], *centre, *[whole] * len(_INERTIA)])
        defect = inertia.defect()
        remarks.append(f"no: {defect}" if defect else "yes")
    return JudgedTable(columns, _judged(names, np.array(values), worst, remarks))


def _ten(
    names: Sequence[str], theta: Array, verdicts: Sequence[Sequence[str]], deviations: Array | None
) -> JudgedTable:
    """Return the ten of each link, with their deviations where they are known."""
    columns = tuple(Column(symbol, pretty_unit(unit)) for symbol, unit in zip(TEN, TEN_UNITS, strict=True))
    sizes = [np.sqrt(max(row[9] * np.sum(row[[0, 3, 5]]), 0.0)) for row in theta]
    moments = zip(theta, sizes, strict=True)
    whole = [np.concatenate([_rounded(row[:6]), _rounded(row[6:9], size), row[9:]]) for row, size in moments]
    table = _judged(names, np.array(whole), verdicts, [""] * len(names))
    if deviations is not None:
        table = _with_deviations(table, np.array(whole), deviations[: theta.size].reshape(theta.shape))
    return JudgedTable(columns, table)


def _ranges(names: Sequence[str], facts: Plausibility | None, verdicts: Sequence[Sequence[str]]) -> JudgedTable | None:
    """Return the range of the ten of each link that data and bounds allow; None where none was asked for."""
    if facts is None or not facts.ranges:
        return None
    columns = tuple(Column(symbol, pretty_unit(unit)) for symbol, unit in zip(TEN, TEN_UNITS, strict=True))
    texts = [" to ".join(range_end(end) for end in span) for span in facts.ranges]
    rows = tuple(
        (name, tuple(JudgedBody(texts[10 * i + k], SIGNS[v], v) for k, v in enumerate(verdicts[i])), "")
        for i, name in enumerate(names)
    )
    return JudgedTable(columns, rows)


def _with_deviations(
    rows: tuple[tuple[str, tuple[JudgedBody, ...], str], ...], values: Array, deviations: Array
) -> tuple[tuple[str, tuple[JudgedBody, ...], str], ...]:
    """Return rows whose cells say value and deviation with the digits that the deviation allows."""
    return tuple(
        (
            name,
            tuple(
                replace(cell, text=" ± ".join(format_value(float(v), float(s))) if s > 0 else cell.text)
                for cell, v, s in zip(cells, value, spread, strict=True)
            ),
            remark,
        )
        for (name, cells, remark), value, spread in zip(rows, values, deviations, strict=True)
    )


def _rounded(values: Array, size: float = 0.0) -> Array:
    """Return values of one kind and link with zeros for what is only rounding beside the largest, or beside a size."""
    return np.where(np.abs(values) < _ROUNDING * max(np.max(np.abs(values)), size), 0.0, values)


def _worst(verdicts: Sequence[str]) -> str:
    return max(verdicts, key=_RANK.index)


def _judged(
    names: Sequence[str], values: Array, verdicts: Sequence[Sequence[str]], remarks: Sequence[str]
) -> tuple[tuple[str, tuple[JudgedBody, ...], str], ...]:
    texts = [line_up([format_number(float(v), 4) for v in column], "\u2007", "\u2008") for column in values.T]
    return tuple(
        (name, tuple(JudgedBody(texts[k][i], SIGNS[v], v) for k, v in enumerate(verdicts[i])), remarks[i])
        for i, name in enumerate(names)
    )
