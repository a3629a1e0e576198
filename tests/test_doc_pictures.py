"""The pictures of the pages are those that their command draws, and the table beside them has its figures."""

from __future__ import annotations

import importlib.util
import re
import struct
import sys
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).resolve().parent.parent
PAGES = (ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")))


def _script() -> ModuleType:
    spec = importlib.util.spec_from_file_location("doc_pictures", ROOT / "scripts" / "doc_pictures.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["doc_pictures"] = module
    spec.loader.exec_module(module)
    return module


def _size(path: Path) -> tuple[int, int]:
    """Return width and height of a PNG."""
    return struct.unpack(">II", path.read_bytes()[16:24])


def test_every_symptom_has_its_picture_and_its_row() -> None:
    page = (ROOT / "docs" / "symptoms.md").read_text(encoding="utf-8")
    for symptom in _script().SYMPTOMS:
        assert f"](figures/symptom-{symptom.name}.png)\n" in page
        assert f"| [{symptom.name}](figures/symptom-{symptom.name}.png) |" in page


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_pictures_have_a_text_and_are_small(page: Path) -> None:
    for said, place in re.findall(r"!\[([^\]]*)\]\(([^)\s]+)\)", page.read_text(encoding="utf-8")):
        file = (page.parent / place).resolve()
        assert len(said) >= 15 and file.stat().st_size < 200_000, place


@pytest.mark.battery
@pytest.mark.parametrize("name", ["right", "jumps", "delay", "sign", "saturation", "short"])
def test_a_picture_comes_from_its_command(name: str, tmp_path: Path) -> None:
    script = _script()
    symptom = next(one for one in script.SYMPTOMS if one.name == name)
    row = script.draw(symptom, tmp_path)
    for file in tmp_path.iterdir():
        assert _size(file) == _size(ROOT / "docs" / "figures" / file.name)
    (stated,) = re.findall(rf"^\| \[{name}\].*$", (ROOT / "docs" / "symptoms.md").read_text(), re.MULTILINE)
    ours, theirs = ([cell.strip() for cell in line.split("|")[2:-1]] for line in (row, stated))
    assert float(ours[1]) == pytest.approx(float(theirs[1]), rel=0.1)
    assert (ours[0], *ours[3:]) == (theirs[0], *theirs[3:])
