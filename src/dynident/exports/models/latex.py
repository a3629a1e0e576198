"""LaTeX: the tables of a paper."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

from dynident.exports.models.base import ModelContent, ModelExporter, Reloaded
from dynident.exports.models.subject.identified import Identified
from dynident.exports.models.subject.states import StateSet
from dynident.exports.models.writing.document import base_torque

_ESCAPES = {
    "\\": r"\textbackslash{}", "{": r"\{", "}": r"\}", "$": r"\$", "&": r"\&", "#": r"\#", "_": r"\_", "%": r"\%",
    "~": r"\textasciitilde{}", "^": r"\textasciicircum{}", "<": r"\textless{}", ">": r"\textgreater{}",
    "|": r"\textbar{}", '"': r"\texttt{\char34}", "[": r"{[}", "]": r"{]}",
}  # fmt: skip

_VALUE = re.compile(r"\$(-?\d\.\d+)(?: \\cdot 10\^\{(-?\d+)\})?\$")


@dataclass(frozen=True)
class Latex(ModelExporter):
    r"""LaTeX table of the base parameters with deviations: a ``tabular`` of plain LaTeX for ``\input``, no package.

    Attributes:
        digits: Digits of a value, 3 to 16; those of the proof are the digits that are printed.
    """

    digits: int = 5

    suffix: ClassVar[str] = ".tex"
    proof: ClassVar[str] = "base parameters, to the digits that are printed, by dynident; not run by LaTeX"
    needs_bodies: ClassVar[bool] = False
    remembers: ClassVar[bool] = True

    def __post_init__(self) -> None:
        from dynident.errors import BadOption

        if not 3 <= self.digits <= 16:
            raise BadOption("digits", self.digits, "give 3 to 16")

    def content(self, subject: Identified, path: Path) -> ModelContent:
        estimate = subject.estimate
        lines = [
            "% Base parameters of an identified model, written by dynident. Plain LaTeX: \\input this file.",
            r"\begin{tabular}{rlrrlr}",
            r"\hline",
            r"No. & Parameter & Value & Std. & Unit & Rel. std. \\",
            r"\hline",
        ]
        table = zip(
            estimate.base.names, estimate.beta, estimate.std, estimate.base.units,
            estimate.relative_std, strict=True,
        )  # fmt: skip
        for k, (name, value, std, unit, relative) in enumerate(table, start=1):
            numbers = _number(value, self.digits), _number(std, 3)
            cells = (str(k), escaped(name), *numbers, _unit(unit), share(relative))
            lines.append(" & ".join(cells) + r" \\")
        lines += [r"\hline", r"\end{tabular}"]
        notes = (f"values have {self.digits} digits; the tables of the exporter csv have all",)
        return ModelContent({path: ("\n".join(lines) + "\n").encode("ascii")}, (), notes)

    def reload(self, subject: Identified, content: ModelContent, folder: Path, states: StateSet) -> Iterator[Reloaded]:
        rows = (folder / next(iter(content.files)).name).read_text(encoding="ascii").splitlines()[5:-2]
        beta = np.array([_read(_cells(row)[2]) for row in rows])
        own, motion = subject.estimate, states.motion
        rounded = np.array([float(f"{value:.{self.digits - 1}e}") for value in own.beta])
        found, expected = base_torque(own, beta, motion), base_torque(own, rounded, motion)
        yield Reloaded("dynident", f"base parameters to {self.digits} digits", found, expected)
        yield Reloaded("LaTeX", why_not="not run; the numbers of the table were read back")


def escaped(text: str) -> str:
    """Return text as LaTeX prints it; what is not plain ASCII becomes a question mark."""
    plain = "".join(c if " " <= c <= "~" else "?" for c in text)
    return "".join(_ESCAPES.get(c, c) for c in plain)


def _number(value: float, digits: int) -> str:
    if not np.isfinite(value):
        return "--"
    mantissa, exponent = f"{value:.{digits - 1}e}".split("e")
    power = int(exponent)
    return f"${mantissa}$" if power == 0 else rf"${mantissa} \cdot 10^{{{power}}}$"


def share(relative: float) -> str:
    """Return a relative deviation in percent with two digits, as LaTeX prints it; two dashes where there is none."""
    percent = 100.0 * relative
    if not np.isfinite(percent):
        return "--"
    if not 0.01 <= percent <= 999:
        return r"$<0.01$\,\%" if percent < 1 else r"$>999$\,\%"
    digits = f"{percent:.0f}" if percent >= 9.95 else f"{percent:#.2g}"
    return rf"{digits}\,\%"


def _unit(unit: str) -> str:
    parts = re.sub(r"\^(\d+)", r"$^{\1}$", unit)
    return parts.replace(" ", r"\,")


def _cells(row: str) -> Sequence[str]:
    return re.split(r"(?<!\\) & ", row)


def _read(cell: str) -> float:
    match = _VALUE.fullmatch(cell)
    assert match is not None
    return float(f"{match.group(1)}e{match.group(2) or 0}")
