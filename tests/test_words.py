"""The check of phrases finds them in messages, help, headings and templates, and leaves docstrings and names alone."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "scripts"))

import words  # noqa: E402

PHRASE = "the log has not seen it"


@pytest.mark.parametrize(
    ("place", "text"),
    [
        ("src/dynident/check.py", f'def f():\n    raise ValueError("{PHRASE}")\n'),
        ("src/dynident/check.py", f'def f(x):\n    return f"{{x}} {PHRASE}"\n'),
        ("src/dynident/cli/check.py", f'"""Say that {PHRASE}."""\n'),
        ("src/dynident/results/part.html", f"<p>{PHRASE}</p>\n"),
        ("src/dynident/studio/part.js", f'el("p", "{PHRASE}");\n'),
        ("docs/page.md", f"## Where {PHRASE}\n"),
    ],
    ids=["message", "formatted message", "help", "template", "page of the studio", "heading"],
)
def test_a_phrase_is_found_where_it_is_read(tmp_path: Path, place: str, text: str) -> None:
    _write(tmp_path, place, text)
    found = list(words.hits(tmp_path))
    assert [line.partition(":")[0] for line in found] == [place]
    assert "'has not seen'; write: training range" in found[0]


@pytest.mark.parametrize(
    "text", ["Give the robot description.", "`--rate`: rows a second", "dynident --split rows:0:1"]
)
def test_old_names_are_found_in_the_body_of_a_page(tmp_path: Path, text: str) -> None:
    _write(tmp_path, "docs/page.md", f"# Title\n\n{text}\n")
    assert len(list(words.hits(tmp_path))) == 1


@pytest.mark.parametrize(
    ("place", "text"),
    [
        ("src/dynident/check.py", f'"""{PHRASE}"""\n\n\ndef f():\n    """{PHRASE}"""\n'),
        ("src/dynident/check.py", "has_seen = believable = triangles = maker = {'mend': 1}\n"),
        ("src/dynident/studio/part.js", f"// {PHRASE}\n"),
        ("docs/page.md", f"{PHRASE}\n\n```\n# {PHRASE}\n```\n"),
        ("src/dynident/check.py", 'raise ValueError("break the triangle inequality, recommended by hand")\n'),
    ],
    ids=["docstring", "name", "comment", "text and code of a page", "right use"],
)
def test_what_is_right_is_left_alone(tmp_path: Path, place: str, text: str) -> None:
    _write(tmp_path, place, text)
    assert not list(words.hits(tmp_path))


def _write(root: Path, place: str, text: str) -> None:
    (root / "README.md").write_text("# Title\n", encoding="utf-8")
    (root / place).parent.mkdir(parents=True, exist_ok=True)
    (root / place).write_text(text, encoding="utf-8")
