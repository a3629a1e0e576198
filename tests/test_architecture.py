"""The page of the architecture names the wings and rooms that the contracts hold, and files that exist."""

from __future__ import annotations

import re
import tomllib
from itertools import pairwise
from typing import Any

from test_documentation import ROOT, rows_after

PACKAGE = ROOT / "src" / "dynident"


def _contract(name: str) -> dict[str, Any]:
    facts = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    return next(one for one in facts["tool"]["importlinter"]["contracts"] if one["name"] == name)


def _layers(contract: dict[str, Any]) -> list[str]:
    return [part.strip() for layer in contract["layers"] for part in layer.split("|")]


def test_wings_of_the_page_are_those_of_the_contract() -> None:
    layers = [name.removeprefix("dynident.") for name in _layers(_contract("Each wing stands on the ones below it"))]
    rows = [re.findall(r"`(\w+)`", row[0]) for row in rows_after("architecture.md", "wings")]
    assert [name for row in rows[:-1] for name in row] == layers[: len(rows) - 1]
    assert set(rows[-1]) == set(layers[len(rows) - 1 :])
    folders = {path.name for path in PACKAGE.iterdir() if path.is_dir() and path.name != "__pycache__"}
    assert folders | {path.stem for path in PACKAGE.glob("[a-z]*.py")} == set(layers)


def test_rooms_of_the_page_are_those_of_the_contract() -> None:
    layers = _layers(_contract("Rooms of identification stand in layers"))
    rooms = [name for row in rows_after("architecture.md", "rooms") for name in re.findall(r"`(\w+)`", row[0])]
    assert sorted(rooms) == sorted(layers)
    order = {name: place for place, name in enumerate(reversed(layers))}
    pairs = {frozenset(layer.split(" | ")) for layer in _contract("Rooms of identification stand in layers")["layers"]}
    for lower, upper in pairwise(rooms):
        assert order[lower] < order[upper] or frozenset((lower, upper)) in pairs


def test_files_that_the_page_names_exist() -> None:
    text = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    wings = "|".join(path.name for path in PACKAGE.iterdir() if path.is_dir())
    named = set(re.findall(rf"(?<!/)\b((?:{wings}|tests)/[\w/]+(?:\.py)?)", text))
    missing = [name for name in named if not (ROOT / name).exists() and not (PACKAGE / name).exists()]
    assert len(named) > 15 and not missing


def test_the_data_flow_has_a_file_for_each_step() -> None:
    """From robot and log over samples, QR factors and estimate to the report, and each step names what is there."""
    text = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    flow = text.partition("## What `identify` does")[2].partition("```text\n")[2].partition("```")[0].splitlines()
    stations = [line.split("  ")[0] for line in flow if line and line[0] != " " and not line.startswith("|")]
    assert [station.split(",")[0] for station in stations] == [
        "robot model",
        "samples",
        "QR factors",
        "estimate",
        "tables",
    ]
    steps = [
        re.split(r" {2,}", line.strip(" |"))[-1] for line in flow[1:] if line.strip(" |v") and line not in stations
    ]
    assert len(steps) > 15
    for step in steps:
        named = re.findall(r"[\w/]+(?:/|\.py)", step)
        assert named and all((PACKAGE / name).exists() for name in named), step
