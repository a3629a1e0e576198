"""House rules that a program can check: docstrings, sizes, types, no printing outside the command line."""

from __future__ import annotations

import ast
import importlib
import inspect
import pkgutil
import re
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from pathlib import Path
from types import ModuleType
from typing import Any, TypeAlias

import pytest

import dynident
from dynident.data.formats import FORMATS
from dynident.data.preprocessing import FILTERS
from dynident.data.profiles import PROFILES
from dynident.diagnosis.checks import CHECKS
from dynident.excitation.criteria import CRITERIA
from dynident.excitation.trajectories import TRAJECTORIES
from dynident.exports.models import MODEL_EXPORTERS
from dynident.exports.motions import MOTION_EXPORTERS
from dynident.identification.estimators import ESTIMATORS
from dynident.model.friction import FRICTION
from dynident.plugins import Family
from dynident.robot_files.formats.base import DESCRIPTIONS
from dynident.simulation.controllers import CONTROLLERS

ROOT = Path(inspect.getfile(dynident)).parent
FILES = sorted(ROOT.rglob("*.py"))
FAMILIES: tuple[Family[Any], ...] = (
    MOTION_EXPORTERS,
    MODEL_EXPORTERS,
    ESTIMATORS,
    FORMATS,
    PROFILES,
    CHECKS,
    FILTERS,
    TRAJECTORIES,
    CRITERIA,
    CONTROLLERS,
    DESCRIPTIONS,
    FRICTION,
)

LONGEST_FILE, LONGEST_FUNCTION = 400, 60

#: Path of each file, its statements, and all nodes of its tree.
Trees: TypeAlias = list[tuple[str, list[ast.stmt], list[ast.AST]]]


def modules() -> list[str]:
    return ["dynident", *(item.name for item in pkgutil.walk_packages(dynident.__path__, "dynident."))]


def own(module: ModuleType) -> Iterator[tuple[str, Any]]:
    """Yield the public classes and functions that a module defines, and the public members of the classes."""
    for name, value in vars(module).items():
        if name.startswith("_") or getattr(value, "__module__", None) != module.__name__:
            continue
        if inspect.isclass(value):
            yield name, value
            for member, item in vars(value).items():
                plain = item.__func__ if isinstance(item, classmethod | staticmethod) else item
                if not member.startswith("_") and (inspect.isfunction(plain) or hasattr(plain, "__doc__")):
                    is_code = inspect.isfunction(plain) or isinstance(plain, property) or hasattr(plain, "func")
                    if is_code:
                        yield f"{name}.{member}", getattr(value, member)
        elif inspect.isfunction(value) or hasattr(value, "py_func"):
            yield name, value


@pytest.mark.parametrize("name", modules())
def test_every_public_name_has_a_docstring(name: str) -> None:
    module = importlib.import_module(name)
    found = [("the module", module), *own(module)]
    assert not [what for what, value in found if not (inspect.getdoc(value) or "").strip()]


@pytest.mark.parametrize("name", modules())
def test_dataclasses_are_frozen_and_leave_no_field_out(name: str) -> None:
    module = importlib.import_module(name)
    for what, value in own(module):
        if inspect.isclass(value) and is_dataclass(value):
            assert getattr(value, "__dataclass_params__").frozen, what  # noqa: B009
            _, block, text = (inspect.getdoc(value) or "").partition("Attributes:\n")
            stated = vars(value).get("__annotations__", {})  # inherited fields are described where they come from
            shown = [f.name for f in fields(value) if f.name in stated and not f.name.startswith("_")]
            assert not (block and [name for name in shown if f"    {name}: " not in text]), what


@pytest.mark.parametrize("family", FAMILIES, ids=lambda family: family.noun)
def test_every_option_of_a_part_is_described(family: Family[Any]) -> None:
    for name in family.names():
        assert family.summary(name).endswith("."), name
        assert not [option.name for option in family.options(name) if not option.help.endswith(".")], name


@pytest.fixture(scope="module")
def trees() -> Trees:
    parsed = [(file.relative_to(ROOT).as_posix(), ast.parse(file.read_text(encoding="utf-8"))) for file in FILES]
    return [(path, tree.body, list(ast.walk(tree))) for path, tree in parsed]


def functions(nodes: list[ast.AST]) -> list[ast.FunctionDef | ast.AsyncFunctionDef]:
    return [node for node in nodes if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)]


def test_files_are_short() -> None:
    lengths = {file.name: len(file.read_text(encoding="utf-8").splitlines()) for file in FILES}
    assert not {name: lines for name, lines in lengths.items() if lines > LONGEST_FILE}


def test_functions_are_short(trees: Trees) -> None:
    lengths = {
        f"{path}:{node.name}": (node.end_lineno or node.lineno) - node.lineno + 1
        for path, _, nodes in trees
        for node in functions(nodes)
    }
    assert not {name: lines for name, lines in lengths.items() if lines > LONGEST_FUNCTION}


def test_everything_is_typed(trees: Trees) -> None:
    bare = []
    for path, _, nodes in trees:
        inner = {id(item) for node in functions(nodes) for item in functions(list(ast.walk(node))) if item is not node}
        for node in functions(nodes):
            arguments = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]
            named = [a for a in arguments if a.arg not in ("self", "cls")]
            if id(node) not in inner and (node.returns is None or any(a.annotation is None for a in named)):
                bare += [f"{path}:{node.lineno} {node.name}"] if node.name != "__getattr__" else []
    assert not bare


def test_only_the_command_line_prints_or_exits(trees: Trees) -> None:
    loud = []
    for path, _, nodes in trees:
        for node in nodes:
            called = ast.unparse(node.func) if isinstance(node, ast.Call) else ""
            raised = ast.unparse(node.exc or node) if isinstance(node, ast.Raise) else ""
            if called in ("print", "input", "breakpoint", "exit", "quit", "sys.exit", "os._exit", "sys.stdout.write"):
                loud.append(f"{path}:{node.lineno} {called}")  # type: ignore[attr-defined]
            if raised.startswith("SystemExit"):
                loud.append(f"{path}: {raised}")
    assert not [where for where in loud if not where.startswith("cli/")]


def test_no_plotting_library_is_imported_with_a_module(trees: Trees) -> None:
    for path, body, _ in trees:
        names = [ast.unparse(node) for node in body if isinstance(node, ast.Import | ast.ImportFrom)]
        assert not [line for line in names if "matplotlib" in line or "plotly" in line], path


def test_no_room_is_named_after_nothing() -> None:
    words = {"utils", "util", "tools", "helpers", "helper", "common", "misc"}
    assert not [path for path in ROOT.rglob("*") if path.stem in words]


def test_imports_are_absolute(trees: Trees) -> None:
    for path, _, nodes in trees:
        levels = [node.level for node in nodes if isinstance(node, ast.ImportFrom)]
        assert not any(levels), path


def test_the_command_line_and_the_studio_know_no_exporter_by_name(trees: Trees) -> None:
    """Names of packages, extras and formats of other things are no exporters: csv and json are read, too."""
    names = {*MOTION_EXPORTERS.names(), *MODEL_EXPORTERS.names()} - {"csv", "json", "casadi", "fmu", "pinocchio"}
    texts = [node.value for path, _, nodes in trees if path.startswith(("cli/", "studio/"))
             for node in nodes if isinstance(node, ast.Constant)]  # fmt: skip
    for script in (ROOT / "studio/static").glob("*.js"):
        texts += re.findall(r"""["'`](\w+)["'`]""", script.read_text(encoding="utf-8"))
    assert not names & {text for text in texts if isinstance(text, str)}
