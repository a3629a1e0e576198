"""What commands answer: the one line of a refusal, and the keys of JSON that the documentation lists."""

from __future__ import annotations

from pathlib import Path

import pytest

from dynident.cli.main import main

PAGE = Path(__file__).resolve().parents[2] / "docs" / "json-output.md"


def documented(command: str) -> set[str]:
    """Return the keys of a command in docs/json-output.md, as written in its table."""
    _, found, rest = PAGE.read_text(encoding="utf-8").partition(f"<!-- json: {command} -->\n\n")
    assert found
    return {row.split("`")[1].removesuffix("[]") for row in rest.split("\n\n")[0].splitlines()[2:]}


def refused(capsys: pytest.CaptureFixture[str], *words: str) -> str:
    """Return the last line that a command prints that ends with exit code 1."""
    assert main(words) == 1
    out, err = capsys.readouterr()
    assert out == ""
    return err.splitlines()[-1]
