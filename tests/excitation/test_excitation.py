"""Excitation design: exact gradients, limits that hold between samples, and motions better than chance."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from dynident.arrays import Array
from dynident.errors import BadOption, InfeasibleTrajectory, UnknownChoice
from dynident.excitation.criteria import CRITERIA
from dynident.excitation.design.design_problem import DesignProblem
from dynident.excitation.design.excitation import design_excitation
from dynident.excitation.design.feasibility import feasible_start, shrunk
from dynident.excitation.design.limits import MotionLimits, check_limits, limits_of
from dynident.excitation.design.multistart import SearchState
from dynident.excitation.design.observation import Observation
from dynident.excitation.design.options import DesignKnowledge, SearchOptions, TrajectoryOptions
from dynident.excitation.design.parametrisation import parametrise
from dynident.excitation.design.plan import Plan
from dynident.excitation.design.prior import Prior
from dynident.excitation.trajectories.fourier import FourierSeries
from dynident.model.base_parameters import base_parameters
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import Motion
from dynident.model.friction.coulomb import Coulomb
from dynident.model.friction.viscous import Viscous
from dynident.model.joint import JointLimits
from dynident.model.robot import Robot
from dynident.robot_files import read_robot
from dynident.studies import er16_article as article

FRICTION = ("coulomb", "viscous", "offset")
LIMITS = JointLimits(-2.0, 1.5, 2.0, 8.0, 60.0, 150.0)
ARMS = ("planar_2r", "coupled_arm", "sliding_arm", "mimic_arm")


def model_of(robot: Robot, limits: JointLimits = LIMITS) -> DynamicModel:
    joints = tuple(replace(joint, limits=limits) for joint in robot.joints)
    return DynamicModel(replace(robot, joints=joints), FRICTION)  # type: ignore[arg-type]


def problem_of(model: DynamicModel, criterion: str = "condition", kind: str = "rest_fourier") -> DesignProblem:
    observation = Observation(model, base_parameters(model))
    limits, noise = limits_of(model.robot), np.linspace(0.5, 2.0, model.robot.dof)
    return DesignProblem(
        observation, parametrise(kind, 6.0, 4), CRITERIA.make(criterion), limits, noise, model.nominal(), 90
    )


@pytest.fixture(params=ARMS)
def model(request: pytest.FixtureRequest) -> DynamicModel:
    return model_of(request.getfixturevalue(request.param))


@pytest.fixture(scope="module")
def plan(planar_2r: Robot) -> Plan:
    return design_excitation(
        model_of(planar_2r),
        criterion="condition",
        trajectory=TrajectoryOptions(period=6.0, harmonics=4, samples=80),
        search=SearchOptions(starts=2),
    )


# --- the observation matrix --------------------------------------------------------------------------------------


def test_rows_are_those_of_the_regressor(model: DynamicModel, exact_motion: Callable[..., Motion]) -> None:
    observation = Observation(model, base_parameters(model))
    motion = exact_motion(model.robot.dof, np.linspace(0, 5, 30))
    whole = model.regressor(motion)[..., observation.base.independent]
    for i, (columns, block) in enumerate(zip(observation.columns, observation.rows(motion), strict=True)):
        rest = np.setdiff1d(np.arange(observation.base.count), columns)
        np.testing.assert_allclose(block.T, whole[:, i, columns], atol=1e-10)
        np.testing.assert_allclose(whole[:, i, rest], 0.0, atol=1e-10)


def test_information_and_triangle_are_of_the_weighted_matrix(
    model: DynamicModel, exact_motion: Callable[..., Motion]
) -> None:
    observation = Observation(model, base_parameters(model))
    noise = np.linspace(0.5, 2.0, model.robot.dof)
    motion = exact_motion(model.robot.dof, np.linspace(0, 30, 1300))  # more than one chunk
    whole = model.regressor(motion)[..., observation.base.independent] / noise[None, :, None]
    expected = np.einsum("sik,sil->kl", whole, whole) / 1300
    information = observation.information(observation.rows(motion), noise)
    triangle = observation.triangle(motion, noise)
    np.testing.assert_allclose(information, expected, atol=1e-9 * np.abs(expected).max())
    np.testing.assert_allclose(triangle.T @ triangle, expected, atol=1e-9 * np.abs(expected).max())


# --- gradients ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("criterion", CRITERIA.names())
def test_gradients_are_derivatives(planar_2r: Robot, criterion: str) -> None:
    _check_gradients(problem_of(model_of(planar_2r), criterion, "fourier"))


def test_gradients_of_coupled_sliding_and_mimic_arms(model: DynamicModel) -> None:
    _check_gradients(problem_of(model, "d_optimal"))


def _check_gradients(problem: DesignProblem) -> None:
    x = 0.9 * feasible_start(problem, np.random.default_rng(5))
    sharpness = problem.criterion.stages[-1]
    point = problem.point(x, sharpness)
    assert len(point.used) == 2 * 5 * problem.joints
    for seed in range(3):
        way = np.random.default_rng(seed).normal(size=x.size)
        step = 1e-6
        above, below = problem.point(x + step * way, sharpness), problem.point(x - step * way, sharpness)
        slope = (above.objective - below.objective) / (2 * step)
        assert slope == pytest.approx(float(point.gradient @ way), rel=2e-5, abs=2e-6)
        np.testing.assert_allclose((above.used - below.used) / (2 * step), point.slopes @ way, rtol=1e-5, atol=1e-6)


def test_shares_of_the_limits_are_those_of_the_check(model: DynamicModel) -> None:
    problem = problem_of(model)
    x = feasible_start(problem, np.random.default_rng(1))
    used = problem.point(x, 4.0).used
    theta = model.nominal()
    assert theta is not None
    motion = problem.parametrisation.trajectory(problem.free(x))
    rows = check_limits(motion, problem.limits, problem.samples + 1, lambda m: model.torque(m, theta))
    by_kind = {(row.quantity, row.joint): row.used for row in rows}
    names = ("position", "velocity", "acceleration", "jerk")
    kinematic = [(names[order], problem.limits.joints[joint]) for order, joint in problem.kinematic]
    driven = [("torque", problem.limits.joints[joint]) for joint in problem.driven]
    first = 2 * len(kinematic)
    for keys, shares in ((kinematic, used[:first]), (driven, used[first:])):
        assert len(keys) > 1
        for key, high, low in zip(keys, *np.split(shares, 2), strict=True):  # the highest, minus the lowest
            assert max(high, low) == pytest.approx(by_kind[key], rel=1e-9)


# --- start points and shrinking ----------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(20))
def test_every_start_point_is_feasible(spatial_3r: Robot, seed: int) -> None:
    problem = problem_of(model_of(spatial_3r), kind="fourier")
    assert problem.point(feasible_start(problem, np.random.default_rng(seed)), 4.0).used.max() < 1.0


def test_a_robot_that_cannot_hold_itself_has_no_start_point(planar_2r: Robot) -> None:
    weak = problem_of(model_of(planar_2r, replace(LIMITS, lower=-0.4, upper=0.4, effort=5.0)))
    with pytest.raises(InfeasibleTrajectory, match=r"the torque of joint1: every one of 2560 postures needs at least"):
        feasible_start(weak, np.random.default_rng(0))


def test_shrinking_keeps_the_bounds_between_the_samples(planar_2r: Robot) -> None:
    problem = problem_of(model_of(planar_2r), kind="fourier")
    x = 3.0 * feasible_start(problem, np.random.default_rng(2))
    kept = shrunk(problem, x)  # on the coarse grid of 90 samples
    assert kept is not None
    motion = problem.parametrisation.trajectory(problem.free(kept))
    rows = check_limits(motion, problem.limits, 100_001)
    assert max(row.used for row in rows) <= 1.0
    assert max(row.used for row in rows) > 0.9


# --- the design --------------------------------------------------------------------------------------------------


def test_a_design_keeps_its_limits_everywhere_and_starts_at_rest(plan: Plan, planar_2r: Robot) -> None:
    assert plan.feasible and plan.run_in == 0.0
    model = model_of(planar_2r)
    theta = model.nominal()
    assert theta is not None
    rows = check_limits(plan.motion(), limits_of(model.robot), 60_001, lambda m: model.torque(m, theta))
    assert max(row.used for row in rows) <= 1.0
    assert max(row.used for row in rows) > 0.98  # the limits are used
    for signal in plan.trajectory.evaluate([0.0, 6.0])[1:]:
        np.testing.assert_allclose(signal, 0.0, atol=1e-9)


def test_a_design_is_far_better_than_its_start(plan: Plan, planar_2r: Robot) -> None:
    problem = problem_of(model_of(planar_2r))
    ones = np.ones(2)
    starts = [problem.motion(feasible_start(problem, np.random.default_rng(seed))) for seed in range(10)]
    figures = [problem.criterion.value(problem.observation.triangle(motion, ones)) for motion in starts]
    assert plan.values["condition"] < 0.7 * min(figures)


def test_the_figures_are_those_of_the_motion(plan: Plan, planar_2r: Robot) -> None:
    model = model_of(planar_2r)
    base = base_parameters(model)
    motion = Motion(*plan.trajectory.evaluate(np.arange(800) * 6.0 / 800))
    matrix = model.regressor(motion)[..., base.independent].reshape(-1, base.count)
    assert plan.values["condition"] == pytest.approx(np.linalg.cond(matrix), rel=1e-8)
    unit = matrix / np.linalg.norm(matrix, axis=0)
    assert plan.values["unit_condition"] == pytest.approx(np.linalg.cond(unit), rel=1e-8)
    weighted = matrix / np.tile(plan.settings["noise"], 800)[:, None]
    information = weighted.T @ weighted / 800
    assert plan.values["d_optimal"] == pytest.approx(np.linalg.slogdet(information)[1], rel=1e-4)
    assert plan.values["a_optimal"] == pytest.approx(np.trace(np.linalg.inv(information)), rel=1e-6)
    assert plan.values["e_optimal"] == pytest.approx(np.linalg.eigvalsh(information)[0], rel=1e-6)


@pytest.mark.parametrize("criterion", ["unit_condition", "d_optimal", "e_optimal", "a_optimal"])
def test_each_criterion_is_best_at_its_own_figure(plan: Plan, planar_2r: Robot, criterion: str) -> None:
    own = design_excitation(
        model_of(planar_2r),
        criterion=criterion,
        trajectory=TrajectoryOptions(period=6.0, harmonics=4, samples=80),
        search=SearchOptions(starts=4),
    )
    assert own.feasible and own.criterion == criterion
    sign = -1.0 if CRITERIA.get(criterion).larger_is_better else 1.0
    # The smallest eigenvalue and the condition number ask for nearly the same here: local optima differ by as much.
    slack = 0.05 * abs(plan.values[criterion]) if criterion in ("e_optimal", "a_optimal") else 0.0
    assert sign * own.values[criterion] < sign * plan.values[criterion] + slack


def test_a_seed_gives_the_same_plan_and_another_seed_another(planar_2r: Robot) -> None:
    def table(seed: int) -> Array:
        plan = design_excitation(
            model_of(planar_2r),
            trajectory=TrajectoryOptions(period=6.0, harmonics=3, samples=60),
            search=SearchOptions(starts=1, seed=seed),
        )
        return np.asarray(plan.trajectory.sine)

    np.testing.assert_array_equal(table(0), table(0))
    assert not np.allclose(table(0), table(1))


def test_a_fourier_series_gets_a_run_in_that_keeps_the_limits(planar_2r: Robot) -> None:
    model = model_of(planar_2r)
    plan = design_excitation(
        model,
        trajectory=TrajectoryOptions(kind="fourier", period=6.0, harmonics=3, samples=60),
        search=SearchOptions(starts=1),
    )
    assert plan.feasible and plan.run_in > 0
    motion = plan.motion()
    assert motion.duration == 6.0 + 2 * plan.run_in
    for signal in motion.evaluate([0.0, motion.duration])[1:]:
        np.testing.assert_allclose(signal, 0.0, atol=1e-9)
    assert max(row.used for row in check_limits(motion, plan.limits, 20_001)) <= 1.0 + 1e-4


def test_a_run_in_is_no_harsher_than_the_motion_where_nothing_is_stated(planar_2r: Robot) -> None:
    model = model_of(planar_2r, JointLimits(-2.0, 2.0, 2.0))
    plan = design_excitation(
        model,
        trajectory=TrajectoryOptions(kind="fourier", period=6.0, harmonics=3, samples=60),
        search=SearchOptions(starts=1),
    )
    time = np.linspace(0, 6, 601)
    own = np.abs(plan.trajectory.evaluate(time)[2]).max(axis=0)
    outside = np.r_[np.linspace(0, plan.run_in, 200), plan.motion().duration - np.linspace(0, plan.run_in, 200)]
    assert np.all(np.abs(plan.motion().evaluate(outside)[2]).max(axis=0) <= 1.01 * own)


def test_a_shifted_series_begins_later() -> None:
    generator = np.random.default_rng(0)
    motion = FourierSeries(generator.normal(size=2), *generator.normal(size=(2, 2, 4)), 5.0)
    time = np.linspace(0, 5, 20)
    np.testing.assert_allclose(motion.shifted(1.3).evaluate(time), motion.evaluate(time + 1.3), atol=1e-10)


def test_the_time_limit_ends_the_search_with_a_feasible_plan(planar_2r: Robot) -> None:
    seen: list[SearchState] = []
    plan = design_excitation(
        model_of(planar_2r),
        trajectory=TrajectoryOptions(period=6.0, harmonics=4, samples=80),
        search=SearchOptions(starts=50, time_limit=0.2),
        progress=seen.append,
    )
    assert plan.feasible
    assert plan.settings["seconds"] < 5.0
    assert 0 < seen[-1].finished < 50 and seen[-1].evaluations == plan.settings["evaluations"]


def test_limits_of_ones_own_and_given_noise(planar_2r: Robot) -> None:
    none = np.full(2, np.inf)
    limits = MotionLimits(("joint1", "joint2"), (True, True), -none, none, np.array([0.5, 0.7]), none, none, none)
    plan = design_excitation(
        model_of(planar_2r),
        limits,
        trajectory=TrajectoryOptions(period=6.0, harmonics=2, samples=60),
        search=SearchOptions(starts=1),
        knowledge=DesignKnowledge(noise=[1.0, 0.1]),
    )
    speed = {row.joint: row for row in plan.rows if row.quantity == "velocity"}
    assert speed["joint1"].limit == 0.5 and speed["joint2"].limit == 0.7
    assert plan.feasible and plan.settings["noise"] == [1.0, 0.1] and plan.settings["noise_source"] == "given"


def test_a_robot_without_inertias_has_no_torque_rows(planar_2r: Robot) -> None:
    model = model_of(planar_2r)
    bare = tuple(replace(link, inertia=None) for link in model.robot.links)
    plan = design_excitation(
        replace(model, robot=replace(model.robot, links=bare)),
        trajectory=TrajectoryOptions(period=6.0, harmonics=2, samples=60),
        search=SearchOptions(starts=1),
    )
    assert not [row for row in plan.rows if row.quantity == "torque"]
    assert plan.settings["torque_limits"] == "not checked: no nominal inertias"


def test_the_torque_of_a_heavier_estimate_is_kept(planar_2r: Robot) -> None:
    model = model_of(planar_2r, replace(LIMITS, effort=80.0))
    nominal = model.nominal()
    assert nominal is not None
    plan = design_excitation(
        model,
        trajectory=TrajectoryOptions(period=6.0, harmonics=3, samples=60),
        search=SearchOptions(starts=1),
        knowledge=DesignKnowledge(theta=1.5 * nominal),
    )
    assert plan.settings["torque_limits"] == "parameters given"
    shown = {row.joint: abs(row.value) for row in plan.rows if row.quantity == "torque"}
    time = np.linspace(0, 6, 601)
    torque = np.abs(model.torque(Motion(*plan.trajectory.evaluate(time)), 1.5 * nominal)).max(axis=0)
    np.testing.assert_allclose([shown["joint1"], shown["joint2"]], torque, rtol=1e-9)
    assert plan.feasible and torque[0] <= 64.0


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"search": SearchOptions(starts=0)}, "starts = 0"),
        ({"search": SearchOptions(time_limit=0.0)}, "time_limit = 0.0"),
        ({"trajectory": TrajectoryOptions(period=-1.0)}, "period = -1.0"),
        (
            {"trajectory": TrajectoryOptions(harmonics=1)},
            "harmonics = 1 is not possible; give 2 or more to start and end at rest",
        ),
        ({"trajectory": TrajectoryOptions("fourier", harmonics=0)}, "harmonics = 0"),
        ({"trajectory": TrajectoryOptions(samples=10)}, "samples = 10 is not possible; give 21 or more"),
        ({"knowledge": DesignKnowledge(noise=0.0)}, "noise = 0.0"),
        ({"knowledge": DesignKnowledge(noise=[1.0, 2.0, 3.0])}, "one for each of the 2 joints"),
        ({"knowledge": DesignKnowledge(theta=[1.0])}, r"theta = 'of shape \(1,\)'"),
        (
            {"knowledge": DesignKnowledge(rows=0.0)},
            "rows = 0.0 is not possible; give the number of rows of a joint that the run gives, above 0",
        ),
        (
            {"criterion": "condition", "knowledge": DesignKnowledge(earlier=Prior(np.eye(3), None, "one"))},
            "so earlier runs cannot be added; choose one of",
        ),
        (
            {"criterion": "d_optimal", "knowledge": DesignKnowledge(earlier=Prior(np.eye(3), None, "one"))},
            "earlier = 'of 3 base parameters'",
        ),
    ],
)
def test_options_that_cannot_be(planar_2r: Robot, given: dict[str, object], message: str) -> None:
    with pytest.raises(BadOption, match=message):
        design_excitation(model_of(planar_2r), **given)  # type: ignore[arg-type]


def test_names_that_are_none(planar_2r: Robot) -> None:
    with pytest.raises(UnknownChoice, match="no trajectory to design called 'rest-fourier'"):
        design_excitation(model_of(planar_2r), trajectory=TrajectoryOptions(kind="rest-fourier"))
    with pytest.raises(UnknownChoice, match="no criterion called 'cond'"):
        design_excitation(model_of(planar_2r), criterion="cond")


def test_limits_of_other_joints(planar_2r: Robot, spatial_3r: Robot) -> None:
    with pytest.raises(BadOption, match=r"limits = 'of joint1, joint2, joint3'.*the robot's joints: joint1, joint2$"):
        design_excitation(model_of(planar_2r), limits_of(model_of(spatial_3r).robot))


# --- the article's case ------------------------------------------------------------------------------------------


def test_designs_within_the_ranges_of_the_published_trajectory_are_better() -> None:
    robot = read_robot("er16").locked(article.LOCKED)
    series = FourierSeries.from_table(list(article.BETA_1), article.PERIOD)
    time = np.arange(article.SAMPLES) / article.RATE
    published = Motion(*series.evaluate(time))
    none = np.full(3, np.inf)
    ends = published.q.min(axis=0), published.q.max(axis=0)
    largest = np.abs(published.dq).max(axis=0), np.abs(published.ddq).max(axis=0)
    limits = MotionLimits(robot.joint_names, (True,) * 3, *ends, *largest, none, none)
    sharp = DynamicModel(robot, (Coulomb(width=0.0), Viscous()))
    observation = Observation(sharp, base_parameters(sharp))

    def figure(criterion: str, motion: Motion) -> float:
        return CRITERIA.make(criterion).value(observation.triangle(motion, np.ones(3)))

    assert figure("condition", published) == pytest.approx(75.9, abs=0.05)
    assert figure("unit_condition", published) == pytest.approx(5.96, abs=0.005)
    smooth = DynamicModel(robot, (Coulomb(), Viscous()))
    for criterion, most in (("condition", 60.0), ("unit_condition", 3.9)):  # 8 starts: 50.3 and 3.1
        plan = design_excitation(
            smooth,
            limits,
            criterion,
            trajectory=TrajectoryOptions(period=article.PERIOD),
            search=SearchOptions(starts=2),
        )
        assert plan.feasible
        assert figure(criterion, Motion(*plan.trajectory.evaluate(time))) < most
