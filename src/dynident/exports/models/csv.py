"""CSV: tables of base and standard parameters."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

from dynident.arrays import Array
from dynident.exports.models.base import ModelContent, ModelExporter, Reloaded
from dynident.exports.models.subject.identified import NONE, Identified
from dynident.exports.models.subject.states import StateSet
from dynident.exports.models.writing.document import base_torque
from dynident.exports.models.writing.xml_edit import number
from dynident.identification.consistency.labels import labels_of

#: Signs with which a spreadsheet begins a formula.
FORMULA = ("=", "+", "-", "@", "\t", "\r")


@dataclass(frozen=True)
class CsvParameters(ModelExporter):
    """CSV: FILE with the base parameters, deviations and 95 % intervals, and FILE-standard with the standard ones.

    Attributes:
        level: Level of confidence of the intervals, above 0 and below 1.
    """

    level: float = 0.95

    suffix: ClassVar[str] = ".csv"
    proof: ClassVar[str] = "base and standard parameters by dynident"
    needs_bodies: ClassVar[bool] = False
    remembers: ClassVar[bool] = True

    def __post_init__(self) -> None:
        from dynident.errors import BadOption

        if not 0 < self.level < 1:
            raise BadOption("level", self.level, "give a level of confidence such as 0.95")

    def content(self, subject: Identified, path: Path) -> ModelContent:
        estimate = subject.estimate
        half = estimate.half_widths(self.level)
        columns = zip(
            estimate.base.names, estimate.beta, estimate.base.units, estimate.std,
            estimate.relative_std, estimate.beta - half, estimate.beta + half, strict=True,
        )  # fmt: skip
        head = ("parameter", "value", "unit", "std", "relative_std", "lower", "upper")
        rows = [
            (text(name), number(value), unit, number(std), _known(relative), _known(low), _known(high))
            for name, value, unit, std, relative, low, high in columns
        ]
        files = {path: _table(head, rows)}
        notes = [f"intervals at a level of {self.level:g}"]
        if subject.origin == NONE:
            notes.append("no standard parameters: these base parameters are physically inconsistent")
        else:
            files[path.with_name(f"{path.stem}-standard{path.suffix}")] = _standard(subject)
        return ModelContent(files, (), tuple(notes))

    def reload(self, subject: Identified, content: ModelContent, folder: Path, states: StateSet) -> Iterator[Reloaded]:
        paths = [folder / file.name for file in content.files]
        own, motion = subject.estimate, states.motion
        beta = _column(paths[0], 1)
        yield Reloaded(
            "dynident", "base parameters", base_torque(own, beta, motion), base_torque(own, own.beta, motion)
        )
        if len(paths) > 1:
            found = subject.model.torque(motion, _column(paths[1], 2))
            yield Reloaded("dynident", "standard parameters", found, subject.model.torque(motion, subject.theta))


def text(name: str) -> str:
    """Return a text that no spreadsheet takes for a formula: one that begins like one gets an apostrophe in front."""
    return f"'{name}" if name.startswith(FORMULA) else name


def _standard(subject: Identified) -> bytes:
    estimate, parameters = subject.estimate, subject.model.parameters
    labels: Sequence[str] = [""] * len(parameters)
    if estimate.theta is not None and subject.theta is estimate.theta:
        labels = [label.word for label in labels_of(estimate)]
    head = ("parameter", "owner", "value", "unit", "verdict", "label")
    rows = [
        (text(p.symbol), text(p.owner), number(value), p.unit, verdict, label)
        for p, value, verdict, label in zip(parameters, subject.theta, estimate.base.verdicts, labels, strict=True)
    ]
    return _table(head, rows)


def _known(value: float) -> str:
    return number(value) if np.isfinite(value) else ""


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> bytes:
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(head)
    writer.writerows(rows)
    return stream.getvalue().encode("utf-8")


def _column(path: Path, column: int) -> Array:
    with path.open(encoding="utf-8", newline="") as stream:
        return np.array([float(row[column]) for row in list(csv.reader(stream))[1:]])
