"""A family is a folder: its parts are found, made from names, options and texts, and refused by name."""

from __future__ import annotations

import sys
from concurrent.futures import ThreadPoolExecutor

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dynident.errors import BadOption, UnknownChoice
from dynident.model.friction import FRICTION
from dynident.model.friction.coulomb import Coulomb
from dynident.model.friction.stribeck import Stribeck
from dynident.plugins import Family

_BASE = """
class Shape:
    pass
"""

_ROUND = '''
from __future__ import annotations
from dataclasses import dataclass, field
from zoo_of_shapes.base import Shape

@dataclass(frozen=True)
class Round(Shape):
    """A round shape; the rest of the first paragraph is no summary of it.

    More text.

    Attributes:
        radius: In m.
        sides: How many,
            on a second line: with a colon.
        filled: Whether it is.
        label: A word.
        colour: Three numbers, or None.

    Raises:
        Nothing: At all.
    """

    radius: float
    sides: int = 3
    filled: bool = False
    label: str = "none"
    colour: tuple[float, ...] | None = None
    area: float = field(init=False, default=0.0)
'''

_PLAIN = '''
from zoo_of_shapes.base import Shape

class Plain(Shape):
    """A plain shape."""
'''

_TWO = """
from zoo_of_shapes.base import Shape

class One(Shape):
    pass

class Two(Shape):
    pass
"""

_SLOW = """
import time
from zoo_of_shapes.base import Shape

time.sleep(0.2)

class Slow(Shape):
    pass
"""


@pytest.fixture(scope="module")
def family(tmp_path_factory: pytest.TempPathFactory) -> Family[object]:
    folder = tmp_path_factory.mktemp("families")
    package = folder / "zoo_of_shapes"
    package.mkdir()
    texts = {
        "__init__": "",
        "base": _BASE,
        "round": _ROUND,
        "plain": _PLAIN,
        "two": _TWO,
        "slow": _SLOW,
        "_hidden": "1 / 0",
    }
    for name, text in texts.items():
        (package / f"{name}.py").write_text(text)
    (package / "inner").mkdir()
    (package / "inner" / "__init__.py").write_text("1 / 0")
    sys.path.insert(0, str(folder))
    try:
        from zoo_of_shapes.base import Shape  # pyright: ignore[reportMissingImports]
    finally:
        sys.path.remove(str(folder))
    return Family("zoo_of_shapes", Shape, "shape")


def test_names_are_the_files_and_import_none_of_them(family: Family[object]) -> None:
    loaded = set(sys.modules)
    assert family.names() == ("plain", "round", "slow", "two")
    assert not {name for name in set(sys.modules) - loaded if name.startswith("zoo_of_shapes.")}


def test_get_imports_only_the_chosen_part(family: Family[object]) -> None:
    assert family.get("plain").__name__ == "Plain"
    assert "zoo_of_shapes.two" not in sys.modules


def test_a_part_that_another_thread_is_loading_is_waited_for(family: Family[object]) -> None:
    with ThreadPoolExecutor(2) as threads:
        parts = list(threads.map(family.get, ["slow", "slow"]))
    assert [part.__name__ for part in parts] == ["Slow", "Slow"]


def test_a_file_must_hold_exactly_one_part(family: Family[object]) -> None:
    with pytest.raises(TypeError, match=r"zoo_of_shapes.two must define exactly one Shape, found 2"):
        family.get("two")


def test_unknown_part_names_the_nearest(family: Family[object]) -> None:
    with pytest.raises(UnknownChoice) as caught:
        family.get("rund")
    assert str(caught.value) == "no shape called 'rund'; choose one of: plain, round, slow, two; did you mean 'round'?"
    for name in ("base", "_hidden", "inner"):
        with pytest.raises(UnknownChoice):
            family.get(name)


def test_make_from_name_and_options(family: Family[object]) -> None:
    part = family.make("round", {"radius": 2.0, "sides": 5})
    assert (vars(part)["radius"], vars(part)["sides"]) == (2.0, 5)
    assert family.make(part) is part
    assert family.name_of(part) == "round"


def test_unknown_option_names_the_nearest(family: Family[object]) -> None:
    with pytest.raises(BadOption) as caught:
        family.make("round", {"radious": 1.0})
    assert str(caught.value) == (
        "radious = 1.0 is not possible; the shape 'round' has the options: radius, sides, filled, label, colour; "
        "did you mean 'radius'?"
    )
    with pytest.raises(BadOption, match=r"the shape 'plain' has the options: none$"):
        family.make("plain", {"radius": 1.0})
    with pytest.raises(BadOption):  # a field that is not set by the caller is no option
        family.make("round", {"area": 1.0})


def test_options_beside_a_made_part_are_not_lost_in_silence() -> None:
    with pytest.raises(TypeError, match="has its options already; width would be lost"):
        FRICTION.make(Coulomb(0.1), {"width": 0.2})


def test_options_carry_kind_default_and_help(family: Family[object]) -> None:
    options = family.options("round")
    assert [option.name for option in options] == ["radius", "sides", "filled", "label", "colour"]
    assert [option.kind for option in options] == ["float", "int", "bool", "str", "tuple[float, ...] | None"]
    assert [option.default for option in options] == [None, 3, False, "none", None]
    assert options[0].help == "In m."
    assert options[1].help == "How many, on a second line: with a colon."
    assert options[4].help == "Three numbers, or None."
    assert family.options("plain") == ()


def test_summary_is_the_first_line(family: Family[object]) -> None:
    assert family.summary("round") == "A round shape; the rest of the first paragraph is no summary of it."


def test_make_from_text(family: Family[object]) -> None:
    texts = {"radius": " 2.5 ", "sides": "7", "filled": "True", "label": " blue ", "colour": "[1, 2.5, -3e2]"}
    part = vars(family.make_from_text("round", texts))
    assert part == {
        "radius": 2.5, "sides": 7, "filled": True, "label": "blue", "colour": (1.0, 2.5, -300.0),
    }  # fmt: skip
    for text in (None, "None", " null "):
        assert vars(family.make_from_text("round", {"radius": "1", "colour": text}))["colour"] is None


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("sides", "3.5", "sides = '3.5' is not possible; write a value of the kind int"),
        ("sides", "many", "sides = 'many' is not possible; write a value of the kind int"),
        (
            "radius",
            "1,5",
            "radius = '1,5' is not possible; write a value of the kind float; write decimals with a point",
        ),
        ("filled", "yes", "filled = 'yes' is not possible; write true or false"),
        ("radius", None, "radius is not given; give a value of the kind float"),
        ("colour", "1;2", "colour = '1;2' is not possible; write a value of the kind tuple[float, ...] | None"),
    ],
)
def test_texts_that_are_no_value(family: Family[object], name: str, text: str | None, message: str) -> None:
    with pytest.raises(BadOption) as caught:
        family.make_from_text("round", {"radius": "1", name: text})
    assert str(caught.value) == message


@given(st.floats(0, 1e300, exclude_min=True))
def test_a_number_written_out_reads_back(value: float) -> None:
    assert FRICTION.make_from_text("stribeck", {"velocity": repr(value)}) == Stribeck(velocity=value)
