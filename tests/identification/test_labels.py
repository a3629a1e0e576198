"""Labels of standard parameters, priors from files, and constraints that an estimator leaves aside."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dynident.case.prior_file import read_prior
from dynident.data.log import Log
from dynident.data.preprocessing import Preprocessing
from dynident.data.preprocessing.as_given import AsGiven
from dynident.diagnosis.warnings import warnings_of
from dynident.errors import DescriptionError, NotConsistent, UnknownChoice
from dynident.identification.build_problem import PriorKnowledge, build_problem
from dynident.identification.consistency.labels import IDENTIFIED, NOT_DETERMINED, ONLY_COMBINED, labels_of
from dynident.identification.estimators.consistent import Consistent
from dynident.identification.files.estimate_file import read_estimate, summary, write_estimate
from dynident.identification.identify import identify
from dynident.identification.problem.prior import BodyPrior
from dynident.model.body_constraints import BodyConstraints, Constraints, ValueRange
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction.viscous import Viscous
from dynident.model.inertia import Inertia
from dynident.model.robot import Link, Robot
from dynident.results.short_answer import labels_line

GIVEN = Preprocessing(AsGiven(), rest="keep")


@pytest.fixture
def made(planar_2r: Robot, exact_log: Callable[..., Log]) -> tuple[DynamicModel, Log]:
    model = DynamicModel(planar_2r, (Viscous(),))
    assert planar_2r.nominal is not None
    return model, exact_log(model, np.append(planar_2r.nominal, [0.5, 0.5]), noise=0.05)


def test_every_standard_parameter_has_a_label(made: tuple[DynamicModel, Log], tmp_path: Path) -> None:
    estimate = identify(made[0], [made[1]], Consistent(bodies="free"), GIVEN)
    labels = dict(zip([p.name for p in estimate.model.parameters], labels_of(estimate), strict=True))
    assert labels["Izz[link2]"].word == labels["Fv[joint1]"].word == IDENTIFIED
    assert labels["m[link2]"].word == ONLY_COMBINED  # with Izz and mx of link 1
    assert labels["Ixx[link1]"].word == labels["m[link1]"].word == NOT_DETERMINED
    assert labels["Fv[joint1]"].data_share == 1.0
    assert 0.999 < (labels["Izz[link2]"].data_share or 0) <= 1.0 and (labels["Ixx[link1]"].data_share or 0) < 1e-6
    counts = labels_line(estimate)
    assert counts.startswith("standard parameters: ") and counts.endswith("(the robot model's inertias)")
    write_estimate(estimate, tmp_path / "e.json")
    assert labels_of(read_estimate(tmp_path / "e.json")) == labels_of(estimate)
    facts = summary(estimate)["standard_parameters"]
    assert {row["label"] for row in facts} == {IDENTIFIED, ONLY_COMBINED, NOT_DETERMINED}
    assert labels_of(identify(made[0], [made[1]], "wls", GIVEN)) == ()


def test_a_share_is_the_variance_that_data_took(made: tuple[DynamicModel, Log]) -> None:
    """Against the dense inverse of the normal equations."""
    model, log = made
    problem = build_problem(model, [log], GIVEN)
    found = Consistent(pull=1e4, bodies="free").solve(problem)
    from dynident.identification.consistency.consistent_fit import pose_program, scale_of

    scale = scale_of(problem)
    program = pose_program(model, problem.base, problem.reduced(found.weights), scale, 1e4)
    prior = program.pull.T @ program.pull
    held = np.diag(prior) > 0
    after = np.diag(np.linalg.inv(program.data.T @ program.data + prior))
    expected = np.where(held, 1 - after * np.where(held, np.diag(prior), 0), 1.0)
    np.testing.assert_allclose(found.run.data_share, expected, atol=1e-8)


def test_a_little_known_parameter_is_one_of_the_prior(made: tuple[DynamicModel, Log]) -> None:
    noisy = replace(made[1], torque=np.asarray(made[1].torque) + 300 * np.random.default_rng(0).normal(size=(400, 2)))
    words = [label.word for label in labels_of(identify(made[0], [noisy], Consistent(pull=1e5, bodies="free"), GIVEN))]
    assert words[15] == NOT_DETERMINED  # Izz of link 2, which stands alone in a base parameter


def test_an_estimate_as_the_prior_of_another(made: tuple[DynamicModel, Log], tmp_path: Path) -> None:
    model, log = made
    bodies = [link.inertia for link in model.robot.links]
    assert bodies[0] is not None
    heavy = Link("link1", Inertia(9.0, bodies[0].first_moment, 3 * bodies[0].rotational))
    other = replace(model, robot=replace(model.robot, links=(heavy, model.robot.links[1])))
    write_estimate(identify(other, [log], Consistent(bodies="free"), GIVEN), tmp_path / "first.json")
    prior = read_prior(tmp_path / "first.json", model.robot)
    found = identify(model, [log], Consistent(bodies="free"), GIVEN, knowledge=PriorKnowledge(prior=prior))
    assert found.theta is not None and found.theta[9] == pytest.approx(9.0, rel=0.05)
    assert found.run.prior == "the estimate first.json"
    write_estimate(identify(model, [log], "wls", GIVEN), tmp_path / "base.json")
    with pytest.raises(DescriptionError, match="an estimate of base parameters only"):
        read_prior(tmp_path / "base.json", model.robot)


def test_a_prior_of_another_robot(made: tuple[DynamicModel, Log], spatial_3r: Robot, tmp_path: Path) -> None:
    model, log = made
    write_estimate(identify(model, [log], Consistent(bodies="free"), GIVEN), tmp_path / "e.json")
    assert json.loads((tmp_path / "e.json").read_text())["kind"] == "dynident estimate"
    with pytest.raises(DescriptionError, match=r"joint 'joint1': its frame is placed .* away"):
        read_prior(tmp_path / "e.json", spatial_3r)
    theta = np.tile(np.r_[1.0, 0, 0, 1, 0, -1, 0, 0, 0, 1], 2)
    names = tuple(parameter.name for parameter in model.parameters[:20])
    with pytest.raises(NotConsistent, match="link1 of the prior"):
        BodyPrior(theta, names, "x").for_model(model)
    with pytest.raises(UnknownChoice, match="link in the prior"):
        BodyPrior(theta[:10], names[:10], "x").for_model(model)


def test_constraints_reach_the_estimate_or_a_warning(made: tuple[DynamicModel, Log]) -> None:
    known = Constraints({"link2": BodyConstraints(mass=ValueRange(1.0, 1.25))})
    kept = identify(made[0], [made[1]], Consistent(bodies="free"), GIVEN, knowledge=PriorKnowledge(known))
    assert kept.theta is not None and kept.theta[19] <= 1.25 * (1 + 1e-6)
    left = identify(made[0], [made[1]], "wls", GIVEN, knowledge=PriorKnowledge(known))
    assert any("'wls' violates the stated constraints" in warning for warning in warnings_of(left))
    assert not any("does not keep" in warning for warning in warnings_of(kept))
