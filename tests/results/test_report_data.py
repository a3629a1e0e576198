"""Golden file: what the sections of a report say of a fixed subject; and colours that everybody can tell apart.

``python tests/results/test_report_data.py`` writes the golden file anew; look at what changes.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from itertools import combinations
from pathlib import Path
from typing import Any

import pytest
from synthetic import subject_of

from dynident.identification.estimate.validation import Validation
from dynident.results.report import Subject, builder
from dynident.results.report.builder import parts_of
from dynident.results.report.sections.base import Drawing

GOLDEN = Path(__file__).with_name("golden") / "report.json"

#: What a person with a common weakness sees of linear red, green and blue (Machado, Oliveira and Fernandes 2009).
WEAKNESSES = {
    "protanopia": ((0.152286, 1.052583, -0.204868), (0.114503, 0.786281, 0.099216), (-0.003882, -0.048116, 1.051998)),
    "deuteranopia": ((0.367322, 0.860646, -0.227968), (0.280085, 0.672501, 0.047413), (-0.01182, 0.04294, 0.968881)),
}


def plain(value: Any) -> Any:
    """Return what a template shows as plain data: of a figure its name and its robot model."""
    if isinstance(value, Drawing):
        return f"{value.stem}: {value.partition('<desc>')[2].partition('</desc>')[0]}"
    if isinstance(value, Mapping):
        return {key: plain(each) for key, each in value.items() if key != "scene"}
    if isinstance(value, list | tuple):
        return [plain(each) for each in value]
    if isinstance(value, Validation):
        return list(value.logs)
    if is_dataclass(value):
        return {own.name: plain(getattr(value, own.name)) for own in fields(value)}
    return str(value) if isinstance(value, str) else value


def said() -> dict[str, Any]:
    estimate, test = subject_of(samples=400, noise=0.4)
    return {part.name: plain(part.context) for part in parts_of(Subject(estimate, (test,)))}


def test_a_report_says_what_it_said() -> None:
    assert said() == json.loads(GOLDEN.read_text(encoding="utf-8"))


def palettes() -> dict[str, dict[str, str]]:
    """Return the colours of the page by scheme."""
    style = (Path(builder.__file__).parent / "templates" / "style.css").read_text(encoding="utf-8")
    blocks = re.findall(r":root \{(.*?)\}", style, flags=re.DOTALL)
    light, dark, paper = (dict(re.findall(r"--([a-z0-9]+): (#[0-9a-f]{6})", block)) for block in blocks)
    return {"light": light, "dark": {**light, **dark}, "paper": {**light, **paper}}


def linear(colour: str) -> tuple[float, ...]:
    parts = (int(colour[k : k + 2], 16) / 255 for k in (1, 3, 5))
    return tuple(part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4 for part in parts)


def luminance(colour: str) -> float:
    red, green, blue = linear(colour)
    return 0.2126 * red + 0.7152 * green + 0.0722 * blue


def contrast(one: str, other: str) -> float:
    """Return the ratio of WCAG 2.1, 1.4.3."""
    low, high = sorted((luminance(one), luminance(other)))
    return (high + 0.05) / (low + 0.05)


@pytest.mark.parametrize("scheme", ["light", "dark", "paper"])
def test_text_and_lines_stand_out(scheme: str) -> None:
    colours = palettes()[scheme]
    for name in ("ink", "soft", "good", "fair", "bad"):
        assert contrast(colours[name], colours["paper"]) >= 4.5, name
    assert contrast(colours["ink"], colours["wash"]) >= 4.5
    for name in ("c1", "c2", "c3", "axis"):  # what measured, predicted and residual are drawn in, and the axes
        assert contrast(colours[name], colours["paper"]) >= 3.0, name


@pytest.mark.parametrize("scheme", ["light", "dark", "paper"])
@pytest.mark.parametrize("weakness", WEAKNESSES)
def test_lines_are_told_apart_without_red_or_green(scheme: str, weakness: str) -> None:
    colours = palettes()[scheme]
    seen = {
        name: [sum(a * b for a, b in zip(row, linear(colours[name]), strict=True)) for row in WEAKNESSES[weakness]]
        for name in ("c1", "c2")
    }
    for one, other in combinations(seen.values(), 2):
        assert max(abs(a - b) for a, b in zip(one, other, strict=True)) > 0.2


if __name__ == "__main__":
    GOLDEN.parent.mkdir(exist_ok=True)
    GOLDEN.write_text(json.dumps(said(), indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
