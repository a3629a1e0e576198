"""The pictures of the pages are those that their command draws, and the table beside them has its figures."""

from __future__ import annotations

import re
import struct
from pathlib import Path

import pytest

from loaded_file import loaded_file

ROOT = Path(__file__).resolve().parent.parent
PAGES = (ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md")))

#: Pictures that another script, or the benchmark of speed, draws.
ELSEWHERE = {"front", "quickstart", "into-mujoco", "article-convergence"}


def _size(path: Path) -> tuple[int, int]:
    """Return width and height of a PNG."""
    return struct.unpack(">II", path.read_bytes()[16:24])


def test_every_symptom_has_its_picture_and_its_row() -> None:
    page = (ROOT / "docs" / "symptoms.md").read_text(encoding="utf-8")
    for symptom in loaded_file("scripts/doc_pictures.py").SYMPTOMS:
        assert f"](figures/symptom-{symptom.name}.png)\n" in page
        assert f"| [{symptom.name}](figures/symptom-{symptom.name}.png) |" in page


def test_every_picture_is_drawn_by_a_command_and_shown() -> None:
    script = loaded_file("scripts/page_pictures.py")
    drawn = {
        *script.PICTURES,
        *script.SCREENS,
        *(f"symptom-{one.name}" for one in loaded_file("scripts/doc_pictures.py").SYMPTOMS),
        *ELSEWHERE,
    }
    there = {file.stem for file in (ROOT / "docs" / "figures").iterdir() if not file.stem.startswith("scaling-")}
    shown = "".join(page.read_text(encoding="utf-8") for page in PAGES)
    assert there == drawn
    assert not [name for name in there if f"figures/{name}." not in shown]


@pytest.mark.battery
def test_pictures_of_pages_come_from_their_command(tmp_path: Path) -> None:
    from matplotlib.image import imread

    names = ["motion-limits", "filter", "points-krl", "virtual-cell", "payload", "track"]
    loaded_file("scripts/page_pictures.py").draw(names, tmp_path)
    for name in names:
        ours, theirs = imread(tmp_path / f"{name}.png"), imread(ROOT / "docs" / "figures" / f"{name}.png")
        assert ours.shape == theirs.shape and float(abs(ours - theirs).mean()) < 0.02, name


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_pictures_have_a_text_and_are_small(page: Path) -> None:
    for said, place in re.findall(r"!\[([^\]]*)\]\(([^)\s]+)\)", page.read_text(encoding="utf-8")):
        file = (page.parent / place).resolve()
        assert len(said) >= 15 and file.stat().st_size < 200_000, place


@pytest.mark.battery
@pytest.mark.parametrize("name", ["right", "jumps", "delay", "sign", "saturation", "short"])
def test_a_picture_comes_from_its_command(name: str, tmp_path: Path) -> None:
    script = loaded_file("scripts/doc_pictures.py")
    symptom = next(one for one in script.SYMPTOMS if one.name == name)
    row = script.draw(symptom, tmp_path)
    for file in tmp_path.iterdir():
        assert _size(file) == _size(ROOT / "docs" / "figures" / file.name)
    (stated,) = re.findall(rf"^\| \[{name}\].*$", (ROOT / "docs" / "symptoms.md").read_text(), re.MULTILINE)
    ours, theirs = ([cell.strip() for cell in line.split("|")[2:-1]] for line in (row, stated))
    assert float(ours[1]) == pytest.approx(float(theirs[1]), rel=0.1)
    assert (ours[0], *ours[3:]) == (theirs[0], *theirs[3:])
