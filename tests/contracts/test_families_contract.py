"""What every part must be, whatever its family and whoever writes it: a value with options that imports no sibling."""

from __future__ import annotations

import ast
import inspect
import pickle
import re
from dataclasses import MISSING, FrozenInstanceError, fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from families import FAMILIES

import dynident
from dynident.errors import BadOption, UnknownChoice
from dynident.plugins import Family

PARTS = [pytest.param(family, name, id=f"{key}-{name}") for key, family in FAMILIES.items() for name in family.names()]

#: Values that no option of a kind may take in silence.
ABSURD = {"float": np.nan, "int": -1, "str": "nonsense", "Literal": "nonsense"}

#: Options that take a name of the user's, whatever it is.
FREE = {"external", "node", "package", "prefix"}


def starts_bare(kind: type) -> bool:
    """Return whether a part can be made of its defaults; a motion needs its table."""
    if not is_dataclass(kind):
        return True
    return all(f.default is not MISSING or f.default_factory is not MISSING for f in fields(kind) if f.init)


def test_every_family_has_a_battery_of_its_own() -> None:
    """Families are those that the source makes; the battery of each asks it for all its names."""
    made = re.compile(r'= Family\(\s*"([\w.]+)"')
    source = Path(dynident.__file__).parent
    packages = {name for file in source.rglob("*.py") for name in made.findall(file.read_text("utf-8"))}
    assert packages == {family.package for family in FAMILIES.values()} and len(packages) == len(FAMILIES)
    batteries = [file.read_text("utf-8") for file in Path(__file__).parent.glob("test_*_contract.py")]
    for name in FAMILIES:
        assert any(re.search(rf"\b{name}\.names\(\)", text) for text in batteries), name


@pytest.mark.parametrize(("family", "name"), PARTS)
def test_a_part_is_a_frozen_value(family: Family[Any], name: str) -> None:
    kind = family.get(name)
    assert is_dataclass(kind) and kind.__dataclass_params__.frozen  # type: ignore[attr-defined]
    if not starts_bare(kind):
        return
    part = family.make(name)
    assert part == family.make(name) and hash(part) == hash(family.make(name)) and family.name_of(part) == name
    assert eval(repr(part), {kind.__name__: kind, "nan": np.nan, "inf": np.inf}) == part
    assert pickle.loads(pickle.dumps(part)) == part
    with pytest.raises((FrozenInstanceError, AttributeError)):
        part.anything = 1


@pytest.mark.parametrize(("family", "name"), PARTS)
def test_it_says_what_it_is_and_what_its_options_are(family: Family[Any], name: str) -> None:
    assert len(family.summary(name).split()) >= 3 and "\n" not in family.summary(name)
    if starts_bare(family.get(name)):
        assert [option.name for option in family.options(name) if not option.help] == []


@pytest.mark.parametrize(("family", "name"), PARTS)
def test_absurd_options_are_refused(family: Family[Any], name: str) -> None:
    if not starts_bare(family.get(name)):
        return
    for option in family.options(name):
        for kind, value in ABSURD.items():
            if option.kind.startswith(kind) and not (kind == "str" and option.name in FREE):
                with pytest.raises((BadOption, UnknownChoice), match=f"{option.name}|nonsense"):
                    family.make(name, {option.name: value})


@pytest.mark.parametrize(("family", "name"), PARTS)
def test_defaults_written_out_are_the_defaults(family: Family[Any], name: str) -> None:
    if starts_bare(family.get(name)):
        texts = {o.name: None if o.default is None else str(o.default) for o in family.options(name)}
        assert family.make_from_text(name, texts) == family.make(name)


@pytest.mark.parametrize(("family", "name"), PARTS)
def test_a_part_uses_a_sibling_whole_or_not_at_all(family: Family[Any], name: str) -> None:
    """What parts share stands in base or in a file with an underscore; a sibling is used by its class alone."""
    tree = ast.parse(Path(inspect.getfile(family.get(name))).read_text("utf-8"))
    for node in ast.walk(tree):
        if not isinstance(node, ast.ImportFrom) or not (node.module or "").startswith(f"{family.package}."):
            continue
        sibling = str(node.module).removeprefix(f"{family.package}.").split(".")[0]
        if sibling in family.names():
            assert [alias.name for alias in node.names] == [family.get(sibling).__name__]
