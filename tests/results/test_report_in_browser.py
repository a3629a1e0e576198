"""The report in a real browser without a network: silent, inside its window, zoomed, turned, read aloud, printed."""

from __future__ import annotations

import importlib.util
import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from synthetic import HOSTILE, arm, plan_of, renamed, subject_of

from browser import Browser, found
from browser import chromium as started_chromium
from dynident.excitation.design.recheck import recheck
from dynident.results.plan_view import PlanView
from dynident.results.report import write_report
from dynident.results.report.builder import write_plan_page

pytestmark = pytest.mark.skipif(found() is None, reason="no Chromium on this machine")

#: A telephone, a tablet, a screen.
WIDTHS = (360, 768, 1400)


@pytest.fixture(scope="module")
def chromium(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    with started_chromium(tmp_path_factory.mktemp("profile")) as one:
        yield Browser(one)


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A report with all its sections."""
    estimate, test = subject_of(samples=300, logs=("runs/train.csv", "runs/second.csv"))
    place = tmp_path_factory.mktemp("page") / "report.html"
    plan = plan_of(estimate.model.robot)
    view = PlanView(plan, recheck(plan), estimate.model.robot)
    write_report(place, estimate, [test], comparison=[{"method": "abc", "gap": "5 %"}], plan=view)
    return place


@pytest.fixture(scope="module")
def hostile(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A report in which every name is hostile."""
    robot = replace(arm(HOSTILE[:6], name=HOSTILE[0]), note=HOSTILE[2])
    facts: dict[str, Any] = {HOSTILE[1]: HOSTILE, "command": HOSTILE[0]}
    estimate, test = subject_of(robot, samples=200, logs=HOSTILE[:3], provenance=facts)
    place = tmp_path_factory.mktemp("hostile") / "report.html"
    write_report(place, replace(estimate, estimator=HOSTILE[1]), [renamed(estimate, test, [HOSTILE[5]])])
    return place


def check_quiet(chromium: Browser) -> None:
    assert chromium.complaints == []
    assert chromium.requests == []


@pytest.mark.parametrize("width", WIDTHS)
def test_nothing_is_asked_for_and_nothing_leaves_the_window(chromium: Browser, page: Path, width: int) -> None:
    chromium.open(page, width)
    check_quiet(chromium)
    assert chromium.js("document.documentElement.scrollWidth") <= width
    cut = "[...document.querySelectorAll('.scroll')].filter(box => box.scrollWidth > box.clientWidth + 1).length"
    assert chromium.js(cut) == 0


@pytest.mark.parametrize("width", WIDTHS[:2])
def test_hostile_names_change_nothing_but_text(chromium: Browser, hostile: Path, width: int) -> None:
    chromium.open(hostile, width)
    check_quiet(chromium)
    assert chromium.js("document.documentElement.scrollWidth") <= width
    assert chromium.js("document.images.length + document.querySelectorAll('iframe, form, object').length") == 0
    assert chromium.js("document.querySelector('h1').textContent").endswith(HOSTILE[0])
    chromium.js("document.querySelector('.bar button:nth-child(2)').click()")
    check_quiet(chromium)


def test_the_first_screen_shows_the_verdict_and_plots_and_the_contents_stay(chromium: Browser, page: Path) -> None:
    chromium.open(page, 1400, height=1000)
    ends = (
        "[...document.querySelectorAll('.word, .answer, .glance svg')].map(each => each.getBoundingClientRect().bottom)"
    )
    assert 300 < max(chromium.js(ends)) < 1000
    for width in WIDTHS:
        chromium.open(page, width, height=1000)
        chromium.js("document.querySelector('#provenance').scrollIntoView()")
        box = "document.querySelector('nav').getBoundingClientRect()"
        top, low = chromium.js(f"[{box}.top, {box}.bottom]")
        assert 0 <= top < low <= 1000
        heading = "document.querySelector('#provenance h2').getBoundingClientRect().top"
        assert chromium.js(heading) >= (low if width < 1000 else 0)


def test_long_tables_are_folded_on_the_screen_and_open_on_paper(chromium: Browser, page: Path) -> None:
    seen = "[...document.querySelectorAll('details table, details dl')].filter(each => each.checkVisibility()).length"
    count = "document.querySelectorAll('details table, details dl').length"
    chromium.open(page, 1200)
    assert chromium.js(seen) == 0 < chromium.js(count)
    chromium.open(page, 720, media="print")
    assert chromium.js(seen) == chromium.js(count)


def window_of(chromium: Browser) -> list[list[str]]:
    """Return the first and the last number below the axis of each torque figure of the first group."""
    ask = """[...document.querySelector('.linked').querySelectorAll('svg')].map(svg => {
        const texts = [...svg.querySelectorAll('.live text[text-anchor=middle]')]
            .map(text => text.textContent).filter(text => text !== 'training' && text !== 'test');
        return [texts[0], texts[texts.length - 1]]; })"""
    return chromium.js(ask)


def test_torques_are_zoomed_together_by_mouse_and_keys_and_come_back(chromium: Browser, page: Path) -> None:
    chromium.open(page, 1200)
    before = chromium.js("document.querySelector('.linked').innerHTML")
    whole = window_of(chromium)
    chromium.js("document.querySelector('.bar button:nth-child(2)').focus()")
    chromium.key("+")
    chromium.key("+")
    near = window_of(chromium)
    assert near[0] != whole[0] and near.count(near[0]) == len(near) == 3
    chromium.key("ArrowLeft")
    assert window_of(chromium) != near
    chromium.key("Home")
    assert chromium.js("document.querySelector('.linked').innerHTML") == before
    corner = "(() => { const box = document.querySelector('.linked svg').getBoundingClientRect();"
    chromium.js("document.querySelector('.linked').scrollIntoView({block: 'center'})")
    x, y, wide = chromium.js(f"{corner} return [box.x, box.y, box.width]; }})()")
    chromium.drag((x + 0.3 * wide, y + 90), (x + 0.5 * wide, y + 90))
    assert window_of(chromium) != whole
    chromium.js("document.querySelector('.bar button:nth-child(5)').click()")
    assert window_of(chromium) == whole
    check_quiet(chromium)


def test_the_robot_is_turned_by_mouse_and_keys(chromium: Browser, page: Path) -> None:
    chromium.open(page, 1200)
    sliders = "[...document.querySelectorAll('.bar input[type=range]')].map(slider => +slider.value)"
    drawn = "document.querySelector('.live-view').innerHTML"
    assert chromium.js(sliders) == [-58, 24]
    first = chromium.js(drawn)
    chromium.js("document.querySelector('.bar input').focus()")
    chromium.key("ArrowRight")
    assert chromium.js(sliders) == [-57, 24] and chromium.js(drawn) != first
    chromium.js("document.querySelector('.live-view').scrollIntoView({block: 'center'})")
    corner = (
        "(() => { const box = document.querySelector('.live-view').getBoundingClientRect(); return [box.x, box.y]; })()"
    )
    x, y = chromium.js(corner)
    chromium.drag((x + 200, y + 200), (x + 240, y + 220))
    assert chromium.js(sliders) == [-77, 34]
    ellipses = chromium.js("document.querySelectorAll('.live-view ellipse').length")
    chromium.js("document.querySelectorAll('.bar input[type=checkbox]')[1].click()")
    assert chromium.js("document.querySelectorAll('.live-view ellipse').length") < ellipses
    check_quiet(chromium)


def test_without_scripts_and_on_paper_the_figures_stand_still(chromium: Browser, page: Path) -> None:
    seen = "[...document.querySelectorAll('.turn > figure')].filter(figure => figure.offsetHeight > 50).length"
    chromium.call("Emulation.setScriptExecutionDisabled", value=True)
    try:
        chromium.open(page, 1200)
        assert chromium.js(seen) == 3
        assert chromium.js("document.querySelectorAll('.bar').length") == 0
        check_quiet(chromium)
    finally:
        chromium.call("Emulation.setScriptExecutionDisabled", value=False)
    chromium.open(page, 720, media="print")
    assert chromium.js(seen) == 3
    assert chromium.js("document.querySelector('.bar').offsetHeight") == 0
    assert chromium.js("document.documentElement.scrollWidth") <= 720


def test_the_page_of_a_plan_is_quiet_too(chromium: Browser, tmp_path: Path) -> None:
    robot = arm()
    plan = plan_of(robot)
    write_plan_page(tmp_path / "plan.html", PlanView(plan, recheck(plan), robot))
    chromium.open(tmp_path / "plan.html", 360)
    check_quiet(chromium)
    assert chromium.js("document.documentElement.scrollWidth") <= 360


@pytest.mark.skipif(importlib.util.find_spec("axe_core_python") is None, reason="axe needs the package axe-core-python")
@pytest.mark.parametrize("width", [360, *(pytest.param(width, marks=pytest.mark.battery) for width in WIDTHS[1:])])
@pytest.mark.parametrize("dark", [False, pytest.param(True, marks=pytest.mark.battery)])
def test_axe_finds_no_fault(chromium: Browser, page: Path, width: int, dark: bool) -> None:
    spec = importlib.util.find_spec("axe_core_python")
    assert spec is not None and spec.origin is not None
    chromium.open(page, width, dark=dark)
    chromium.call("Page.setBypassCSP", enabled=True)
    try:
        chromium.open(page, width, dark=dark)
        chromium.js(Path(spec.origin).with_name("axe.min.js").read_text(encoding="utf-8") + ";0")
        asked = (
            "axe.run(document, {resultTypes: ['violations']}).then(found => JSON.stringify(found.violations.map(each =>"
        )
        asked += " [each.id, each.impact, each.nodes.length, each.nodes[0].html.slice(0, 200)])))"
        assert json.loads(chromium.js(asked)) == []
    finally:
        chromium.call("Page.setBypassCSP", enabled=False)
