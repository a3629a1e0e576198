"""The page of the architecture names what the contracts hold; names are unique, tests take public ones."""

from __future__ import annotations

import ast
import re
import tomllib
from itertools import pairwise
from typing import Any

import pytest

from loaded_file import loaded_file
from test_documentation import ROOT, rows_after

PACKAGE = ROOT / "src" / "dynident"


@pytest.fixture(scope="module")
def figures() -> dict[str, Any]:
    """Return the figures of the whole source: they take seconds."""
    return loaded_file("scripts/sizes.py").figures(PACKAGE)


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


@pytest.mark.parametrize(
    "figure", ["class names that are defined twice", "functions with more than 8 parameters", "functions with **kwargs"]
)
def test_the_source_has_none_of(figure: str, figures: dict[str, Any]) -> None:
    assert figures[figure] == []


#: Files under 60 lines that are neither parts nor ``__init__.py``, and why each stands alone.
SMALL = {
    "__main__.py": "what Python runs for -m",
    "actuators/torque_state.py": "refuses logs, where directions only compares",
    "api/estimate_output.py": "of the commands that write an estimate",
    "api/validate.py": "a verb",
    "arrays.py": "ground of all wings",
    "case/draft/stated_units.py": "what files state, apart from what their values say",
    "case/draft/turn_counters.py": "turns of encoders, apart from what else values say",
    "case/draft/yaml_words.py": "how YAML is written, apart from what",
    "case/open_friction.py": "needed by cases that leave friction to the logs, and loads identification",
    "case/evidence/positions.py": "one kind of evidence",
    "case/evidence/rows.py": "one kind of evidence",
    "case/draft/servo_text.py": "one key of a draft",
    "cli/merge.py": "a command",
    "cli/proving.py": "of export and report",
    "data/formats/_simulated_bag.py": "names in recordings of the virtual cell, apart from other recordings",
    "data/motor_side.py": "of logs and their streams",
    "diagnosis/checks/_torque_unit.py": "of two checks",
    "data/turns.py": "of reading, drafting, checking and repairing",
    "identification/consistency/labels.py": "of the estimate and its files",
    "identification/estimators/_pulled.py": "of the estimators that pull to something",
    "identification/files/saved_values.py": "of estimate files and triangle files",
    "identification/files/estimate_versions.py": "grows by a function a version",
    "identification/problem/commanded_motion.py": "of the simulated course and the diagnostics",
    "identification/problem/thinned_rows.py": "rows of few samples, apart from the stream of all",
    "identification/residuals/quantiles.py": "in place of a module that loads slowly",
    "identification/simulated/estimators/clie.py": "an estimator",
    "identification/simulated/estimators/cloe.py": "an estimator",
    "identification/simulated/estimators/didim.py": "an estimator",
    "identification/simulated/estimators/iv.py": "an estimator",
    "model/chain.py": "all that kernels know of a robot",
    "model/kernels/numpy_source.py": "one of the languages that a traced program is written in",
    "results/figures/convergence.py": "a figure",
    "results/model_export_view.py": "what a command shows, apart from the command",
    "results/report/combinations.py": "of sections and the page of a difference",
    "results/verdict.py": "of terminal, report and studio",
    "robot_files/formats/base.py": "base of the family",
    "robot_files/robot_origin.py": "what goes with an estimate, apart from reading",
    "robot_files/rotations.py": "of several formats",
    "studio/child.py": "what the process of a command runs",
}


def test_small_files_stand_alone_for_a_reason(figures: dict[str, Any]) -> None:
    found = figures["files under 60 lines, no parts and no __init__"]
    assert {one.split()[0] for one in found} <= set(SMALL)


def test_tests_take_no_private_name_of_the_package() -> None:
    """Modules with an underscore are rooms' own files beside parts; a test may import what is public in them."""
    private = []
    for path in sorted((ROOT / "tests").rglob("*.py")):
        nodes = list(ast.walk(ast.parse(path.read_text("utf-8"))))
        imports = [node for node in nodes if isinstance(node, ast.ImportFrom)]
        own = [node for node in imports if (node.module or "").startswith("dynident")]
        modules = {alias.asname or alias.name for node in own for alias in node.names}
        private += [
            f"{path.name}: {alias.name}" for node in own for alias in node.names if _is_private(node, alias.name)
        ]
        private += [
            f"{path.name}: {ast.unparse(node)}"
            for node in nodes
            if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name)
            if node.value.id in modules and node.attr.startswith("_") and not node.attr.startswith("__")
        ]
    assert private == []


def _is_private(node: ast.ImportFrom, name: str) -> bool:
    module = PACKAGE.parent.joinpath(*str(node.module).split("."), f"{name}.py")
    return name.startswith("_") and not module.exists()
