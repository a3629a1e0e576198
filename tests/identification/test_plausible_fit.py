"""Plausible bodies: the distance, the rule of the weight, and mass ranges that the data contradict."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from dynident.arrays import Array
from dynident.data.log import Log
from dynident.data.preprocessing import Preprocessing
from dynident.data.preprocessing.as_given import AsGiven
from dynident.errors import BadOption, ContradictoryConstraints
from dynident.identification.build_problem import build_problem
from dynident.identification.consistency.conditions import conditions_of
from dynident.identification.consistency.consistent_fit import scale_of
from dynident.identification.consistency.plausible_fit import fitting_bodies, nominal_bodies, plausible_fit
from dynident.identification.estimate.plausibility import TOTAL_MASS, Plausibility
from dynident.identification.estimators.consistent import Consistent
from dynident.identification.estimators.wls import WLS
from dynident.identification.fit import fit
from dynident.identification.problem.method_run import recorded_run
from dynident.identification.problem.problem import Problem
from dynident.identification.residuals.quantiles import chi_square_quantile
from dynident.model.body_constraints import BodyConstraints, BoundingBox, Constraints, ValueRange
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import FRICTION
from dynident.model.inertia import Inertia
from dynident.model.joint import Joint
from dynident.model.plausible import plausible_constraints, uniform_body
from dynident.model.robot import Link, Robot
from dynident.model.shapes import Sphere
from dynident.results.plausibility import contradictions

GIVEN = Preprocessing(AsGiven(), rest="keep")

MakeLog = Callable[..., Log]


def problem_of(
    robot: Robot, make: MakeLog, nominal: Robot | None = None, seed: int = 0, noise: float = 0.02
) -> tuple[Problem, Array]:
    """Return the problem of a log of ``robot`` with noise, by the model of ``nominal``, and the true theta."""
    model = DynamicModel(robot, (FRICTION.make("viscous"),))
    assert robot.nominal is not None
    theta = np.append(robot.nominal, np.ones(robot.dof))
    size = noise * np.std(np.asarray(make(model, theta).torque), axis=0)
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
    links[index] = replace(links[index], inertia=inertia)
    return replace(robot, links=tuple(links))


@pytest.fixture
def spatial_3r(spatial_3r: Robot) -> Robot:
    """The arm with shapes about its bodies, balls of 0.5 m."""
    links = []
    for link in spatial_3r.links:
        assert link.inertia is not None
        links.append(replace(link, shapes=(Sphere(0.5, link.inertia.centre_of_mass),)))
    return replace(spatial_3r, links=tuple(links))


def weights_of(problem: Problem) -> Array:
    return np.asarray(WLS().solve(problem).weights)


def distance(theta: Array, nominal: Array) -> float:
    """Return the entropic distance of bodies (l, 10), by determinants."""
    total = 0.0
    for ten, own in zip(theta, nominal, strict=True):
        inner = np.linalg.solve(Inertia.from_vector(own).pseudo, Inertia.from_vector(ten).pseudo)
        total += float(np.trace(inner) - np.log(np.linalg.det(inner)) - 4.0)
    return total


def test_a_uniform_body_is_that_of_points_in_its_ellipsoid(spatial_3r: Robot) -> None:
    body = plausible_constraints(spatial_3r).links["link2"]
    space = body.body_ellipsoid
    assert space is not None
    points = np.random.default_rng(0).normal(size=(200_000, 3))
    points *= (np.random.default_rng(1).random(len(points)) ** (1 / 3) / np.linalg.norm(points, axis=1))[:, None]
    lifted = np.column_stack([points * space.semi_axes @ space.rotation.T + space.centre, np.ones(len(points))])
    volume = 4 / 3 * np.pi * np.prod(space.semi_axes)
    np.testing.assert_allclose(uniform_body(body).pseudo, volume * lifted.T @ lifted / len(points), atol=2e-3 * volume)


def test_the_cost_rises_within_its_limit_and_the_answer_comes_nearer(spatial_3r: Robot, exact_log: MakeLog) -> None:
    nominal = spatial_3r
    for index, factor in ((0, 1.3), (1, 0.7), (2, 1.3)):
        nominal = scaled_link(nominal, index, factor)
    problem, _ = problem_of(spatial_3r, exact_log, nominal)
    weights = weights_of(problem)
    found = plausible_fit(problem, weights, 0.01, 1e-8)
    bounds = plausible_constraints(nominal)
    filling = np.array([uniform_body(body).vector for body in bounds.links.values()])
    bodies, is_stated, _ = nominal_bodies(nominal, filling, None)
    reduced = problem.reduced(weights)
    free = Consistent(bodies="free").solve(problem)
    assert free.theta is not None and is_stated.all()
    near, far = (distance(t[:30].reshape(-1, 10), bodies) for t in (found.fit.theta, free.theta))
    assert near < far
    cost, least = (reduced.residual_square(b) for b in (problem.base.from_standard(found.fit.theta), free.beta))
    assert (cost - least) * reduced.rows / reduced.rest <= 1.05 * found.facts.cost_limit
    assert found.facts.cost_rise == pytest.approx(found.facts.cost_limit, rel=1e-4)
    assert found.facts.contradicted == () and found.fit.optimality.gap < 1e-6
    inner = plausible_fit(problem, weights, 0.01, 1e-8, replace(found.facts, weight=0.0))
    for factor in (0.9, 1.1):  # a search by weights
        other = plausible_fit(problem, weights, 0.01, 1e-8, replace(found.facts, weight=factor * found.facts.weight))
        beta = [problem.base.from_standard(one.fit.theta) for one in (other, inner)]
        rise = reduced.residual_square(beta[0]) - reduced.residual_square(beta[1])
        assert (rise * reduced.rows / reduced.rest > found.facts.cost_limit) == (factor > 1)


def test_slow_residuals_widen_the_noise_of_the_data_by_half_a_percent_at_most(
    spatial_3r: Robot, exact_log: MakeLog
) -> None:
    """White noise: the region of independent rows. A slow part that no column explains: a half percent of the rest."""
    model = DynamicModel(spatial_3r, (FRICTION.make("viscous"),))
    theta = np.append(spatial_3r.nominal, np.ones(3))
    log = exact_log(model, theta, noise=0.1, samples=3000)
    slow = 0.1 * np.sin(2 * np.pi * 0.37 * log.time)[:, None]
    for torque, widest in ((log.torque, 1.3), (log.torque + slow, np.inf)):
        problem = build_problem(model, [replace(log, torque=torque)], GIVEN)
        weights = weights_of(problem)
        found = plausible_fit(problem, weights, 0.01, 1e-8)
        region, reduced = chi_square_quantile(0.95, problem.base.count), problem.reduced(weights)
        inner = plausible_fit(problem, weights, 0.01, 1e-8, replace(found.facts, weight=0.0)).fit.theta
        cost = reduced.residual_square(problem.base.from_standard(inner)) * reduced.rows / reduced.rest
        price = (1.005**2 - 1.0) * cost
        assert region <= found.facts.cost_limit <= min(price, widest * region) * (1 + 1e-6)
        if widest == np.inf:
            assert found.facts.cost_limit == pytest.approx(price, rel=1e-6) and price > 2 * region


@pytest.mark.parametrize("factor", [0.1, 8.0])
def test_a_wrong_mass_of_the_robot_model_is_relaxed_and_named(
    spatial_3r: Robot, exact_log: MakeLog, factor: float
) -> None:
    problem, truth = problem_of(spatial_3r, exact_log, scaled_link(spatial_3r, 2, factor))
    solution = Consistent(bodies="plausible").solve(problem)
    facts = Plausibility.of(recorded_run(json.loads(json.dumps(solution.run.data()))))
    assert facts is not None
    relaxed = {(one.name, one.bound) for one in facts.contradicted if one.is_relaxed}
    assert ("link3", "mass") in relaxed and "link2" not in {name for name, _ in relaxed}
    for one in facts.contradicted:
        assert one.statistic > one.limit and one.gain > 0
    beta = problem.base.from_standard(truth)
    assert np.abs(solution.beta - beta).max() < 0.1 * np.abs(beta).max()
    again = plausible_fit(problem, solution.weights, 0.01, 1e-8, facts)
    np.testing.assert_allclose(again.fit.theta, solution.theta, rtol=1e-4, atol=1e-6)


@pytest.mark.parametrize(("seed", "noise"), [(0, 0.02), (1, 0.02), (2, 0.02), (0, 1.0), (0, 0.0), (0, 1e-9)])
def test_nothing_is_relaxed_where_the_robot_model_is_right(
    spatial_3r: Robot, exact_log: MakeLog, seed: int, noise: float
) -> None:
    problem, truth = problem_of(spatial_3r, exact_log, seed=seed, noise=noise)
    found = plausible_fit(problem, weights_of(problem), 0.01, 1e-8)
    assert found.facts.contradicted == ()
    assert found.facts.weight > 1.0 and found.fit.failed == ()  # the nominal bodies are the true ones
    masses = found.fit.theta[9:30:10] / truth[9:30:10]
    np.testing.assert_allclose(masses, 1.0, atol=0.1)


@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_a_body_that_its_own_shapes_exclude_gives_way_where_data_are_exact(
    spatial_3r: Robot, exact_log: MakeLog, noise: float
) -> None:
    """The robot model made the log, and its last link is flatter than links of its shape are: no mass is to blame."""
    body = spatial_3r.links[2].inertia
    assert body is not None
    flat = Inertia.from_centre_of_mass(body.mass, body.centre_of_mass, body.mass * np.diag([1e-4, 0.02, 0.02]))
    robot = without_inertia(spatial_3r, 2, flat)
    links = (*robot.links[:2], replace(robot.links[2], shapes=(Sphere(0.2, body.centre_of_mass),)))
    robot = replace(robot, links=links)
    problem, truth = problem_of(robot, exact_log, noise=noise)
    found = plausible_fit(problem, weights_of(problem), 0.01, 1e-8)
    contradicted = [(one.name, one.bound, one.is_relaxed) for one in found.facts.contradicted]
    if noise:  # too little is at stake
        assert contradicted == [] and found.facts.fitted == ("link3",)
        return
    assert contradicted == [("link3", "size", True)] and found.facts.fitted == ()
    np.testing.assert_allclose(found.fit.theta, truth, rtol=1e-5, atol=1e-6)
    again = plausible_fit(problem, weights_of(problem), 0.01, 1e-8, found.facts)
    np.testing.assert_allclose(again.fit.theta, found.fit.theta, rtol=1e-4, atol=1e-6)


def facts_of(model: DynamicModel, log: Log) -> Plausibility:
    """Return how plausible bodies came about, which cost no more than 2 % of the error."""
    problem = build_problem(model, [log], GIVEN)
    bounded, free = (fit(problem, Consistent(bodies=bodies)) for bodies in ("plausible", "free"))
    assert bounded.train.total_relative_error < 1.02 * free.train.total_relative_error
    facts = Plausibility.of(bounded.run)
    assert facts is not None
    return facts


@pytest.mark.parametrize("load", [(), ("load",)])
def test_a_size_that_its_own_body_widens_gives_way_too(
    spatial_3r: Robot, exact_log: MakeLog, load: tuple[str, ...]
) -> None:
    """The nominal body is thinner than links of its shape are, the true one reaches far beyond both.

    A size that has room for the nominal body is no less in the way of the data than others are. With load friction the
    error of bodies that it holds would go on to the load.
    """
    body = spatial_3r.links[2].inertia
    assert body is not None
    flat = Inertia.from_centre_of_mass(body.mass, body.centre_of_mass, body.mass * np.diag([1e-4, 0.02, 0.02]))
    links = (
        *spatial_3r.links[:2],
        replace(spatial_3r.links[2], inertia=flat, shapes=(Sphere(0.1, body.centre_of_mass),)),
    )
    far = Inertia.from_centre_of_mass(body.mass, body.centre_of_mass + 0.5 * np.eye(3)[0], body.mass * 0.02 * np.eye(3))
    model = DynamicModel(replace(spatial_3r, links=links), tuple(map(FRICTION.make, ("coulomb", "viscous", *load))))
    true = replace(model, robot=without_inertia(spatial_3r, 2, far))
    assert true.robot.nominal is not None
    theta = np.append(true.robot.nominal, np.tile([1.0, 1.0, 0.1][: 2 + len(load)], 3))
    facts = facts_of(
        model, exact_log(true, theta, noise=0.01 * np.std(np.asarray(exact_log(true, theta).torque), axis=0))
    )
    assert [(one.name, one.bound, one.is_relaxed) for one in facts.contradicted] == [("link3", "wider size", True)]
    assert contradictions(facts.contradicted)[0].startswith("wider size of link3: the data contradict it")


@pytest.mark.parametrize("shift", [0.1, 0.0])
def test_what_one_wrong_size_leaves_hides_no_other(spatial_3r: Robot, exact_log: MakeLog, shift: float) -> None:
    """The true last body is 0.5 m from where the robot model has it, that before it 0.1 m; balls of 0.2 m are sizes.

    The residual that the first leaves hangs together over far more rows than that of noise does.
    """
    links, true = [], []
    for link, axis, away in zip(spatial_3r.links, np.eye(3), (0.0, shift, 0.5), strict=True):
        assert link.inertia is not None
        mass, centre = link.inertia.mass, link.inertia.centre_of_mass
        body = Inertia.from_centre_of_mass(mass, centre, 0.016 * mass * np.eye(3))
        links.append(replace(link, inertia=body, shapes=(Sphere(0.2, centre),)))
        there = Inertia.from_centre_of_mass(mass, centre + away * axis, 0.016 * mass * np.eye(3))
        true.append(replace(link, inertia=there))
    model = DynamicModel(replace(spatial_3r, links=tuple(links)), (FRICTION.make("coulomb"), FRICTION.make("viscous")))
    arm = replace(model, robot=replace(spatial_3r, links=tuple(true)))
    assert arm.robot.nominal is not None
    theta = np.append(arm.robot.nominal, np.ones(6))
    facts = facts_of(
        model, exact_log(arm, theta, noise=0.01 * np.std(np.asarray(exact_log(arm, theta).torque), axis=0))
    )
    named = ["link3", "link2"] if shift else ["link3"]
    assert [(one.name, one.bound) for one in facts.contradicted] == [(name, "size") for name in named]


@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_a_right_body_larger_than_its_shapes_is_the_reference(
    spatial_3r: Robot, exact_log: MakeLog, noise: float
) -> None:
    """The robot model made the log; its links have balls of 30 mm to touch with. Nothing has to give way to data."""
    dense = spatial_3r
    for index in range(3):  # as dense as links are
        dense = scaled_link(dense, index, 10.0)
    links = tuple(replace(link, shapes=(Sphere(0.03),)) for link in dense.links)
    problem, truth = problem_of(replace(dense, links=links), exact_log, noise=noise)
    found = plausible_fit(problem, weights_of(problem), 0.01, 1e-8)
    assert (found.facts.contradicted, found.facts.fitted, found.facts.uniform) == ((), (), ())
    assert found.facts.widened == tuple(link.name for link in links)
    np.testing.assert_allclose(found.fit.theta[9:30:10] / truth[9:30:10], 1.0, atol=5 * noise + 1e-4)


def test_an_inertia_that_is_a_placeholder_frees_no_size(spatial_3r: Robot, exact_log: MakeLog) -> None:
    """A uniform body of the stated mass stands in place of 0.4 kg with 1 kg m^2; shapes are those of the true one."""
    body = Inertia.from_centre_of_mass(0.4, np.array([0.2, 0.0, 0.0]), 0.4 * 0.4 * 0.06**2 * np.eye(3))
    shape = (Sphere(0.06, body.centre_of_mass),)
    links = (*spatial_3r.links[:2], replace(spatial_3r.links[2], inertia=body, shapes=shape))
    placeholder = Inertia.from_centre_of_mass(0.4, body.centre_of_mass, np.eye(3))
    robot = replace(spatial_3r, links=links)
    problem, truth = problem_of(robot, exact_log, without_inertia(robot, 2, placeholder))
    found = plausible_fit(problem, weights_of(problem), 0.01, 1e-8)
    assert found.facts.fitted == ("link3",) and (found.facts.widened, found.facts.contradicted) == ((), ())
    own, true = (Inertia.from_vector(theta[20:30]) for theta in (found.fit.theta, truth))
    assert own.mass == pytest.approx(0.4, rel=0.2)
    assert 0.5 < np.trace(own.about_centre) / np.trace(true.about_centre) < 2.0


def test_one_joint_without_noise_keeps_to_its_bounds(exact_log: MakeLog) -> None:
    """The nominal body explains the log and breaks the bounds: its residual is no unit for a fit within them."""
    point = Inertia.from_centre_of_mass(3.0, np.array([0.0, 0.02, 0.2]), 2e-4 * np.eye(3))
    axis = Joint("joint1", "revolute", -1, np.eye(3), np.zeros(3), np.array([0.0, 1.0, 0.0]))
    one = Robot("one", (Link("link1", point, shapes=(Sphere(0.3, point.centre_of_mass),)),), (axis,))
    problem, truth = problem_of(one, exact_log, noise=0.0)
    mass = ValueRange(3.0, 3.0)
    known = replace(problem, constraints=Constraints({"link1": BodyConstraints(mass=mass)}))
    found = plausible_fit(known, weights_of(problem), 0.01, 1e-8)
    np.testing.assert_allclose(found.fit.theta, truth, rtol=1e-4, atol=1e-6)
    assert [(one.name, one.bound) for one in found.facts.contradicted] == [("link1", "size")]
    known = replace(problem, constraints=Constraints({"link1": BodyConstraints(mass=mass, thickness=0.05)}))
    within = plausible_fit(known, weights_of(problem), 0.01, 1e-8).fit
    body = Inertia.from_vector(within.theta[:10])
    spread = body.pseudo[:3, :3] / body.mass - np.outer(body.centre_of_mass, body.centre_of_mass)
    assert np.linalg.eigvalsh(spread)[0] >= 0.05**2 * (1 - 1e-3) and within.optimality.gap < 1e-3


def test_a_size_that_nobody_states_gives_way_to_data(spatial_3r: Robot, exact_log: MakeLog) -> None:
    """The last link has no child and no shape, and its body is larger than that of the robot model."""
    body = spatial_3r.links[2].inertia
    assert body is not None
    small = Inertia.from_centre_of_mass(body.mass, body.centre_of_mass, 4e-3 * body.mass * np.eye(3))
    bare = replace(spatial_3r, links=(*spatial_3r.links[:2], replace(spatial_3r.links[2], shapes=(), inertia=small)))
    problem, truth = problem_of(spatial_3r, exact_log, bare)
    found = plausible_fit(problem, weights_of(problem), 0.01, 1e-8)
    assert [(one.name, one.bound, one.is_relaxed) for one in found.facts.contradicted] == [("link3", "size", True)]
    beta = problem.base.from_standard(truth)
    assert np.abs(problem.base.from_standard(found.fit.theta) - beta).max() < 0.05 * np.abs(beta).max()
    assert found.facts.fitted == ()
    again = plausible_fit(problem, weights_of(problem), 0.01, 1e-8, found.facts)  # as for a part of the logs
    np.testing.assert_allclose(again.fit.theta, found.fit.theta, rtol=1e-4, atol=1e-6)
    assert again.facts.contradicted == found.facts.contradicted


def test_shapes_far_smaller_than_their_bodies_give_way_to_data(spatial_3r: Robot, exact_log: MakeLog) -> None:
    """Balls of 30 mm about centres that are right, and inertias a twentieth of the true ones: no mass grows instead.

    A size that the user states as small is named, and kept.
    """
    links = []
    for link in spatial_3r.links:
        assert link.inertia is not None
        mass, centre = link.inertia.mass, link.inertia.centre_of_mass
        small = Inertia.from_centre_of_mass(mass, centre, link.inertia.about_centre / 20)
        links.append(replace(link, inertia=small, shapes=(Sphere(0.03, centre),)))
    nominal = replace(spatial_3r, links=tuple(links))
    problem, truth = problem_of(spatial_3r, exact_log, nominal)
    found = plausible_fit(problem, weights_of(problem), 0.01, 1e-8)
    contradicted = {(one.name, one.bound) for one in found.facts.contradicted if one.is_relaxed}
    assert contradicted and {bound for _, bound in contradicted} == {"size"}
    masses = found.fit.theta[9:30:10] / truth[9:30:10]
    assert np.all(masses > 1 / 3.01) and np.all(masses < 3.01)
    boxes = {
        link.name: BodyConstraints(body_box=BoundingBox(shape.centre - 0.03, shape.centre + 0.03))
        for link in links
        if isinstance(shape := link.shapes[0], Sphere)
    }
    known = replace(problem, constraints=Constraints(boxes))
    kept = plausible_fit(known, weights_of(problem), 0.01, 1e-8).facts.contradicted
    assert ("size", False) in {(one.bound, one.is_relaxed) for one in kept}
    assert {one.is_relaxed for one in kept if one.bound == "size"} == {False}


def test_a_body_that_does_not_fit_becomes_the_nearest_one_that_does(spatial_3r: Robot, exact_log: MakeLog) -> None:
    """In a ball the nearest body has the principal second moments, each at least the square of the thickness."""
    problem, _ = problem_of(spatial_3r, exact_log)
    bounds, scale = plausible_constraints(spatial_3r), scale_of(problem)
    names, thickness = list(bounds.links), bounds.links["link1"].thickness
    filling = np.array([uniform_body(bounds.links[name]).vector for name in names])
    bodies = np.array([link.inertia.vector for link in spatial_3r.links if link.inertia is not None])
    flat, centre = np.diag([1e-6, 0.04, 0.02]), bodies[0, 6:9] / bodies[0, 9]
    pseudo = np.eye(4)
    pseudo[:3, :3], pseudo[:3, 3], pseudo[3, :3] = flat + np.outer(centre, centre), centre, centre
    bodies[0] = Inertia.from_pseudo(8.0 * pseudo).vector
    masses = {
        name: replace(bounds.links[name], mass=ValueRange(own, own))
        for name, own in zip(names, bodies[:, 9].tolist(), strict=True)
    }
    found, moved = fitting_bodies(
        bodies, filling, conditions_of(problem.model, scale, 1e-8, Constraints(masses)), scale
    )
    assert moved.tolist() == [True, False, False]
    np.testing.assert_array_equal(found[1:], bodies[1:])
    nearest = Inertia.from_vector(found[0])
    np.testing.assert_allclose(nearest.centre_of_mass, centre, atol=1e-4)
    covariance = nearest.pseudo[:3, :3] / 8.0 - np.outer(centre, centre)
    np.testing.assert_allclose(covariance, np.diag([thickness**2, 0.04, 0.02]), atol=1e-4)


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
    filling = np.array([uniform_body(body).vector for body in plausible_constraints(robot).links.values()])
    nominal, is_stated, uniform = nominal_bodies(robot, filling, None)
    assert uniform == ["link3"] and is_stated.all()
    assert nominal[2, 9] == pytest.approx(3.0) and Inertia.from_vector(nominal[2]).is_consistent()
    np.testing.assert_allclose(nominal[1], spatial_3r.links[1].inertia.vector)  # type: ignore[union-attr]


def test_draws_of_the_bootstrap_keep_the_bounds(spatial_3r: Robot, exact_log: MakeLog) -> None:
    problem, _ = problem_of(spatial_3r, exact_log, scaled_link(spatial_3r, 1, 0.5))
    weights = weights_of(problem)
    found = plausible_fit(problem, weights, 0.01, 1e-8)
    part, reduced = Consistent(bodies="plausible"), problem.reduced(weights)
    refit, settled = part.refit(problem), part.refit(problem, part.solve(problem).run)
    np.testing.assert_allclose(refit(reduced), found.fit.theta, rtol=1e-4, atol=1e-6)
    np.testing.assert_allclose(settled(reduced), found.fit.theta, rtol=1e-4, atol=1e-6)
    moved = refit(replace(reduced, z=1.5 * reduced.z))
    assert found.program.conditions.shortfall(moved / scale_of(problem).parameters) < 1e-6


def broken_bounds(theta: Array, nominal: Robot, relaxed: set[str], tolerance: float = 0.03) -> list[str]:
    """Return what bodies in balls of 0.5 m break, judged by their ten parameters alone, as docs state the bounds.

    The ellipsoid about a ball may be larger by 2.5 % than the ball.
    """
    found, masses = [], []
    for link, ten in zip(nominal.links, theta[:30].reshape(3, 10), strict=True):
        (ball,) = link.shapes
        assert isinstance(ball, Sphere) and link.inertia is not None
        mass, centre = ten[9], ten[6:9] / ten[9]
        xx, xy, xz, yy, yz, zz = ten[:6]
        moment = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        second = (0.5 * np.trace(moment) * np.eye(3) - moment) / mass - np.outer(centre, centre)
        sizes, axes = np.linalg.eigh(second)
        ratio, offset = mass / link.inertia.mass, centre - np.asarray(ball.centre)
        masses.append((mass, link.inertia.mass))
        if link.name not in relaxed and not 1 / 3 - 1e-6 < ratio < 3 + 1e-6:
            found.append(f"{link.name}: mass {ratio:.3g} times the nominal one")
        if np.sqrt(max(sizes[0] + sizes[1], 0.0)) < 0.05 * 2 * ball.radius * (1 - tolerance):
            found.append(f"{link.name}: radius of gyration")
        if np.linalg.norm(offset) > ball.radius * (1 + tolerance):
            found.append(f"{link.name}: centre of mass outside")
        reach = np.max(np.abs(axes.T @ offset) + np.sqrt(5 * np.maximum(sizes, 0)))
        if reach > 1.5 * ball.radius * (1 + tolerance):
            found.append(f"{link.name}: ellipsoid of equal density")
    total = np.divide(*np.sum(masses, axis=0))
    if not relaxed and not 1 / 1.5 - 1e-6 < total < 1.5 + 1e-6:
        found.append(f"total mass {total:.3g} times the nominal one")
    return found


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ((slice(0, 10), 3.1), "mass 3.1"),
        ((slice(0, 30), 1.6), "total mass 1.6"),
        ((slice(6, 9), 9.0), "centre of mass outside"),
        ((slice(0, 6), 9.0), "ellipsoid of equal density"),
        ((slice(0, 6), 0.05), "radius of gyration"),
    ],
)
def test_a_broken_bound_is_found(spatial_3r: Robot, change: tuple[slice, float], told: str) -> None:
    assert spatial_3r.nominal is not None and broken_bounds(spatial_3r.nominal, spatial_3r, set()) == []
    theta = spatial_3r.nominal.copy()
    theta[change[0]] *= change[1]
    assert any(told in one for one in broken_bounds(theta, spatial_3r, set()))


@pytest.mark.battery
def test_a_thousand_noisy_problems_break_no_bound(spatial_3r: Robot, exact_log: MakeLog) -> None:
    """Masses of the robot model off by up to a factor 5, and noise of 0.5 to 50 % of the right-hand side."""
    generator, worst, broken = np.random.default_rng(0), 0.0, list[str]()
    for seed in range(100):
        nominal = spatial_3r
        for index in range(3):
            nominal = scaled_link(nominal, index, float(np.exp(generator.uniform(-1.6, 1.6))))
        problem, _ = problem_of(spatial_3r, exact_log, nominal, seed=seed)
        weights, sizes = weights_of(problem), scale_of(problem).parameters
        whole = plausible_fit(problem, weights, 0.01, 1e-8)
        rules = whole.program.conditions
        relaxed = {one.name for one in whole.facts.contradicted if one.is_relaxed}
        refit, reduced = Consistent(bodies="plausible").refit(problem), problem.reduced(weights)
        for _ in range(10):
            size = 10.0 ** generator.uniform(-2.3, -0.3) * np.sqrt(np.mean(reduced.z**2))
            theta = refit(replace(reduced, z=reduced.z + size * generator.normal(size=len(reduced.z))))
            worst = max(worst, rules.shortfall(theta / sizes))
            broken += broken_bounds(theta, nominal, relaxed)
    assert worst <= 1e-6
    assert broken == []


def test_plausible_bodies_have_their_own_metric() -> None:
    with pytest.raises(BadOption, match="entropic"):
        Consistent(bodies="plausible", metric="entropic")
    with pytest.raises(BadOption, match="free, plausible, auto"):
        Consistent(bodies="slim")  # type: ignore[arg-type]


def test_ranges_end_where_a_fixed_value_costs_the_limit(spatial_3r: Robot, exact_log: MakeLog) -> None:
    """A mass fixed a little inside its range costs less than the limit, one a little outside more, by its own fit."""
    nominal = scaled_link(scaled_link(spatial_3r, 0, 1.3), 2, 0.7)
    problem, truth = problem_of(spatial_3r, exact_log, nominal, noise=0.2)
    solution = Consistent(bodies="plausible", ranges=True).solve(problem)
    facts = Plausibility.of(recorded_run(json.loads(json.dumps(solution.run.data()))))
    assert facts is not None and solution.theta is not None
    low, high = np.array(facts.ranges).T
    assert np.all((low - 1e-6 <= solution.theta) & (solution.theta <= high + 1e-6))
    assert np.mean((low <= truth) & (truth <= high)) > 0.9
    settled, reduced = replace(facts, weight=0.0), problem.reduced(solution.weights)

    def cost(problem: Problem) -> float:
        found = plausible_fit(problem, solution.weights, 0.01, 1e-8, settled)
        beta = problem.base.from_standard(found.fit.theta)
        return float(reduced.residual_square(beta) * reduced.rows / reduced.rest)

    least, tested = cost(problem), 0
    for link, mass in (("link2", 19), ("link3", 29)):
        for end, outwards in ((low[mass], -1.0), (high[mass], 1.0)):
            nominal_mass = nominal.links[mass // 10].inertia.mass  # type: ignore[union-attr]
            if min(abs(end / nominal_mass * 3.0 - 1.0), abs(end / nominal_mass / 3.0 - 1.0)) < 0.02:
                continue  # the end of the range of the mass itself
            for share, is_outside in ((-0.01, False), (0.01, True)):
                value = ValueRange(*[float(end) * (1.0 + outwards * share)] * 2)
                known = replace(problem, constraints=Constraints({link: BodyConstraints(mass=value)}))
                assert (cost(known) - least > facts.cost_limit) == is_outside
                tested += 1
    assert tested >= 4
    with pytest.raises(BadOption, match="--bodies plausible"):
        Consistent(bodies="free", ranges=True).solve(problem)


def test_stated_bounds_that_clash_are_named(spatial_3r: Robot, exact_log: MakeLog) -> None:
    """A mass above the range of the total, and a thickness that does not fit into the ellipsoid of the link."""
    problem, _ = problem_of(spatial_3r, exact_log)
    heavy = Constraints({"link3": BodyConstraints(mass=ValueRange(low=90.0))}, ValueRange(high=50.0))
    thick = Constraints({"link2": BodyConstraints(thickness=2.0)})
    for stated, words in ((heavy, ("link3: mass >= 90 kg", "total mass")), (thick, ("link2", "minimum thickness"))):
        with pytest.raises(ContradictoryConstraints) as raised:
            plausible_fit(replace(problem, constraints=stated), weights_of(problem), 0.01, 1e-8)
        assert all(word in str(raised.value) for word in words)
