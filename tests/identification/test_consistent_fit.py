"""The consistent program: solver paths against each other, injected failures, constraints, metrics, certificates."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from dynident.arrays import Array
from dynident.errors import ContradictoryConstraints, SolverFailed, UnknownChoice
from dynident.identification.consistency import consistent_fit as fitting
from dynident.identification.consistency.barrier import inside, solve_barrier
from dynident.identification.consistency.certificate import check_room, deepest
from dynident.identification.consistency.conditions import conditions_of
from dynident.identification.consistency.conic import ConicCandidate, solve_conic
from dynident.identification.consistency.consistent_fit import (
    METRICS,
    ConsistentFit,
    Metric,
    consistent_fit,
    pose_program,
)
from dynident.identification.consistency.program import Multipliers, Program, optimality
from dynident.identification.consistency.verdicts import broken_conditions
from dynident.identification.problem.prior import Scale, natural_scale
from dynident.model.base_parameters import BaseParameters, base_parameters
from dynident.model.body_constraints import BodyConstraints, BoundingBox, Constraints, Ellipsoid, ValueRange
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import FRICTION
from dynident.model.inertia import Inertia
from dynident.model.joint import Joint, rotation_about
from dynident.model.reduction import Reduced, triangle_of
from dynident.model.robot import Link, Robot

PARTS = ("coulomb", "viscous", "offset", "rotor_inertia")

Posed = tuple[DynamicModel, BaseParameters, Reduced, Scale]


def chain(generator: np.random.Generator, joints: int, mass: float = 1.0) -> Robot:
    """Return an arm with links of very different masses and shapes, thin ones too."""
    made, bodies = [], []
    for i in range(joints):
        axis, angle = generator.normal(size=3), generator.uniform(-np.pi, np.pi)
        turn = rotation_about(axis / np.linalg.norm(axis), angle)
        kind = "prismatic" if generator.random() < 0.15 else "revolute"
        shift = generator.uniform(-0.5, 0.5, 3)
        made.append(Joint(f"joint{i + 1}", kind, i - 1, turn, shift, np.array([0, 0, 1.0])))
        axes = generator.normal(size=(3, 3))
        spread = axes @ np.diag(10 ** generator.uniform(-3.5, -1.5, 3)) @ axes.T
        body = mass * 10 ** generator.uniform(-0.5, 1.2)
        inertia = body * (np.trace(spread) * np.eye(3) - spread)
        bodies.append(Inertia.from_centre_of_mass(body, generator.uniform(-0.2, 0.2, 3), inertia))
    return Robot("chain", tuple(Link(f"link{i + 1}", body) for i, body in enumerate(bodies)), tuple(made))


@lru_cache(maxsize=4)
def arm(seed: int, joints: int | None, mass: float, rows: int) -> tuple[DynamicModel, BaseParameters, Array, Array]:
    """Return an arm of 3 to 9 joints, its base parameters, and regressor and exact torque of random states."""
    generator = np.random.default_rng(seed)
    count = int(generator.integers(3, 10)) if joints is None else joints
    model = DynamicModel(chain(generator, count, mass), tuple(FRICTION.make(part) for part in PARTS))
    base = base_parameters(model)
    assert model.robot.nominal is not None
    tail = mass * 0.5 * np.abs(generator.normal(size=len(model.parameters) - model.inertial_count))
    theta = np.append(model.robot.nominal, tail)
    regressor = model.regressor(model.random_motion(rows // count, seed)).reshape(-1, len(theta))[:, base.independent]
    return model, base, regressor, regressor @ base.from_standard(theta)


def noisy(seed: int, joints: int | None = None, mass: float = 1.0, draw: int = 0) -> Posed:
    """Return a reduced problem with noise of 0.1 % to 100 % of the torque; half of the arms know their bodies."""
    model, base, regressor, exact = arm(seed, joints, mass, 600)
    generator = np.random.default_rng([seed, draw])
    torque = exact + 10 ** generator.uniform(-3, 0) * np.std(exact) * generator.normal(size=len(exact))
    factor, b = triangle_of(np.column_stack([regressor, torque])), base.count
    reduced = Reduced(factor[:b, :b], factor[:b, b], float(factor[b, b] ** 2), len(torque))
    if generator.random() < 0.5:
        bare = tuple(Link(link.name) for link in model.robot.links)
        model = replace(model, robot=replace(model.robot, links=bare))
    size = np.sqrt(np.mean(torque.reshape(-1, model.robot.dof) ** 2, axis=0))
    return model, base, reduced, natural_scale(model, size, np.full(model.robot.dof, 6.0))


def fit_of(posed: Posed, **options: object) -> ConsistentFit:
    return consistent_fit(*posed, **options)  # type: ignore[arg-type]


def check(posed: Posed, fit: ConsistentFit) -> None:
    model, base, reduced, _ = posed
    assert broken_conditions(model, fit.theta) == ()
    assert fit.optimality.gap <= 1e-7 and fit.optimality.shortfall <= 1e-7
    assert reduced.residual_square(base.from_standard(fit.theta)) >= reduced.rest * (1 - 1e-9)  # the free fit's
    assert np.all((fit.data_share >= 0) & (fit.data_share <= 1))


@pytest.mark.parametrize("seed", range(6))
def test_noisy_problems_give_possible_robots_and_a_proof(seed: int) -> None:
    for draw in range(3):
        posed = noisy(seed, draw=draw)
        check(posed, fit_of(posed))


@pytest.mark.battery
@pytest.mark.parametrize("arms", range(0, 50, 5))
def test_a_thousand_noisy_problems(arms: int) -> None:
    for seed in range(arms, arms + 5):
        for draw in range(20):
            posed = noisy(seed, draw=draw)
            check(posed, fit_of(posed))


@pytest.mark.parametrize("metric", METRICS)
def test_data_without_noise_that_ask_for_the_impossible_are_fitted(metric: Metric) -> None:
    """Friction below zero and nothing else wrong: the free fit leaves nothing, possible robots as with little noise."""
    model, base, regressor, exact = arm(4, 4, 1.0, 600)
    friction = [k for k in range(base.count) if base.names[k].startswith("Fv")]
    torque = exact - regressor[:, friction].sum(axis=1) * 10.0
    scale = natural_scale(model, np.full(4, np.std(torque)), np.full(4, 6.0))
    left, b = [], base.count
    for noise in (0.0, 1e-5):
        noisy_torque = torque + noise * np.std(torque) * np.random.default_rng(0).normal(size=len(torque))
        factor = triangle_of(np.column_stack([regressor, noisy_torque]))
        reduced = Reduced(factor[:b, :b], factor[:b, b], float(factor[b, b] ** 2), len(torque))
        posed = model, base, reduced, scale
        fit = fit_of(posed, metric=metric)
        check(posed, fit)
        left.append(reduced.residual_square(base.from_standard(fit.theta)))
    assert left[0] == pytest.approx(left[1], rel=0.02)  # the prior is weighed with another variance
    assert left[0] > 1e-4 * np.sum(torque**2)


@pytest.mark.parametrize("mass", [1e-4, 1e4])
@pytest.mark.parametrize("metric", METRICS)
def test_arms_of_grams_and_of_tonnes(mass: float, metric: Metric) -> None:
    posed = noisy(5, 4, mass)
    check(posed, fit_of(posed, metric=metric))


@pytest.mark.parametrize("metric", ["natural", "pull_back"])
@pytest.mark.parametrize("seed", [0, pytest.param(11, marks=pytest.mark.battery)])
def test_both_paths_reach_one_optimum(seed: int, metric: Metric) -> None:
    posed = noisy(seed)
    program = pose_program(*posed, metric=metric)
    start = inside(program)
    assert start is not None
    found = [solve_conic(program), solve_barrier(program, start)]
    values = [program.objective(each.phi) for each in found]
    assert np.ptp(values) <= 3e-7 * (values[0] + 0.5)
    assert all(optimality(program, each.phi, each.multipliers).gap < 1e-6 for each in found)


@pytest.mark.parametrize("seed", [3, 11, 12])
def test_the_entropic_optimum_by_newton_and_by_exponential_cones(seed: int) -> None:
    posed = noisy(seed, 4)
    program = pose_program(*posed, metric="entropic", pull=10.0)
    start = inside(program)
    assert start is not None
    newton, cones = solve_barrier(program, start), solve_conic(program)
    value = program.objective(newton.phi)
    assert optimality(program, newton.phi, newton.multipliers).gap < 1e-8
    assert program.objective(cones.phi) == pytest.approx(value, abs=1e-6 * (value + 0.5))


def test_gradient_and_curvature_of_the_program() -> None:
    posed = noisy(4, 3)
    program = pose_program(*posed, metric="entropic", pull=100.0)
    phi = program.start * 1.1
    steps = 1e-6 * np.eye(len(phi))
    slope = [(program.objective(phi + s) - program.objective(phi - s)) / 2e-6 for s in steps]
    size = np.abs(program.gradient(phi)).max()
    np.testing.assert_allclose(program.gradient(phi), slope, atol=1e-6 * size)
    turned = np.array([(program.gradient(phi + s) - program.gradient(phi - s)) / 2e-6 for s in steps])
    rows = program.curvature(phi)
    np.testing.assert_allclose(rows.T @ rows, turned, atol=1e-5 * np.abs(turned).max())


def test_the_proven_gap_is_never_too_small() -> None:
    """Points away from the optimum, with any multipliers: the proof holds, and is not far off near the optimum."""
    program = pose_program(*noisy(11))
    best = solve_conic(program)
    value = program.objective(best.phi)
    generator = np.random.default_rng(0)
    for size in (1e-6, 1e-4, 1e-2):
        anchor = np.where(np.abs(program.start) > 0, program.start, 0.1)
        phi = (1 - size) * best.phi + size * anchor * generator.uniform(0.9, 1.1)
        found = optimality(program, phi, best.multipliers)
        assert found.gap * (found.objective + 0.5) >= program.objective(phi) - value - 1e-7 * (value + 0.5)


def test_multipliers_times_slacks_are_written_out() -> None:
    """Units as multipliers: the slacks of the signs and the traces of the pseudo-inertias add up."""
    program = pose_program(*noisy(11))
    rules = program.conditions
    phi = program.start + 0.1 * np.any(rules.sign != 0.0, axis=0)
    units = Multipliers(np.zeros(len(rules.zero)), np.ones(len(rules.sign)), np.tile(np.eye(4), (program.links, 1, 1)))
    found = optimality(program, phi, units)
    traces = [np.trace(Inertia.from_vector(own).pseudo) for own in phi[: 10 * program.links].reshape(-1, 10)]
    signs = rules.sign @ phi + rules.sign_offset
    assert len(signs) and np.all(signs > 0.0)
    expected = np.sum(signs) + np.sum(traces) - 4.0 * program.links * rules.margin
    assert found.complementarity * (found.objective + 0.5) == pytest.approx(expected, rel=1e-9)
    assert found.gap == pytest.approx(found.complementarity + found.stationarity)
    less = optimality(program, phi, Multipliers(units.zero, -units.sign, -units.cones))  # none of these is possible
    assert less.complementarity == 0.0


def nothing(program: Program) -> ConicCandidate:
    """A solver that says it has solved the problem and hands back nonsense."""
    zero = Multipliers(
        np.zeros(len(program.conditions.zero)), np.zeros(len(program.conditions.sign)), np.zeros((program.links, 4, 4))
    )
    return ConicCandidate(-program.start, zero, "Solved", 1)


def crashing(program: Program) -> ConicCandidate:
    raise ValueError("injected")


@pytest.mark.parametrize("fault", [nothing, crashing])
def test_later_paths_stand_in_for_broken_ones(
    fault: Callable[[Program], ConicCandidate], monkeypatch: pytest.MonkeyPatch
) -> None:
    posed = noisy(11)
    whole = fit_of(posed)
    assert whole.path == "Clarabel" and whole.failed == ()
    monkeypatch.setattr(fitting, "solve_conic", fault)
    second = fit_of(posed)
    assert second.path == "log-det barrier" and len(second.failed) == 1
    check(posed, second)
    assert second.optimality.objective == pytest.approx(whole.optimality.objective, abs=1e-7)
    monkeypatch.setattr(fitting, "solve_barrier", fault)
    with pytest.raises(SolverFailed, match=r"Clarabel.*log-det barrier.*check the units"):
        fit_of(posed)


def test_stated_constraints_hold() -> None:
    posed = noisy(3, 4)
    free = fit_of(posed).theta.reshape(-1)
    mass = free[9:40:10]
    ellipsoid = Ellipsoid(np.array([0.05, 0.0, 0.0]), np.array([0.3, 0.2, 0.2]))
    corners = np.array([[0.0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1]])
    known = Constraints(
        {
            "link1": BodyConstraints(mass=ValueRange(1.2 * mass[0], 1.5 * mass[0]), centre_hull=corners),
            "link2": BodyConstraints(
                mass=ValueRange(2.0, 2.0), centre_box=BoundingBox(-np.full(3, 0.02), np.full(3, 0.02))
            ),
            "link3": BodyConstraints(symmetry={"y": 0.01}, body_ellipsoid=ellipsoid),
        },
        total_mass=ValueRange(high=0.9 * mass.sum() + 2.0 + mass[0]),
        fixed={"Fv[joint2]": 0.25},
    )
    for metric in METRICS:
        fit = fit_of(posed, constraints=known, metric=metric)
        assert fit.optimality.gap <= 1e-6 and broken_conditions(posed[0], fit.theta) == ()
        first, second, third, _ = (Inertia.from_vector(ten) for ten in fit.theta[:40].reshape(4, 10))
        assert 1.2 * mass[0] * (1 - 1e-6) <= first.mass <= 1.5 * mass[0] * (1 + 1e-6)
        centre = first.centre_of_mass
        assert centre.min() >= -1e-6 and centre.sum() <= 0.1 + 1e-6
        assert second.mass == pytest.approx(2.0, rel=1e-6) and np.abs(second.centre_of_mass).max() <= 0.02 + 1e-6
        assert np.sum(third.pseudo * ellipsoid.quadric) >= -1e-6
        away = np.eye(4)
        away[1, 3] = -0.01  # seen from the plane of symmetry its moment and products vanish
        mirrored = away @ third.pseudo @ away.T
        np.testing.assert_allclose(mirrored[1, [0, 2, 3]], 0.0, atol=1e-6 * np.trace(third.pseudo))
        assert fit.theta[[p.name for p in posed[0].parameters].index("Fv[joint2]")] == pytest.approx(0.25, rel=1e-6)
        assert any("centre of mass" in each["condition"] or "mass" in each["condition"] for each in fit.active)


def thinnest(theta: Array) -> Array:
    """Return the least root mean square distance of each body from a plane through its centre of mass, in m."""
    found = []
    for ten in theta.reshape(-1, 10):
        pseudo = Inertia.from_vector(ten).pseudo
        centre = pseudo[:3, 3] / ten[9]
        found.append(np.sqrt(np.linalg.eigvalsh(pseudo[:3, :3] / ten[9] - np.outer(centre, centre))[0]))
    return np.array(found)


def test_both_paths_keep_the_minimum_thickness() -> None:
    posed, least = noisy(4, joints=3), 0.1
    known = Constraints({link.name: BodyConstraints(thickness=least) for link in posed[0].robot.links})
    count = posed[0].inertial_count
    assert np.min(thinnest(fit_of(posed).theta[:count])) < least / 2  # else the condition would do nothing
    fit = fit_of(posed, constraints=known)
    assert fit.optimality.gap < 1e-7
    assert np.min(thinnest(fit.theta[:count])) > least * (1 - 1e-4)
    assert any("a body of the minimum thickness" in condition["condition"] for condition in fit.active)
    program = pose_program(*posed, constraints=known)
    start = inside(program)
    assert start is not None
    for other in (solve_conic(program), solve_barrier(program, start)):
        found = optimality(program, other.phi, other.multipliers)
        assert found.gap < 1e-5
        assert found.objective == pytest.approx(fit.optimality.objective, rel=1e-5)


def test_a_thickness_that_does_not_fit_the_box_is_named() -> None:
    posed = noisy(3, joints=2)
    box = BoundingBox(np.full(3, -0.05), np.full(3, 0.05))  # largest possible root mean square distance: 0.05 m
    name = posed[0].robot.links[0].name
    fit_of(posed, constraints=Constraints({name: BodyConstraints(body_box=box, thickness=0.045)}))
    with pytest.raises(ContradictoryConstraints, match=f"{name}: a body of the minimum thickness"):
        fit_of(posed, constraints=Constraints({name: BodyConstraints(body_box=box, thickness=0.055)}))


def test_matter_stays_in_its_box_and_centres_in_their_plane() -> None:
    """Second moments are those of points in the slab of each axis; flat hulls and equal bounds are equations."""
    posed = noisy(3, 4)
    low, high = np.array([-0.2, -0.1, -0.15]), np.array([0.2, 0.15, 0.1])
    flat = np.array([[0.0, 0.0, 0.02], [0.3, 0.0, 0.02], [0.0, 0.3, 0.02]])
    known = Constraints(
        {
            "link1": BodyConstraints(body_box=BoundingBox(low, high)),
            "link2": BodyConstraints(centre_hull=flat),
            "link3": BodyConstraints(centre_box=BoundingBox(np.array([0.01, -1, -1]), np.array([0.01, 1, 1]))),
        }
    )
    fit = fit_of(posed, constraints=known)
    assert fit.optimality.gap <= 1e-6
    first, second, third, _ = (Inertia.from_vector(ten) for ten in fit.theta[:40].reshape(4, 10))
    mean, square = first.centre_of_mass, np.diag(first.pseudo)[:3] / first.mass
    assert np.all(square <= (low + high) * mean - low * high + 1e-6)  # (x - low)(high - x) >= 0 on average
    moment = second.vector[6:9]  # equations hold to a share of the link's size, however small its mass
    assert moment[2] == pytest.approx(0.02 * second.mass, abs=1e-6) and moment[:2].sum() <= 0.3 * second.mass + 1e-6
    assert third.vector[6] == pytest.approx(0.01 * third.mass, abs=1e-6)
    free = [Inertia.from_vector(ten) for ten in fit_of(posed).theta[:40].reshape(4, 10)]
    beyond = np.diag(free[0].pseudo)[:3] / free[0].mass - (low + high) * free[0].centre_of_mass + low * high
    assert beyond.max() > 0.01 and abs(free[1].centre_of_mass[2] - 0.02) > 0.01  # the data alone would break them


BOX = BoundingBox(np.array([0.5, -0.1, -0.1]), np.array([0.6, 0.1, 0.1]))
SMALL = Ellipsoid(np.zeros(3), np.full(3, 0.1))

CLASHES = {
    "masses": (
        Constraints(
            {"link1": BodyConstraints(mass=ValueRange(low=5.0)), "link2": BodyConstraints(mass=ValueRange(low=4.0))},
            total_mass=ValueRange(high=8.0),
        ),
        ["link1: mass >= 5 kg", "link2: mass >= 4 kg", "total mass <= 8 kg", "short by"],
    ),
    "shapes": (
        Constraints({"link2": BodyConstraints(centre_box=BOX, body_ellipsoid=SMALL)}),
        ["link2: centre of mass x >= 0.5 m", "link2: all matter in the ellipsoid"],
    ),
    "equations": (
        Constraints(
            {"link1": BodyConstraints(mass=ValueRange(3, 3)), "link2": BodyConstraints(mass=ValueRange(2, 2)),
             "link3": BodyConstraints(mass=ValueRange(1, 1))}, total_mass=ValueRange(7, 7)
        ),
        ["link1: mass = 3 kg", "link3: mass = 1 kg", "total mass = 7 kg"],
    ),
    "sign": (Constraints(fixed={"Fv[joint2]": -1.0}), ["Fv[joint2] = -1 ", "Fv[joint2] >= 0"]),
}  # fmt: skip


@pytest.mark.parametrize("metric", METRICS)
@pytest.mark.parametrize("name", CLASHES)
def test_contradictions_are_named(name: str, metric: Metric) -> None:
    known, words = CLASHES[name]
    with pytest.raises(ContradictoryConstraints) as caught:
        fit_of(noisy(11, 3), constraints=known, metric=metric)
    assert all(word in str(caught.value) for word in words)
    assert "link3: mass" not in str(caught.value) or name == "equations"


def test_what_is_short_is_told_in_its_unit() -> None:
    """5 kg and 4 kg do not fit into 8 kg: at best the three conditions are missed by one kilogram together."""
    known, _ = CLASHES["masses"]
    with pytest.raises(ContradictoryConstraints) as caught:
        fit_of(noisy(11, 3), constraints=known)
    amounts = [float(amount) for amount in re.findall(r"short by (\S+) kg at best", str(caught.value))]
    assert len(amounts) == 3 and min(amounts) > 0 and sum(amounts) == pytest.approx(1.0, abs=0.02)


def test_the_deepest_point_is_proven() -> None:
    """Three masses of at least 1, 2 and 3 kg under a total of 9 kg leave 3 kg to share: the depth has a closed form."""
    model, _, _, scale = noisy(11, 3)
    lows = {f"link{i}": BodyConstraints(mass=ValueRange(low=float(i))) for i in (1, 2, 3)}
    rules = conditions_of(model, scale, 0.0, Constraints(lows, ValueRange(high=9.0)))
    found = deepest(rules)
    assert 0 < found.depth <= found.bound + 1e-6 and found.left_over < 1e-6
    assert rules.shortfall(found.phi) == 0.0 and check_room(rules) is not None
    with pytest.raises(UnknownChoice, match=r"standard parameter called 'Fv\[joint9\]'"):
        conditions_of(model, scale, 0.0, Constraints(fixed={"Fv[joint9]": 1.0}))


def test_metrics_of_one_body_in_closed_form() -> None:
    """Without data the prior is the answer; with one datum on the mass the pull-back answer is a weighted mean."""
    body = Inertia.from_centre_of_mass(2.0, [0.1, 0, 0], 0.02 * np.eye(3))
    slide = Joint("joint1", "prismatic", -1, np.eye(3), np.zeros(3), np.array([0, 0, 1.0]))
    model = DynamicModel(Robot("lift", (Link("link1", body),), (slide,)))
    base, scale = base_parameters(model), natural_scale(model, np.ones(1), np.ones(1))
    assert base.names == ("m[link1]",)
    for metric in METRICS:
        weak = Reduced(np.full((1, 1), 1e-9), np.array([3e-9]), 1.0, 1)
        np.testing.assert_allclose(
            consistent_fit(model, base, weak, scale, metric=metric).theta, body.vector, atol=1e-4
        )
        strong = Reduced(np.full((1, 1), 1e4), np.array([3e4]), 1.0, 1)
        fit = consistent_fit(model, base, strong, scale, metric=metric)
        assert fit.theta[9] == pytest.approx(3.0, rel=1e-5)
        assert fit.data_share[9] > 0.99 and np.all(fit.data_share[:6] < 0.9)


def test_metrics_do_not_depend_on_the_frame_of_a_link() -> None:
    """Pull-back and entropic distances are those of bodies: moving the link's frame moves nothing else."""
    body = Inertia.from_centre_of_mass(2.0, [0.1, 0.05, 0], np.diag([0.02, 0.03, 0.04]))
    other = Inertia.from_centre_of_mass(3.0, [0.0, 0.02, 0.1], np.diag([0.05, 0.03, 0.04]))
    turn, shift = rotation_about(np.array([0, 0.6, 0.8]), 1.0), np.array([0.5, -1.0, 2.0])
    slide = Joint("joint1", "prismatic", -1, np.eye(3), np.zeros(3), np.array([0, 0, 1.0]))
    for metric in ("pull_back", "entropic"):
        values = []
        for prior, there in ((body, other), (body.moved(turn, shift), other.moved(turn, shift))):
            model = DynamicModel(Robot("lift", (Link("link1", prior),), (slide,)))
            scale = natural_scale(model, np.ones(1), np.ones(1))
            none = Reduced(np.zeros((1, 1)), np.zeros(1), 1.0, 1)
            program = pose_program(model, base_parameters(model), none, scale, metric=metric, pull=1.0)
            values.append(program.objective(there.vector / scale.parameters))
        assert values[0] == pytest.approx(values[1], rel=1e-6)
