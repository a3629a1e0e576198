"""Plausible bodies: the distance, the rule of the weight, and mass ranges that the data contradict."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg
import scipy.optimize

from dynident.arrays import Array
from dynident.data.log import Log
from dynident.data.preprocessing import Preprocessing
from dynident.data.preprocessing.as_given import AsGiven
from dynident.identification.build_problem import build_problem
from dynident.identification.consistency.consistent_fit import scale_of
from dynident.identification.consistency.plausible_fit import (
    ENOUGH,
    MOST,
    largest_weight,
    nominal_bodies,
    plausible_fit,
    pull_rows,
)
from dynident.identification.estimate.plausibility import TOTAL_MASS, Plausibility
from dynident.identification.estimators.consistent import Consistent
from dynident.identification.estimators.wls import WLS
from dynident.identification.problem.method_run import recorded_run
from dynident.identification.problem.problem import Problem
from dynident.model.body_constraints import BodyConstraints, Constraints, ValueRange
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import FRICTION
from dynident.model.inertia import Inertia
from dynident.model.plausible import plausible_constraints, uniform_body
from dynident.model.robot import Link, Robot

GIVEN = Preprocessing(AsGiven(), rest="keep")

MakeLog = Callable[..., Log]


def problem_of(robot: Robot, make: MakeLog, nominal: Robot | None = None, seed: int = 0) -> tuple[Problem, Array]:
    """Return the problem of a log of ``robot`` with noise of 2 %, by the model of ``nominal``, and the true theta."""
    model = DynamicModel(robot, (FRICTION.make("viscous"),))
    assert robot.nominal is not None
    theta = np.append(robot.nominal, np.ones(robot.dof))
    size = 0.02 * np.std(np.asarray(make(model, theta).torque), axis=0)
    log = make(model, theta, noise=size, seed=seed)
    return build_problem(replace(model, robot=nominal or robot), [log], GIVEN), theta


def scaled_link(robot: Robot, index: int, factor: float) -> Robot:
    links = list(robot.links)
    inertia = links[index].inertia
    assert inertia is not None
    links[index] = replace(links[index], inertia=Inertia.from_vector(factor * inertia.vector))
    return replace(robot, links=tuple(links))


def without_inertia(robot: Robot, index: int, inertia: Inertia | None = None) -> Robot:
    links = list(robot.links)
    links[index] = Link(links[index].name, inertia)
    return replace(robot, links=tuple(links))


def weights_of(problem: Problem) -> Array:
    return np.asarray(WLS().solve(problem).weights)


@pytest.mark.parametrize("bare", [(), (1,), (0, 1, 2)])
def test_the_rows_are_the_pull_back_distance(spatial_3r: Robot, exact_log: MakeLog, bare: tuple[int, ...]) -> None:
    """Against matrix square roots; a common density of bodies without a stated mass by a bounded search."""
    robot = spatial_3r
    for index in bare:
        robot = without_inertia(robot, index)
    problem, _ = problem_of(spatial_3r, exact_log, robot)
    scale, bounds = scale_of(problem), plausible_constraints(robot)
    nominal, is_stated, uniform = nominal_bodies(robot, bounds, None)
    assert uniform == [f"link{index + 1}" for index in bare]
    matrix, aim = pull_rows(scale, nominal, is_stated, np.ones(3, bool))
    assert spatial_3r.nominal is not None
    theta = spatial_3r.nominal * np.random.default_rng(2).uniform(0.7, 1.4, 30)
    phi = np.append(theta, np.zeros(3)) / scale.parameters

    def distance(density: float) -> float:
        total = 0.0
        for ten, own, stated in zip(theta.reshape(-1, 10), nominal, is_stated, strict=True):
            centre = Inertia.from_vector(own).pseudo
            root = np.linalg.inv(scipy.linalg.sqrtm(centre))
            change = root @ Inertia.from_vector(ten).pseudo @ root - (1.0 if stated else density) * np.eye(4)
            total += float(np.sum(change**2))
        return total

    best = scipy.optimize.minimize_scalar(distance, bounds=(1.0, 1e7), method="bounded", options={"xatol": 1e-3}).fun
    assert np.sum((matrix @ phi - aim) ** 2) == pytest.approx(best if bare else distance(1.0), rel=1e-6)


def test_a_uniform_body_is_that_of_points_in_its_ellipsoid(spatial_3r: Robot) -> None:
    body = plausible_constraints(spatial_3r).links["link2"]
    space = body.body_ellipsoid
    assert space is not None
    points = np.random.default_rng(0).normal(size=(200_000, 3))
    points *= (np.random.default_rng(1).random(len(points)) ** (1 / 3) / np.linalg.norm(points, axis=1))[:, None]
    lifted = np.column_stack([points * space.semi_axes @ space.rotation.T + space.centre, np.ones(len(points))])
    volume = 4 / 3 * np.pi * np.prod(space.semi_axes)
    np.testing.assert_allclose(uniform_body(body).pseudo, volume * lifted.T @ lifted / len(points), atol=2e-3 * volume)


@pytest.mark.parametrize("power", [0.3, 1.0, 2.0])
@pytest.mark.parametrize("size", [1e-3, 1.0, 1e3])
def test_the_weight_takes_up_the_limit(power: float, size: float) -> None:
    weight, rise = largest_weight(lambda v: size * v**power, 30.0)
    assert rise == size * weight**power <= 30.0
    assert rise >= ENOUGH * 30.0 or weight == MOST


def test_no_weight_where_the_least_costs_too_much_and_the_most_where_all_are_free() -> None:
    assert largest_weight(lambda v: 50.0, 30.0) == (0.0, 0.0)
    assert largest_weight(lambda v: 0.0, 30.0) == (MOST, 0.0)


def test_the_cost_rises_within_its_limit_and_the_answer_comes_nearer(spatial_3r: Robot, exact_log: MakeLog) -> None:
    nominal = spatial_3r
    for index, factor in ((0, 1.3), (1, 0.7), (2, 1.3)):
        nominal = scaled_link(nominal, index, factor)
    problem, _ = problem_of(spatial_3r, exact_log, nominal)
    weights = weights_of(problem)
    found = plausible_fit(problem, weights, 0.01, 1e-8)
    bounds = plausible_constraints(nominal)
    bodies, is_stated, _ = nominal_bodies(nominal, bounds, None)
    scale, reduced = scale_of(problem), problem.reduced(weights)
    matrix, aim = pull_rows(scale, bodies, is_stated, np.ones(3, bool))
    free = Consistent().solve(problem)
    assert free.theta is not None
    near, far = (np.linalg.norm(matrix @ (t / scale.parameters) - aim) for t in (found.fit.theta, free.theta))
    assert near < far
    cost, least = (reduced.residual_square(b) for b in (problem.base.from_standard(found.fit.theta), free.beta))
    assert (cost - least) * reduced.rows / reduced.rest <= 1.05 * found.facts.cost_limit
    assert ENOUGH * found.facts.cost_limit <= found.facts.cost_rise <= found.facts.cost_limit
    assert found.facts.contradicted == () and found.fit.optimality.gap < 1e-6


@pytest.mark.parametrize("factor", [0.1, 8.0])
def test_a_wrong_mass_of_the_robot_model_is_relaxed_and_named(
    spatial_3r: Robot, exact_log: MakeLog, factor: float
) -> None:
    problem, truth = problem_of(spatial_3r, exact_log, scaled_link(spatial_3r, 2, factor))
    solution = Consistent(bodies="plausible").solve(problem)
    facts = Plausibility.of(recorded_run(json.loads(json.dumps(solution.run.data()))))
    assert facts is not None
    relaxed = {mass.name for mass in facts.contradicted if mass.is_relaxed}
    assert "link3" in relaxed and "link2" not in relaxed
    for mass in facts.contradicted:
        assert mass.statistic > mass.limit and mass.gain > 0
    beta = problem.base.from_standard(truth)
    assert np.abs(solution.beta - beta).max() < 0.1 * np.abs(beta).max()


@pytest.mark.parametrize("seed", range(4))
def test_nothing_is_relaxed_where_the_robot_model_is_right(spatial_3r: Robot, exact_log: MakeLog, seed: int) -> None:
    problem, truth = problem_of(spatial_3r, exact_log, seed=seed)
    found = plausible_fit(problem, weights_of(problem), 0.01, 1e-8)
    assert found.facts.contradicted == ()
    assert found.facts.weight > 1.0  # the nominal bodies are the true ones
    masses = found.fit.theta[9:30:10] / truth[9:30:10]
    np.testing.assert_allclose(masses, 1.0, atol=0.1)


def test_a_stated_mass_is_kept_and_named(spatial_3r: Robot, exact_log: MakeLog) -> None:
    problem, _ = problem_of(spatial_3r, exact_log)
    stated = Constraints({"link3": BodyConstraints(mass=ValueRange(high=0.3))}, ValueRange(high=100.0))
    found = plausible_fit(replace(problem, constraints=stated), weights_of(problem), 0.01, 1e-8)
    kept = {mass.name: mass.is_relaxed for mass in found.facts.contradicted}
    assert kept["link3"] is False and TOTAL_MASS not in kept
    assert found.fit.theta[29] <= 0.3 * (1 + 1e-6)


def test_a_link_of_impossible_inertia_keeps_its_mass(spatial_3r: Robot, exact_log: MakeLog) -> None:
    flat = Inertia(3.0, np.array([0.6, 0.1, 0.0]), np.diag([0.0, 0.1, 0.1]))
    robot = without_inertia(spatial_3r, 2, flat)
    nominal, is_stated, uniform = nominal_bodies(robot, plausible_constraints(robot), None)
    assert uniform == ["link3"] and is_stated.all()
    assert nominal[2, 9] == pytest.approx(3.0) and Inertia.from_vector(nominal[2]).is_consistent()
    np.testing.assert_allclose(nominal[1], spatial_3r.links[1].inertia.vector)  # type: ignore[union-attr]


def test_draws_of_the_bootstrap_keep_the_bounds(spatial_3r: Robot, exact_log: MakeLog) -> None:
    problem, _ = problem_of(spatial_3r, exact_log, scaled_link(spatial_3r, 1, 0.5))
    weights = weights_of(problem)
    found = plausible_fit(problem, weights, 0.01, 1e-8)
    refit = Consistent(bodies="plausible").refit(problem)
    reduced = problem.reduced(weights)
    np.testing.assert_allclose(refit(reduced), found.fit.theta, rtol=1e-4, atol=1e-6)
    moved = refit(replace(reduced, z=1.5 * reduced.z))
    assert found.program.conditions.shortfall(moved / scale_of(problem).parameters) < 1e-6
