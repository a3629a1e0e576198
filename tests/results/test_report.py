"""The page as a whole: complete in itself, inert, in order, and whatever a name says is only text."""

from __future__ import annotations

import base64
import hashlib
import html
import re
from collections.abc import Iterator
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from drawings import check_labels
from synthetic import HOSTILE, arm, plan_of, renamed, subject_of

from dynident.data.log import Log, Source
from dynident.errors import FileError, LogMismatch
from dynident.excitation.design.recheck import recheck
from dynident.exports.models.proving.followed_motion import FollowedMotion, MotionProof
from dynident.identification.estimate.estimate import Estimate
from dynident.identification.estimate.validation import Validation
from dynident.identification.problem.choices import Choices, DelayRecord
from dynident.identification.problem.method_run import MethodRun
from dynident.model.robot import Robot
from dynident.results.model_export_view import not_run_lines
from dynident.results.plan_view import PlanView
from dynident.results.report import Comparison, Subject, build_report, builder, write_report
from dynident.results.report.builder import ORDER, render, section_names
from dynident.results.report.sections import SECTIONS

VOID = {"meta", "br"}


class Page(HTMLParser):
    """The elements of a page; checks that they are closed in order."""

    def __init__(self, text: str) -> None:
        super().__init__(convert_charrefs=True)
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.words: list[str] = []
        self.open: list[str] = []
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.words.append(data)

    @property
    def sections(self) -> list[str]:
        return [attrs["id"] or "" for tag, attrs in self.elements if tag == "section"]


@pytest.fixture(scope="module")
def case() -> tuple[Estimate, Validation]:
    return subject_of(logs=("runs/train.csv", "runs/second.csv"))


@pytest.fixture(scope="module")
def whole(case: tuple[Estimate, Validation]) -> str:
    estimate, test = case
    reference = Log(estimate.model.robot.joint_names, test.time, test.q, test.dq)
    rows: list[dict[str, Any]] = [{"method": "abc", "gap": "5 %"}, {"method": "ols", "gap": "1 %"}]
    found = Choices(delays=(DelayRecord("train.csv", 2.95e-3, 8.8e-4, 2.95e-3),))
    plan = plan_of(estimate.model.robot)
    trust = {"verdicts": ["residuals are white (before the filter)"], "joints": [], "parts": [], "cross_validation": []}
    return build_report(
        replace(estimate, choices=found, diagnostics=trust),
        [test],
        comparison=Comparison(tuple(rows), {"another": [5.0, 4.0, 3.0]}),
        trajectories={"excitation": reference},
        command="dynident report arm.json \\\n  -o report.html",
        sources=[Source("runs/test.csv", "ab" * 32, 1500)],
        plan=PlanView(plan, recheck(plan), estimate.model.robot),
        motion=simulated(),
    )


def simulated() -> MotionProof:
    """Return runs of which one diverged and one was not made."""
    runs = (
        FollowedMotion("dynident", "computed_torque", 0.001, 10.0, (1e-5, 2e-5, 1e-4), 1e-4),
        FollowedMotion("dynident", "pd", 0.001, 10.0, (0.5, 0.1, 0.2), 1.2, "<b>wrist</b> is lost at 3 s"),
        FollowedMotion("MuJoCo", "pd", 0.002, why_not="not installed"),
    )
    return MotionProof("runs/test.csv", 2.5, 10.0, runs, (40.0, 50.0), None)


def test_a_motion_that_is_followed_in_part_says_why() -> None:
    proof = simulated()
    short = replace(proof, runs=(replace(proof.runs[0], duration=0.6), *proof.runs[1:]))
    assert [line for line in not_run_lines(short) if line not in not_run_lines(proof)] == [
        "dynident: the first 0.6 s only; friction of a light joint asks for steps of 2 µs at most, and no more than"
        " 300,000 are made"
    ]


def drawings(text: str) -> Iterator[str]:
    """Yield the figures of a page."""
    yield from re.findall(r"<figure>(<svg.*?</svg>)</figure>", text, flags=re.DOTALL)


def allowed(content: str) -> str:
    """Return the source of a policy that allows a style or a script and no other."""
    return f"'sha256-{base64.b64encode(hashlib.sha256(content.encode()).digest()).decode()}'"


def check_inert(text: str) -> Page:
    """Fail where a page could load or run anything."""
    page = Page(text)
    tags = {tag for tag, _ in page.elements}
    assert not tags & {"img", "link", "iframe", "object", "embed", "form", "base", "use", "image", "foreignobject"}
    for _, attributes in page.elements:
        assert not [name for name in attributes if name.startswith("on") or name in ("src", "style", "xlink:href")]
        assert (attributes.get("href") or "#").startswith("#")
        for name, value in attributes.items():
            assert "://" not in (value or "") or name == "xmlns"
    scripts = re.findall(r"<script>(.*?)</script>", text, flags=re.DOTALL)
    assert len(scripts) == text.count("<script") == text.count("</script")
    style = text.partition("<style>")[2].partition("</style>")[0]
    assert "@import" not in style and "url(" not in style
    policy = next(a["content"] or "" for tag, a in page.elements if tag == "meta" and "http-equiv" in a)
    assert policy.startswith("default-src 'none'; ")
    assert f"style-src {allowed(style)};" in policy
    assert policy.count("sha256-") == 1 + len(scripts)
    assert (f"script-src {' '.join(map(allowed, scripts))};" in policy) if scripts else "script-src" not in policy
    return page


def test_the_page_is_inert_and_has_all_sections_in_order(whole: str) -> None:
    page = check_inert(whole)
    assert page.sections == list(ORDER)
    links = [attrs["href"] for tag, attrs in page.elements if tag == "a"]
    assert links == [f"#{name}" for name in ORDER]
    identifiers = [attrs["id"] for _, attrs in page.elements if attrs.get("id")]
    assert len(identifiers) == len(set(identifiers))


def test_every_figure_is_well_formed_and_its_labels_do_not_touch(whole: str) -> None:
    found = list(drawings(whole))
    at_first, torques, residuals, friction, motion, units = 1 + 3, 3, (3 + 1) * 2, 3, 2 * 3, 4
    assert len(found) == at_first + torques + residuals + friction + motion + units + 1 + (1 + 1 + 3) + 3
    for drawing in found:
        check_labels(html.unescape(drawing) if "&nbsp;" in drawing else drawing)


def test_the_page_says_what_matters(whole: str) -> None:
    words = " ".join(" ".join(Page(whole).words).split())
    for wanted in (
        "Identification of arm",
        "test error of the torque",
        "pseudo-inertia positive definite for each link",
        "train.csv, second.csv; a gap stands between two logs",
        "sha256 " + "ab" * 32,
        "Filter: kind five_point, order 3, repeats 10",
        "dynident report arm.json \\ -o report.html",
        "Reference: excitation",
        "Test, as recorded: test.csv",
        "numpy 2.4.6",
        "this motion: 10 s of runs/test.csv from 2.5 s on",
        "<b>wrist</b> is lost at 3 s",
        "not simulated with MuJoCo: not installed",
        "median 40.0, largest 50.0; the robot model states no inertias for every link",
    ):
        assert wanted in words, wanted


def test_sections_with_nothing_to_show_leave_themselves_out() -> None:
    estimate, _ = subject_of(standard=False, friction=(), samples=300)
    bare = replace(estimate, run=MethodRun(), provenance={})
    page = check_inert(build_report(bare))
    assert "data-zoom" in build_report(bare) and "<script>" not in render(Subject(bare), ["verdict", "friction"])
    assert set(ORDER) - set(page.sections) == {
        "log_quality", "excitation", "bodies", "nominal", "trust", "friction", "choices", "convergence", "comparison",
        "simulation",
    }  # fmt: skip
    without_rows = replace(
        bare.train, **{name: np.zeros((0, 3)) for name in ("q", "dq", "measured", "unfiltered", "predicted")}
    )
    empty = replace(bare, train=replace(without_rows, time=np.zeros(0), samples=0))
    page = check_inert(build_report(empty))
    assert page.sections == ["verdict", "parameters", "mass_distribution", "mass_matrix", "robot", "provenance"]


def hostile() -> tuple[Estimate, Validation]:
    """Return an estimate in which every name is hostile."""
    robot: Robot = arm(HOSTILE, name=HOSTILE[0])
    robot = replace(robot, base=HOSTILE[1], note=HOSTILE[2])
    estimate, test = subject_of(
        robot, samples=300, logs=HOSTILE[:3], consistent=False, provenance={HOSTILE[1]: HOSTILE, "command": HOSTILE[0]}
    )
    consistency = replace(estimate.consistency, reasons=HOSTILE)
    return replace(estimate, consistency=consistency, estimator=HOSTILE[1], options={HOSTILE[0]: HOSTILE[3]}), test


def test_hostile_names_are_only_text() -> None:
    estimate, test = hostile()
    reference = Log(estimate.model.robot.joint_names, test.time, test.q)
    text = build_report(
        estimate,
        [renamed(estimate, test, [HOSTILE[0]]), test],
        comparison=Comparison(tuple({name: name} for name in HOSTILE), {HOSTILE[1]: [3.0, 2.0]}, 1.0, HOSTILE[0]),
        trajectories={HOSTILE[1]: reference},
        sources=[Source(HOSTILE[0], HOSTILE[1], 3, HOSTILE)],
    )
    page = check_inert(text)
    words = "".join(page.words)
    assert HOSTILE[0] in words
    assert HOSTILE[2].replace(" %", "\u00a0%") in words  # a template in a name is not run
    assert "(no name)" in words
    assert "\\u202eabc" in words and "\u202e" not in text and "\x00" not in text
    for drawing in drawings(text):
        check_labels(drawing)


def test_a_new_section_stands_before_the_last(monkeypatch: pytest.MonkeyPatch) -> None:
    assert set(SECTIONS.names()) == set(ORDER)
    monkeypatch.setattr(SECTIONS, "names", lambda: ("another", *sorted(ORDER)))
    assert section_names() == (*ORDER[:-1], "another", ORDER[-1])


def test_every_section_has_a_title_and_a_template_and_every_template_a_section() -> None:
    folder = Path(builder.__file__).parent / "templates"
    used = {SECTIONS.get(name).template for name in SECTIONS.names()}
    assert used == {f"{name}.html" for name in SECTIONS.names()}
    shared = {
        "report.html",
        "style.css",
        "cards.css",
        "page.css",
        "_parts.html",
        "actuators.html",
        "difference.html",
        "zoom.js",
        "turn.js",
        "benchmark.html",
    }
    assert {path.name for path in folder.iterdir()} == used | shared
    titles = [SECTIONS.get(name).title for name in SECTIONS.names()]
    assert all(titles) and len(set(titles)) == len(titles)


def test_some_sections_only(case: tuple[Estimate, Validation]) -> None:
    estimate, test = case
    assert Page(render(Subject(estimate, (test,)), ["verdict", "validation"])).sections == ["verdict", "validation"]


def test_writing(case: tuple[Estimate, Validation], tmp_path: Path) -> None:
    estimate, test = case
    path = tmp_path / "report.html"
    write_report(path, estimate, [test])
    assert path.read_text(encoding="utf-8") == build_report(estimate, [test])
    assert [found.name for found in tmp_path.iterdir()] == ["report.html"]
    with pytest.raises(FileError, match="there is no folder"):
        write_report(tmp_path / "no" / "report.html", estimate)


def test_the_same_estimate_gives_the_same_page(case: tuple[Estimate, Validation]) -> None:
    estimate, test = case
    assert build_report(estimate, [test]) == build_report(estimate, [test])


def test_other_joints_are_refused(case: tuple[Estimate, Validation]) -> None:
    estimate, test = case
    other = replace(test, joints=tuple(replace(fit, name=f"{fit.name}x") for fit in test.joints))
    with pytest.raises(LogMismatch) as found:
        build_report(estimate, [other])
    assert str(found.value) == (
        "runs/test.csv: the joints joint1x, joint2x, joint3x; the robot has joint1, joint2, joint3; "
        "validate with the estimate that the report is about"
    )
    reference = Log(("a", "b", "c"), test.time, test.q)
    with pytest.raises(LogMismatch, match="no joint called 'joint1'"):
        build_report(estimate, trajectories={"excitation": reference})


def test_references_are_matched_by_name(case: tuple[Estimate, Validation]) -> None:
    estimate, test = case
    turned = Log(("joint3", "joint1", "joint2"), test.time, test.q[:, [2, 0, 1]])
    subject = Subject(estimate, trajectories={"excitation": turned})
    assert np.array_equal(subject.trajectories["excitation"].q, test.q)


def test_a_long_log_of_seven_joints_stays_small() -> None:
    names = [f"joint{k}" for k in range(1, 8)]
    estimate, test = subject_of(arm(names), samples=25_000, rate=1000.0)
    spread, noise = np.random.default_rng(1).uniform(0.05, 0.15, test.measured.shape), np.full(7, 0.4)
    estimate = replace(estimate, train=replace(estimate.train, deviations=spread, noise=noise))
    test = replace(test, deviations=spread, noise=noise)
    assert len(build_report(estimate, [test]).encode()) < 3_000_000
