"""Figures as files: stable names, one file a figure, the same bytes each time, the article's numbers for its robot."""

from __future__ import annotations

import importlib
import importlib.util
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from drawings import named, parsed
from synthetic import HOSTILE, arm, subject_of

from dynident.errors import FileError, MissingDependency, UnknownChoice
from dynident.identification.estimate.estimate import Estimate
from dynident.identification.estimate.validation import Validation
from dynident.results.figures.files import figure_file, file_stem
from dynident.results.report import Subject
from dynident.results.report.builder import parts_of, report_page
from dynident.results.report.figure_files import report_figures, write_figures
from dynident.results.report.sections.base import Drawing

needs_typst = pytest.mark.skipif(
    importlib.util.find_spec("typst") is None, reason="PDF and PNG need typst: pip install 'dynident[figures]'"
)


@pytest.fixture(scope="module")
def subject() -> Subject:
    estimate, test = subject_of(samples=400)
    return Subject(estimate, (test,))


@pytest.fixture(scope="module")
def figures(subject: Subject) -> dict[str, Drawing]:
    return report_figures(subject, parts_of(subject))


def test_every_figure_of_the_page_has_a_name(subject: Subject, figures: dict[str, Drawing]) -> None:
    page = report_page(subject, parts_of(subject))
    assert len(figures) == page.count("<figure")
    assert all(str(drawing) in page for drawing in figures.values())
    assert {"torque-joint1", "overview-joint3", "errors", "friction-joint2", "convergence"} <= figures.keys()
    assert not [name for name in figures if name.startswith("figure-")]


def test_the_files_are_svg_on_their_own(figures: dict[str, Drawing], tmp_path: Path) -> None:
    written = write_figures(tmp_path / "new" / "folder", figures)
    assert [path.name for path in written] == [f"{name}.svg" for name in figures]
    for path in written:
        root = parsed(path.read_text(encoding="utf-8"))
        left, _, width, _ = (float(part) for part in root.attrib["viewBox"].split())
        assert float(root.attrib["width"]) == width and left < 0
        assert "system-ui" not in root.attrib["font-family"] and named(root, "text")


def test_joints_that_no_file_could_be_named_after_keep_their_own_files(tmp_path: Path) -> None:
    estimate, test = subject_of(arm(HOSTILE), samples=200)
    subject = Subject(estimate, (test,))
    found = report_figures(subject, parts_of(subject))
    written = write_figures(tmp_path, found)
    assert len({path.name.lower() for path in written}) == len(found)
    assert all(path.parent == tmp_path and len(path.name) < 200 for path in written)
    assert "friction-script-alert-x-script" in found
    estimate, test = subject_of(arm(("arm/1", "arm:1", "ARM 1")), samples=200)
    subject = Subject(estimate, (test,))
    assert {"friction-arm-1", "friction-arm-1-2", "friction-arm-1-3"} <= report_figures(
        subject, parts_of(subject)
    ).keys()


@pytest.mark.parametrize(
    ("words", "stem"),
    [
        (("torque", "Test 1", "joint_1"), "torque-test-1-joint_1"),
        (("a/../b", ""), "a-..-b"),
        (("..",), "unnamed"),
        (("مفصل",), "unnamed"),
        (("x" * 400,), "x" * 64),
        ((), "unnamed"),
    ],
)
def test_names_of_files(words: tuple[str, ...], stem: str) -> None:
    assert file_stem(*words) == stem


def _as_article(estimate: Estimate, test: Validation) -> Subject:
    robot = replace(estimate.model.robot, name="er16")
    return Subject(replace(estimate, model=replace(estimate.model, robot=robot)), (test,))


def test_the_figures_of_the_article_have_its_numbers() -> None:
    estimate, test = subject_of(samples=300)
    found = report_figures(_as_article(estimate, test), ())
    assert [name.split("-")[1] for name in found] == ["4", "5", "6", "7", "8", "9"]
    alone = report_figures(replace(_as_article(estimate, test), tests=()), ())
    assert [name.split("-")[1] for name in alone] == ["4", "5", "6", "7"]
    assert "optimum" in found["figure-6-convergence"]
    several = subject_of(samples=300, logs=("a.csv", "b.csv"))
    assert report_figures(_as_article(*several), ()) == {}


@needs_typst
def test_pdf_and_png_are_the_same_each_time(figures: dict[str, Drawing], tmp_path: Path) -> None:
    drawing = figures["torque-joint1"]
    for format, mark in (("pdf", b"%PDF-"), ("png", b"\x89PNG")):
        (path,) = write_figures(tmp_path, {"one": drawing}, format)
        content = path.read_bytes()
        assert path.name == f"one.{format}" and content.startswith(mark)
        assert content == figure_file(drawing, *_said(drawing), format)


def _said(drawing: Drawing) -> tuple[str, str]:
    root = parsed(str(drawing))
    title, said = (named(root, tag)[0].text or "" for tag in ("title", "desc"))
    return title, said


@needs_typst
def test_hostile_texts_are_drawn_not_run() -> None:
    estimate, test = subject_of(arm(HOSTILE), samples=200)
    subject = Subject(estimate, (test,))
    for name, drawing in list(report_figures(subject, parts_of(subject)).items())[:9]:
        assert figure_file(drawing, "#panic()", '"#read("/etc/passwd")', "pdf").startswith(b"%PDF-"), name


def test_what_cannot_be_written_is_refused(
    figures: dict[str, Drawing], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    one = {"one": figures["convergence"]}
    with pytest.raises(UnknownChoice, match="svg, pdf, png"):
        write_figures(tmp_path, one, "jpg")
    (tmp_path / "file").write_text("")
    with pytest.raises(FileError, match="cannot be made"):
        write_figures(tmp_path / "file", one)

    def missing(name: str, *others: Any) -> Any:
        if name == "typst":
            raise ImportError(name)
        return real(name, *others)

    real = importlib.import_module
    monkeypatch.setattr(importlib, "import_module", missing)
    with pytest.raises(MissingDependency, match=r"pip install 'dynident\[figures\]'"):
        write_figures(tmp_path, one, "pdf")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file"]
