"""Mean and spread of a fleet against closed forms and simulated fleets, robots that are out, and what is refused."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dynident.applications.fleet import fleet_of, robot_of_estimate
from dynident.applications.fleet.fleet import distance, screened
from dynident.applications.fleet.population import Member, Population, population_of
from dynident.arrays import Array
from dynident.data.preprocessing import Preprocessing
from dynident.data.preprocessing.as_given import AsGiven
from dynident.errors import BadOption
from dynident.identification.estimate.estimate import Estimate
from dynident.identification.identify import identify
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction.coulomb import Coulomb
from dynident.model.friction.viscous import Viscous
from dynident.robot_files.strict_yaml import load_yaml


def members(own: Array, covariances: Array) -> list[Member]:
    informations = np.linalg.inv(covariances)
    return [Member(f"r{k}", a, a @ y) for k, (y, a) in enumerate(zip(own, informations, strict=True))]


def drawn(
    generator: np.random.Generator, count: int, size: int, noise: float
) -> tuple[Array, Array, Array, list[Member]]:
    """Return mean, spread, truth and members of a fleet of the model; ``noise`` in units of the spread."""
    mean, spread = 10.0 * generator.normal(size=size), np.exp(0.5 * generator.normal(size=size))
    truth = mean + spread * generator.normal(size=(count, size))
    roots = noise * spread[:, None] * (np.eye(size) + 0.5 * generator.normal(size=(count, size, size)) / size**0.5)
    own = truth + np.einsum("ikl,il->ik", roots, generator.normal(size=(count, size)))
    return mean, spread, truth, members(own, roots @ np.swapaxes(roots, 1, 2))


def test_known_robots_have_the_mean_and_the_variance_of_their_values():
    generator = np.random.default_rng(0)
    own = generator.normal(size=(9, 3)) * [1.0, 5.0, 0.2] + 3.0
    found = population_of(members(own, np.tile(1e-10 * np.eye(3), (9, 1, 1))))
    np.testing.assert_allclose(found.mean, own.mean(axis=0), rtol=1e-6)
    squares = np.sum((own - own.mean(axis=0)) ** 2, axis=0)
    np.testing.assert_allclose(found.variances, squares / 7.0, rtol=1e-3)  # the penalty takes one more of nine
    np.testing.assert_allclose(found.mean_covariance, np.diag(found.variances / 9), rtol=1e-5, atol=1e-9)


@given(seed=st.integers(0, 1000))
def test_a_robot_is_the_normal_posterior_written_out(seed):
    generator = np.random.default_rng(seed)
    *_, robots = drawn(generator, 4, 3, 1.0)
    spread = generator.uniform(0.5, 2.0, 3)
    seen = np.array([np.linalg.inv(np.linalg.inv(one.information) + np.diag(spread)) for one in robots])
    mean = generator.normal(size=3)
    known = Population(tuple(robots), mean, np.zeros((3, 3)), spread, seen, np.zeros((4, 3)), True)
    beta, covariance = known.member(robots[0])
    information = robots[0].information + np.diag(1 / spread)
    expected = np.linalg.solve(information, robots[0].vector + mean / spread)
    np.testing.assert_allclose(beta, expected, rtol=1e-8, atol=1e-10)
    assert np.linalg.eigvalsh(covariance - np.linalg.inv(information))[0] > -1e-9  # the doubt of the spread adds


def restricted_likelihood(robots: list[Member], variances: Array) -> float:
    """Return the restricted log-likelihood of variances with the penalty, written out over stacked estimates."""
    scatter = [np.linalg.inv(one.information) + np.diag(variances) for one in robots]
    weights = [np.linalg.inv(one) for one in scatter]
    own = [np.linalg.solve(one.information, one.vector) for one in robots]
    total = np.sum(weights, axis=0)
    mean = np.linalg.solve(total, np.sum([w @ y for w, y in zip(weights, own, strict=True)], axis=0))
    squares = sum((y - mean) @ w @ (y - mean) for w, y in zip(weights, own, strict=True))
    logs = sum(np.linalg.slogdet(one)[1] for one in scatter) + np.linalg.slogdet(total)[1]
    return -0.5 * (squares + logs) + 0.5 * float(np.sum(np.log(variances)))


def test_the_spread_maximises_the_penalised_restricted_likelihood():
    *_, robots = drawn(np.random.default_rng(5), 7, 3, 0.7)
    found = population_of(robots)
    best = restricted_likelihood(robots, found.variances)
    for k in range(3):
        for factor in (0.97, 1.03):
            other = np.array(found.variances)
            other[k] *= factor
            assert restricted_likelihood(robots, other) < best
    assert found.settled


def test_a_robot_whose_log_leaves_directions_open_counts_with_what_it_shows():
    generator = np.random.default_rng(2)
    *_, truth, robots = drawn(generator, 12, 3, 0.3)
    whole = population_of(robots)
    blind = np.array([1.0, -1.0, 0.5])
    seen = np.eye(3) - np.outer(blind, blind) / (blind @ blind)
    one = robots[0]
    information = seen @ one.information @ seen
    own = np.linalg.solve(one.information, one.vector)
    part = Member(one.name, information, information @ own)
    found = population_of([part, *robots[1:]])
    np.testing.assert_allclose(found.mean, whole.mean, atol=float(np.max(whole.deviations)))
    beta, covariance = found.member(part)
    assert np.all(np.abs(beta - truth[0]) < 4.0 * np.sqrt(np.diag(covariance)))
    prior = np.diag(1 / found.variances)
    np.testing.assert_allclose(beta, np.linalg.solve(information + prior, part.vector + prior @ found.mean), rtol=1e-8)
    with pytest.raises(BadOption, match=r"leave base parameter \d open"):
        population_of([replace(each, information=seen @ each.information @ seen) for each in robots])


def test_a_population_has_two_robots_and_is_seen_by_one_at_least():
    *_, robots = drawn(np.random.default_rng(4), 3, 2, 0.3)
    with pytest.raises(BadOption, match="robots = 1 is not possible; a fleet has two or more"):
        population_of(robots[:1])
    blind = [replace(one, information=np.diag([1.0, 0.0]), vector=np.array([1.0, 0.0])) for one in robots]
    with pytest.raises(BadOption, match="base parameter 2"):
        population_of(blind)


def test_shrinking_helps_short_logs_and_its_intervals_hold():
    generator = np.random.default_rng(3)
    errors, inside = np.zeros(2), []
    for _ in range(15):
        _, spread, truth, robots = drawn(generator, 10, 6, 1.0)
        population = population_of(robots)
        for one, true in zip(robots, truth, strict=True):
            beta, covariance = population.member(one)
            own = np.linalg.solve(one.information, one.vector)
            errors += [np.mean(((each - true) / spread) ** 2) for each in (beta, own)]
            inside.append(np.abs(beta - true) < 1.96 * np.sqrt(np.diag(covariance)))
    assert errors[0] < 0.65 * errors[1]
    assert 0.92 < np.mean(inside) < 0.985


def test_a_robot_that_is_out_is_named_with_its_parameter_and_two_do_not_hide_each_other():
    generator = np.random.default_rng(4)
    _, spread, _, robots = drawn(generator, 12, 4, 0.3)
    for k, (robot, parameter) in enumerate(((3, 2), (8, 2))):
        own = np.linalg.solve(robots[robot].information, robots[robot].vector)
        own[parameter] += (15.0 + k) * spread[parameter]
        robots[robot] = replace(robots[robot], vector=robots[robot].information @ own)
    found = screened(robots, 0.01)
    assert set(found.out) == {"r3", "r8"}
    assert {found.distances[k].parameter for k in (3, 8)} == {2}
    assert all(p < 0.01 for p in found.adjusted.values()) and len(found.population.members) == 10
    assert not screened(robots[:3], 0.5).tested


@pytest.mark.battery
def test_false_alarms_keep_the_family_wise_rate():
    generator = np.random.default_rng(6)
    count = sum(bool(screened(drawn(generator, 10, 8, noise)[3], 0.05).out) for noise in (0.1, 0.5, 1.0) * 130)
    assert count < 0.09 * 390


def test_distances_of_robots_that_belong_are_those_of_chance():
    generator = np.random.default_rng(7)
    p = []
    for _ in range(60):
        *_, robots = drawn(generator, 12, 4, 0.5)
        p.append(distance(robots[0], population_of(robots[1:])).p)
    assert np.mean(np.array(p) < 0.2) < 0.4 and np.mean(p) > 0.35


@pytest.fixture(scope="module")
def estimates(planar_2r, exact_log) -> list[Estimate]:
    model = DynamicModel(planar_2r, (Coulomb(), Viscous()))
    found = []
    for seed in range(5):
        friction = np.tile([1.0, 0.5], 2) * np.exp(0.1 * np.random.default_rng(seed).normal(size=4))
        log = exact_log(model, np.append(planar_2r.nominal, friction), noise=0.3, seed=seed, samples=300)
        found.append(identify(model, [log], "consistent", Preprocessing(AsGiven(), rest="keep")))
    return found


def test_a_fleet_of_estimates_is_possible_and_written_out(estimates):
    fleet = fleet_of([robot_of_estimate(f"r{k}", one) for k, one in enumerate(estimates)])
    figures = fleet.figures()
    assert [one["name"] for one in figures["robots"]] == [f"r{k}" for k in range(5)] and not figures["outliers"]
    for own, shrunk in zip(estimates, fleet.estimates, strict=True):
        assert shrunk.consistency.consistent and shrunk.estimator == "fleet" and shrunk.theta is not None
        np.testing.assert_allclose(shrunk.base.from_standard(shrunk.theta), shrunk.beta, rtol=1e-9)
        assert np.all(shrunk.std < 1.3 * own.std)
        assert np.median(shrunk.std / own.std) < 0.97  # five robots tell little of a spread
    assert np.all((fleet.shares >= 0) & (fleet.shares <= 1))


def test_what_a_fleet_refuses(estimates, planar_2r, spatial_3r, exact_log):
    robots = [robot_of_estimate(f"r{k}", one) for k, one in enumerate(estimates)]
    with pytest.raises(BadOption, match="two or more robots of one type"):
        fleet_of(robots[:1])
    with pytest.raises(BadOption, match="two files have this name"):
        fleet_of([robots[0], robots[0]])
    with pytest.raises(BadOption, match="rate = 0"):
        fleet_of(robots, 0.0)
    plain = DynamicModel(planar_2r, (Viscous(),))
    log = exact_log(plain, np.append(planar_2r.nominal, [0.5, 0.5]), noise=0.3, seed=9)
    odd = identify(plain, [log], "wls", Preprocessing(AsGiven(), rest="keep"))
    with pytest.raises(BadOption, match="other friction than r0: viscous, there coulomb viscous"):
        fleet_of([*robots, robot_of_estimate("odd", odd)])
    with pytest.raises(BadOption) as refused:
        fleet_of([robot_of_estimate("odd", odd), robots[0], robots[1]])
    (line,) = re.findall(r"state that of r0 in all cases and estimate again: (friction: .*)", str(refused.value))
    value, _ = load_yaml("case.yaml", line.encode())  # of the robot with most parts
    assert value == {"friction": [{"coulomb": {"width": "0.02"}}, "viscous"]}
    other = DynamicModel(spatial_3r, (Coulomb(), Viscous()))
    log = exact_log(other, np.append(spatial_3r.nominal, np.tile([1.0, 0.5], 3)), noise=0.3, seed=9)
    odd = identify(other, [log], "wls", Preprocessing(AsGiven(), rest="keep"))
    with pytest.raises(BadOption, match="other joints than r0"):
        fleet_of([*robots, robot_of_estimate("odd", odd)])
    first, second = planar_2r.joints
    slide = replace(second, kind="prismatic")
    longer = replace(second, translation=1.2 * second.translation)
    others = {
        "torques in other units than r0: N m, N, there N m, N m": replace(planar_2r, joints=(first, slide)),
        "other base parameters than r0, such as .*: another geometry, gravity or mounting": planar_2r.with_gravity(
            [0.0, 0.0, -9.81]
        ),
        r"other base parameters than r0, such as Izz\[link1\] \+ 0.36 m\[link2\]": replace(
            planar_2r, joints=(first, longer)
        ),
    }
    for words, robot in others.items():
        model = DynamicModel(robot, (Coulomb(), Viscous()))
        log = exact_log(model, np.append(planar_2r.nominal, np.tile([1.0, 0.5], 2)), noise=0.3, seed=9)
        odd = identify(model, [log], "wls", Preprocessing(AsGiven(), rest="keep"))
        with pytest.raises(BadOption, match=f"odd, which has {words}"):
            fleet_of([*robots, robot_of_estimate("odd", odd)])
    log = {"path": "monday.csv", "sha256": "abc"}
    twice = [replace(one, provenance={"logs": [log]}) for one in estimates[:2]]
    with pytest.raises(BadOption, match="b, which stands on a log that a stands on too"):
        fleet_of([robot_of_estimate("a", twice[0]), robot_of_estimate("b", twice[1])])
