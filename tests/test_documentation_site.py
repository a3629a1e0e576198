"""The documentation as a site: links lead somewhere, every page is listed, docstrings are named, the build is clean."""

from __future__ import annotations

import importlib
import json
import os
import re
import shutil
import subprocess
import sys
import unicodedata
from pathlib import Path

import pytest

import dynident
from loaded_file import loaded_file

ROOT = Path(__file__).resolve().parent.parent
PAGES = (ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md")))


def _name(page: Path) -> str:
    return page.relative_to(ROOT).with_suffix("").as_posix().removeprefix("docs/")


def _anchors_of(page: Path) -> set[str]:
    """Return the anchors of the headings of a page, as Python-Markdown makes them."""
    found: set[str] = set()
    text = re.sub(r"^```.*?^```$", "", page.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
    for heading in re.findall(r"^#+ (.*)$", text, re.MULTILINE):
        plain = unicodedata.normalize("NFKD", re.sub(r"[`*]|\]\([^)]*\)|\[", "", heading))
        word = re.sub(r"[^\w\s-]", "", plain.encode("ascii", "ignore").decode()).strip().lower()
        found.add(re.sub(r"[-\s]+", "-", word))
    return found


@pytest.mark.parametrize("page", PAGES, ids=_name)
def test_the_links_of_a_page_lead_somewhere(page: Path) -> None:
    """Every link to a file of the repository names one that is there, and every anchor a heading."""
    text = re.sub(r"^```.*?^```$|`[^`\n]*`", "", page.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
    for target in re.findall(r"\]\(([^)\s]+)\)", text):
        if re.match(r"https?:|mailto:", target):
            continue
        place, _, anchor = target.partition("#")
        file = (page.parent / place).resolve() if place else page
        assert file.exists(), f"{page.name}: {target}"
        if anchor:
            assert anchor in _anchors_of(file), f"{page.name}: {target}"


def test_every_page_is_in_the_navigation() -> None:
    """mkdocs.yml lists each page of docs once, and nothing else."""
    text = (ROOT / "mkdocs.yml").read_text(encoding="utf-8").partition("\nnav:\n")[2]
    listed = re.findall(r"[\w/-]+\.md", text)
    assert sorted(listed) == sorted(page.relative_to(ROOT / "docs").as_posix() for page in PAGES[1:])


def test_pages_are_short_and_have_pictures() -> None:
    """No page above 1,500 words of prose outside the reference; a picture on each tutorial and how-to page."""
    assert {page.path: page.fault for page in loaded_file("scripts/pages.py").pages() if page.fault} == {}


def test_words_of_prose_are_counted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Tables, code, comments and pictures are no prose."""
    script = loaded_file("scripts/pages.py")
    text = "# A title\n\nTwo [more words](x.md).\n\n![no word](a.png)\n\n| a | b |\n\n```text\nno\n```\n<!-- no -->\n"
    (tmp_path / "docs").mkdir()
    (tmp_path / "docs" / "page.md").write_text(text)
    monkeypatch.setattr(script, "ROOT", tmp_path)
    page = script.page_of("page.md", "How to")
    assert (page.prose, page.tables, page.pictures, page.fault) == (5, 2, 1, "")


#: What a fresh reader types, the page that answers, and the questions of a first minute with theirs.
SEARCHED = {
    "simulink": "into-simulators.html",
    "rosbag2": "your-robot/ros2.html",
    "condition number": "how-good-is-good.html",
    "which friction model": "which-friction-model.html",
    "how good is good": "how-good-is-good.html",
}


@pytest.mark.parametrize("phrase", SEARCHED)
def test_a_question_is_two_clicks_away(phrase: str) -> None:
    """The page is linked from the README or the first page of the documentation, or from a page linked there."""
    wanted = (ROOT / "docs" / SEARCHED[phrase]).with_suffix(".md")
    first = {file for start in (ROOT / "README.md", ROOT / "docs" / "index.md") for file in _linked(start)}
    assert wanted in first | {file for page in first for file in _linked(page)}
    assert re.search(rf"^#+ .*{phrase}", wanted.read_text(encoding="utf-8"), re.MULTILINE | re.IGNORECASE)


def _linked(page: Path) -> set[Path]:
    targets = re.findall(r"\]\(([^)\s#]+\.md)", page.read_text(encoding="utf-8"))
    return {(page.parent / target).resolve() for target in targets if ":" not in target}


@pytest.mark.battery
def test_the_site_builds_without_a_warning_and_opens_offline(tmp_path: Path) -> None:
    """What `make docs` does: warnings are errors, the search is a script, and no page asks another host."""
    program = shutil.which("mkdocs", path=os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]]))
    if program is None:
        pytest.skip("MkDocs is not installed: make docs")
    command = [program, "build", "--quiet", "--site-dir", str(tmp_path / "site")]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "site/search/search_index.js").read_text(encoding="utf-8").startswith("var __index = {")
    assert {page.relative_to(ROOT / "docs").with_suffix(".html") for page in PAGES[1:]} <= {
        page.relative_to(tmp_path / "site") for page in (tmp_path / "site").rglob("*.html")
    }
    index = (tmp_path / "site/search/search_index.js").read_text(encoding="utf-8").removeprefix("var __index = ")
    titles = [(entry["location"], entry["title"].lower()) for entry in json.loads(index.rstrip().rstrip(";"))["docs"]]
    for phrase, page in SEARCHED.items():  # a title weighs most in the search
        assert any(place.startswith(page) and phrase in title for place, title in titles), phrase
    assert not re.search(r"@import|url\([\"']?https?:", "".join(p.read_text() for p in tmp_path.rglob("*.css")))


def test_the_reference_of_python_names_what_is_there() -> None:
    """Modules and members of the pages that docstrings fill exist, and every name of the front door is among them."""
    shown: set[str] = {"DynidentError", "BadArgument"}
    for page in sorted((ROOT / "docs" / "api").glob("*.md")):
        for module, options in re.findall(r"^::: (\S+)\n((?:    .*\n?)*)", page.read_text(), re.MULTILINE):
            listed = re.search(r"members: \[(.*)\]", options)
            members = listed[1].split(", ") if listed else []
            assert all(hasattr(importlib.import_module(module), name) for name in members), f"{page.name}: {module}"
            shown.update(members)
    families = {
        "FRICTION",
        "CONTROLLERS",
        "FILTERS",
        "ESTIMATORS",
        "MOTION_EXPORTERS",
        "MODEL_EXPORTERS",
    }  # Family is shown
    assert {name for name in dir(dynident) if name in dynident._HOME_OF} <= shown | families
