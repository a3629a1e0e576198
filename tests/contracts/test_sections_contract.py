"""What every section of the report must do: show a subject without changing it, in finite numbers, joint by joint."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from dynident.data.log import Log
from dynident.data.preprocessing import Preprocessing
from dynident.data.preprocessing.as_given import AsGiven
from dynident.identification.identify import identify
from dynident.identification.validate import validate
from dynident.model.dynamic_model import DynamicModel
from dynident.model.robot import Robot
from dynident.results.report.builder import render
from dynident.results.report.sections import SECTIONS
from dynident.results.report.sections.base import ReportSection
from dynident.results.report.subject import Subject

PARTS = SECTIONS.names()
GIVEN = Preprocessing(AsGiven(), rest="keep")

#: What stands on a page in place of a number that does not exist.
NO_NUMBER = re.compile(r"(?<![\w-])(nan|inf|None)(?![\w-])")


def made(robot: Robot, exact_log: Callable[..., Log]) -> Subject:
    model = DynamicModel(robot, ("coulomb", "viscous"))  # type: ignore[arg-type]
    assert robot.nominal is not None
    theta = np.append(robot.nominal, np.tile([1.0, 0.5], robot.dof))
    logs = [exact_log(model, theta, noise=0.05, seed=seed, samples=300) for seed in (0, 1)]
    estimate = identify(model, logs[:1], "consistent", preprocessing=GIVEN)
    return Subject(estimate, (validate(estimate, logs[1:]),))


@pytest.fixture(scope="module")
def subject(planar_2r: Robot, exact_log: Callable[..., Log]) -> Subject:
    return made(planar_2r, exact_log)


@pytest.fixture(params=PARTS)
def name(request: pytest.FixtureRequest) -> str:
    return request.param


def text(page: str) -> str:
    """Return what a reader sees: no tags, no drawings, no style."""
    plain = re.sub(r"(?s)<(script|style|svg|head)\b.*?</\1>", " ", page)
    return re.sub(r"<[^>]+>", " ", plain)


def test_titles_and_templates_are_its_own(name: str) -> None:
    part: ReportSection = SECTIONS.make(name)
    assert part.title and part.template.endswith(".html")
    others = [SECTIONS.get(other) for other in PARTS if other != name]
    assert part.title not in {other.title for other in others}


def test_it_shows_without_changing_and_shows_the_same_again(name: str, subject: Subject) -> None:
    estimate = subject.estimate
    arrays = (estimate.beta, estimate.covariance, estimate.train.q, estimate.train.residual, *subject.tests[0].starts)
    before = [np.array(value) for value in arrays]
    first, again = (SECTIONS.make(name).context(subject) for _ in range(2))
    assert isinstance(first, dict) and first.keys() == again.keys() and repr(first) == repr(again)
    assert render(subject, [name]) == render(subject, [name])
    for value, kept in zip(arrays, before, strict=True):
        np.testing.assert_array_equal(value, kept)


def test_it_prints_no_number_that_does_not_exist(name: str, subject: Subject) -> None:
    found = NO_NUMBER.findall(text(render(subject, [name])))
    assert not found, found


def test_what_has_nothing_to_show_is_left_out(name: str, subject: Subject) -> None:
    """An empty context leaves no heading; any other has its title on the page."""
    page, part = render(subject, [name]), SECTIONS.make(name)
    heading = re.search(rf"<h2[^>]*>\s*{re.escape(part.title)}", page)
    assert bool(heading) == bool(part.context(subject))


def test_no_test_is_no_accident(name: str, subject: Subject) -> None:
    page = render(replace(subject, tests=()), [name])
    assert page.startswith("<!") and not NO_NUMBER.findall(text(page))


def test_bad_figures_of_a_fit_are_words_and_not_numbers(name: str, subject: Subject) -> None:
    """Deviations that do not exist, as of a fit without degrees of freedom."""
    estimate = subject.estimate
    broken = replace(estimate, covariance=np.full_like(estimate.covariance, np.nan))
    assert render(replace(subject, estimate=broken), [name]).startswith("<!")


@pytest.mark.parametrize("name", ["motion", "parameters", "residuals", "torques", "validation"])
def test_every_joint_is_named(name: str, subject: Subject) -> None:
    page = text(render(subject, [name])) + str(render(subject, [name]))
    assert all(joint in page for joint in subject.estimate.model.robot.joint_names)
