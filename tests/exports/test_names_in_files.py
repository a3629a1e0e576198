"""Free text in the comments of other languages."""

from __future__ import annotations

import keyword
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dynident.exports.names_in_files import LONGEST_LINE, comment_text, module_notes


@given(st.text(alphabet="*/ a-\\\n\"'`$é;", max_size=150))
def test_a_comment_ends_nowhere_in_its_text(text: str) -> None:
    found = comment_text(text)
    assert len(found) <= LONGEST_LINE and found.isascii() and found.isprintable()
    assert not {"*/", "/*"} & {found[i : i + 2] for i in range(len(found))}
    assert not set(found) & set("\\\"'`$;")


def test_what_is_harmless_stays_as_it_is() -> None:
    assert comment_text("a / b * c - 0.5, of 'x'") == "a / b * c - 0.5, of _x_"
    assert comment_text("end */ of /* it") == "end __ of __ it"


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("arm.py", ""),
        ("my_arm7.py", ""),
        ("my-robot.py", "no name of a Python module: 'import' takes it as my_robot.py"),
        ("7dof.py", "takes it as robot_7dof.py"),
        ("class.py", "takes it as robot_class.py"),
        ("arm.txt", "takes it as robot_arm.py"),
        ("numpy.py", "is the name of another module: 'import' takes it as robot_numpy.py"),
        ("random.py", "is the name of another module"),
        ("größe.py", "takes it as gr_e.py"),
    ],
)
def test_names_that_python_does_not_import_are_told(name: str, said: str) -> None:
    notes = module_notes(Path("out") / name, "numpy")
    assert said in " ".join(notes) and bool(notes) == bool(said)


@given(st.text(min_size=1, max_size=12).filter(lambda text: "/" not in text and text not in (".", "..")))
def test_the_name_that_is_offered_can_be_imported(stem: str) -> None:
    for note in module_notes(Path(f"{stem}.py"), "numpy"):
        offered = note.rpartition(" as ")[2].removesuffix(".py, for example")
        assert offered.isidentifier() and offered.isascii() and not keyword.iskeyword(offered)
