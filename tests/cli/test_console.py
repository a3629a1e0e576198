"""Output whose reader has gone, and values that look like options."""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Iterator
from typing import TextIO

import pytest

from dynident.cli import console
from dynident.cli.main import COMMANDS, build_parser, main
from dynident.results.text import Column, Table


@pytest.fixture
def broken() -> Iterator[TextIO]:
    """Yield a pipe that nobody reads, as after ``| head``."""
    read, write = os.pipe()
    os.close(read)
    with os.fdopen(write, "w", buffering=1) as stream:
        yield stream


def test_the_work_goes_on_when_nobody_reads_the_answer(broken: TextIO, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stdout", broken)
    console.answer("first")
    console.answer_table(Table((Column("a"),), (("1",),)), "title")
    console.answer_json({"b": 1})
    broken.write("no error any more")


def test_every_object_begins_with_the_version_of_its_keys(capsys: pytest.CaptureFixture[str]) -> None:
    console.answer_json({"b": 1})
    console.answer_line({"b": 1})
    assert capsys.readouterr().out == '{\n "schema": 2,\n "b": 1\n}\n{"schema": 2, "b": 1}\n'


def test_the_work_goes_on_when_nobody_reads_its_progress(broken: TextIO, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stderr", broken)
    with console.progress(2) as progress:
        progress.step("one")
        progress.step("two")
    console.remark("saved")
    broken.flush()


def test_a_step_that_comes_again_is_told_once(capsys: pytest.CaptureFixture[str]) -> None:
    with console.progress(2) as progress:
        for text in ("delay", "friction", "delay", "fit"):
            progress.step(text)
    assert capsys.readouterr().err == "  delay\n  friction\n  fit\n"


def test_a_list_that_begins_with_a_minus_sign_is_a_value(capsys: pytest.CaptureFixture[str]) -> None:
    words = ["export", "none.json", "--to", "csv", "-o", "motion.csv", "--from-posture", "-1.5,0,.2"]
    assert main(words) == 1
    assert "none.json: there is no such file" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        main(["export", "none.json", "--to", "csv", "-o", "motion.csv", "--from-posture", "--check"])
    assert "--from-posture needs a value" in capsys.readouterr().err


def test_every_command_that_says_more_than_its_answer_can_be_quiet() -> None:
    own = next(action.choices for action in build_parser()._actions if action.dest == "command")
    assert isinstance(own, dict) and set(own) == set(COMMANDS)
    assert {name for name in COMMANDS if "--quiet" not in own[name].format_usage()} == {
        "completion", "environment", "list",
    }  # fmt: skip


@pytest.mark.parametrize("text", ["error: no such file", "warning: the log rests", "not accepted: gravity"])
def test_a_terminal_shows_the_first_word_in_colour(
    text: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.delenv("NO_COLOR", raising=False)
    monkeypatch.setenv("TERM", "xterm-256color")
    console.answer(text)
    assert capsys.readouterr().out == f"{text}\n"
    monkeypatch.setattr("sys.stdout.isatty", lambda: True)
    console.answer(text)
    shown = capsys.readouterr().out
    assert re.sub(r"\x1b\[[\d;]*m", "", shown) == f"{text}\n" and re.search(r"\x1b\[1;3[13]m", shown)
    monkeypatch.setenv("NO_COLOR", "1")
    console.answer(text)
    assert not re.search(r"\x1b\[[\d;]*3[13]m", capsys.readouterr().out)
