"""A plan as facts, tables and a page, alone and in the report of an estimate."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from defusedxml.ElementTree import fromstring
from drawings import check_labels
from synthetic import HOSTILE, arm, plan_of, subject_of

from dynident.errors import BadOption
from dynident.excitation.collision.clearance import clearance_of
from dynident.excitation.collision.workspace import HalfSpace, Workspace
from dynident.excitation.design.limits import LimitRow
from dynident.excitation.design.recheck import recheck
from dynident.model.dynamic_model import DynamicModel
from dynident.model.shapes import Box
from dynident.results.plan_view import (
    PAIRS,
    PlanView,
    clearance_table,
    criteria_table,
    inspection_data,
    limits_table,
    outlook_table,
    plan_facts,
    plan_remarks,
    verdict,
)
from dynident.results.report import build_plan_page, build_report

OUTLOOK = {
    "effective_sample_size": 800.0,
    "before": "first.json",
    "parameters": [
        {"name": "Fv[a]", "unit": "N m s/rad", "value": 2.0, "std_before": 0.5, "std_after": 0.02},
        {"name": "mx[a]", "unit": "kg m", "value": 0.5, "std_before": None, "std_after": 0.05},
        {"name": "Izz[b]", "unit": "kg m^2", "value": 0.0, "std_before": 0.1, "std_after": 0.01},
    ],
}


def around() -> Workspace:
    """Return a room with a floor below the arm and a box beside it."""
    box = Box(np.array([0.2, 0.2, 0.6]), np.eye(3), np.array([-0.8, 0.0, 0.2]))
    return Workspace({"floor": HalfSpace(np.array([0, 0, 1.0]), -0.9)}, {"shelf": box}, joint_radius=0.02)


@pytest.fixture(scope="module")
def whole() -> PlanView:
    """Return a plan with everything: robot, model, workspace, expected deviations."""
    robot = arm(("a", "b", "c"))
    model = DynamicModel(robot, ("viscous",))  # type: ignore[arg-type]
    theta = model.nominal()
    clearance = clearance_of(robot, around())
    plan = plan_of(robot, friction=["viscous"], outlook=OUTLOOK)
    check = recheck(plan, model, theta=theta, clearance=clearance)
    return PlanView(plan, check, robot, model, theta, around(), clearance, "the masses of the robot model", "plan.json")


@pytest.fixture(scope="module")
def alone() -> PlanView:
    plan = plan_of(arm(("a", "b", "c")))
    return PlanView(plan, recheck(plan))


def figures(page: str) -> list[str]:
    """Return the drawings of a page; fails where labels of one touch."""
    found = re.findall(r"<svg .*?</svg>", page, re.DOTALL)
    for figure in found:
        check_labels(figure)
    return found


def texts(page: str) -> str:
    """Return the words of a page."""
    return re.sub(r"\s+", " ", re.sub(r"<style>.*?</style>|<[^>]*>", " ", page, flags=re.DOTALL))


def test_facts_say_what_the_plan_is(whole: PlanView, alone: PlanView) -> None:
    facts = dict(plan_facts(whole))
    assert facts["trajectory"] == "fourier, 3 harmonics, period 4 s, run-in and run-out of 1 s; 6 s from rest to rest"
    assert facts["noise"] == "given; 1, 1, 2 N·m" and facts["search"] == "starts 2, seed 4, on 50 samples a period"
    assert facts["friction"] == "viscous" and "outlook" not in facts
    bare = dict(plan_facts(replace(alone, plan=replace(alone.plan, settings={}))))
    assert set(bare) == {"robot", "trajectory", "criterion"}


def test_tables_have_the_rows_of_the_check(whole: PlanView) -> None:
    rows = limits_table(whole).rows
    assert len(rows) == 15 and {row[-1] for row in rows} == {"again"}
    assert (*rows[10][:2], *rows[10][3:6]) == ("c", "acceleration", "–", "rad/s²", "–")
    assert [row[1] for row in rows[12:]] == ["torque"] * 3  # they were not in the file
    near = clearance_table(whole)
    values = [float(row[2]) - float(row[3]) for row in near.rows]
    assert len(near.rows) <= PAIRS and values == sorted(values) and near.rows[0][0] == "1"
    assert [row[:2] for row in criteria_table(whole).rows] == [("condition (designed for)", "12.50"), ("odd", "3.000")]
    assert len(criteria_table(whole).columns) == 4


def test_expected_deviations_are_sorted_and_say_what_was_known(whole: PlanView, alone: PlanView) -> None:
    table = outlook_table(whole.plan)
    assert table is not None
    assert [row[0] for row in table.rows] == ["Izz[b]", "mx[a]", "Fv[a]"]
    assert [row[-2:] for row in table.rows] == [("unknown", "unknown"), ("unknown", "10"), ("25", "1.0")]
    assert table.note == "Expected from 800 independent samples of each joint, all; known before: first.json."
    assert outlook_table(alone.plan) is None


def test_a_bound_that_is_passed_is_said_first(alone: PlanView) -> None:
    assert verdict(alone).startswith("Every bound is kept; nearest to its own is the ")
    near = LimitRow("b | floor", "clearance", "m", -0.02, 0.05, 1.5, 1.7)
    broken = replace(alone, check=replace(alone.check, rows=(*alone.check.rows, near), again=(True,) * 13))
    said = "1 bound is passed, worst the clearance of b | floor: -0.02000 of 0.05 m at 1.50 s. Do not drive it."
    assert verdict(broken) == said and not inspection_data(broken)["kept"]
    assert f'<p class="broken">{said.replace("%", "&nbsp;%")}</p>' in build_plan_page(broken)


def test_the_page_is_complete_in_itself(whole: PlanView) -> None:
    page = build_plan_page(whole)
    assert not re.search(r"<script|src=|href=\"(?!#)|url\(|@import", page)
    assert "default-src 'none'" in page and "<nav" not in page
    drawings = figures(page)
    assert len(drawings) == 2 + 3 and "Path of the tool" in drawings[1]
    said = texts(page)
    for words in ("Excitation of arm", "Nearest pairs", "Expected standard deviations", "How it was checked"):
        assert words in said
    assert "torque [N·m]" in drawings[2] and "Around it: floor, shelf." in drawings[1]
    assert "torques: computed again with the masses of the robot model" in said


def test_without_the_robot_the_page_asks_for_it(alone: PlanView) -> None:
    page = build_plan_page(alone)
    assert len(figures(page)) == 1 + 3 and "torque [N·m]" not in page
    assert "The path of the tool needs the robot" in texts(page) and "Nearest pairs" not in page
    assert "not checked: floor, obstacles, the robot itself (no workspace was given)" in plan_remarks(alone)


def test_the_robot_alone_is_enough_for_the_path(alone: PlanView) -> None:
    page = build_plan_page(replace(alone, robot=arm(("a", "b", "c"), sliding=True)))
    assert len(figures(page)) == 2 + 3


def test_names_of_a_plan_are_only_text() -> None:
    robot = arm(("<b>a</b>", "{{ 1 }}", '"c"'), name=HOSTILE[0])
    plan = plan_of(robot, friction=[HOSTILE[1]], odd=HOSTILE[2], outlook=OUTLOOK)
    view = PlanView(plan, recheck(plan), robot, source=HOSTILE[0])
    page = build_plan_page(view)
    figures(page)
    assert "<script" not in page and "<img" not in page and "<b>" not in page and "{{ 7 * 7 }}" in page
    for figure in re.findall(r"<svg .*?</svg>", page, re.DOTALL):
        fromstring(figure)


def test_the_report_has_the_plan_as_a_section(alone: PlanView) -> None:
    estimate, test = subject_of(arm(("a", "b", "c")), samples=300)
    page = build_report(estimate, [test], plan=replace(alone, robot=estimate.model.robot))
    assert '<section id="excitation">' in page and '<a href="#excitation">Excitation</a>' in page
    assert page.index('<section id="data">') < page.index('<section id="excitation">') < page.index('id="motion"')
    assert "excitation" not in build_report(estimate, [test])
    with pytest.raises(BadOption, match="its joints are a, b, c, those of the estimate joint1, joint2, joint3"):
        build_report(subject_of(samples=300)[0], plan=alone)
