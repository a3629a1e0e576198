"""Tables in narrow terminals: names and numbers stay whole, details go first, the rest stands below."""

from __future__ import annotations

import re
import textwrap

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dynident.cli import console
from dynident.results.table_width import GAP, fit_width, wrap_text
from dynident.results.text import Column, Table, display_width, plain

Capture = pytest.CaptureFixture[str]

#: What makes text bold.
STYLE = re.compile(r"\x1b\[\d*m")

#: The longest joint names of the example robots and of the real logs.
JOINTS = ("shoulder_pan_joint", "shoulder_lift_joint", "arm_right_5_joint", "lbr_iiwa_joint_7", "panda_joint1")
FIGURES = Table(
    (
        Column("joint"),
        Column("samples", numeric=True, detail=True),
        Column("unit"),
        Column("RMS error", numeric=True),
        Column("unfiltered", numeric=True, detail=True),
        Column("relative error", "%", numeric=True),
        Column("correlation", numeric=True),
        Column("R²", numeric=True, detail=True),
    ),
    tuple((joint, "25000", "N·m", "0.123", "0.234", ">999", "0.9987", "0.991") for joint in JOINTS),
)


@pytest.mark.parametrize("width", [40, 60, 80, 120, 200])
def test_a_terminal_shows_names_and_numbers_whole(width: int, monkeypatch: pytest.MonkeyPatch, capsys: Capture) -> None:
    monkeypatch.setenv("COLUMNS", str(width))
    monkeypatch.setattr("sys.stdout.isatty", lambda: True)
    console.answer_table(FIGURES, "test error")
    shown = STYLE.sub("", capsys.readouterr().out)
    assert all(display_width(line) <= width for line in shown.splitlines())
    assert "…" not in shown and all(joint in shown for joint in JOINTS)
    assert all(shown.count(cell) == len(JOINTS) for cell in ("0.123", ">999", "0.9987"))
    assert ("left out here:" in shown) is (width <= 80)


def test_details_go_from_the_right_and_only_as_many_as_needed() -> None:
    assert fit_width(FIGURES, 200).left_out == ()
    assert fit_width(FIGURES, 80).left_out == ("R²",)
    assert fit_width(FIGURES, 60).left_out == ("samples", "unfiltered", "R²")


def test_parts_begin_with_the_names() -> None:
    parts = fit_width(FIGURES, 40).parts
    assert len(parts) > 1
    assert all([row[0] for row in part.rows] == list(JOINTS) for part in parts)
    shown = [column.heading for part in parts for column in part.columns[1:]]
    assert shown == ["unit", "RMS error", "relative error", "correlation"]


def test_a_wide_terminal_shows_the_table_as_a_pipe_does(monkeypatch: pytest.MonkeyPatch, capsys: Capture) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    monkeypatch.setattr("sys.stdout.isatty", lambda: True)
    console.answer_table(FIGURES)
    lines = [line.rstrip() for line in STYLE.sub("", capsys.readouterr().out).splitlines()]
    piped = plain(FIGURES).splitlines()
    assert lines == [piped[0], *piped[2:]]  # without the rule


@given(
    cells=st.lists(
        st.tuples(st.text("abc_ ", max_size=30), st.integers(-(10**9), 10**9), st.text("xy z", max_size=40)), max_size=4
    ),
    width=st.integers(10, 200),
)
def test_nothing_is_lost_and_nothing_is_wider_than_the_terminal(cells: list[tuple[str, int, str]], width: int) -> None:
    columns = (Column("name"), Column("count", "N m", numeric=True), Column("remark", detail=True))
    table = Table(columns, tuple((name, str(count), remark) for name, count, remark in cells))
    fitted = fit_width(table, width)
    headings = {column.heading for part in fitted.parts for column in part.columns}
    assert headings | set(fitted.left_out) == {"name", "count", "remark"} and "name" in headings
    for part, widths in zip(fitted.parts, fitted.widths, strict=True):
        words = [word for row in part.rows for cell in row for word in cell.split()]
        longest = max(map(display_width, words), default=0)
        total = sum(widths) + GAP * (len(widths) - 1)
        assert total <= width or len(widths) <= 2
        assert max(widths) >= longest


@pytest.mark.parametrize("word", ["joint_1", "关节一", "関節トルク", "größe", "조인트"])
def test_wrapped_lines_count_wide_characters_twice(word: str) -> None:
    text = " ".join(f"{word}{k}:" for k in range(30))
    lines = wrap_text(text, 40)
    assert max(map(display_width, lines)) <= 40 and len(lines) > 1
    assert " ".join(line.strip() for line in lines) == text
    assert all(line.startswith("  ") for line in lines[1:])
    if word.isascii():
        assert lines == textwrap.wrap(text, 40, subsequent_indent="  ", break_on_hyphens=False)


def test_a_word_that_is_wider_than_a_line_is_broken_or_stands() -> None:
    assert max(map(display_width, wrap_text("关节" * 30, 21))) <= 21
    assert wrap_text("关节" * 30, 21, break_long_words=False) == ["关节" * 30]
