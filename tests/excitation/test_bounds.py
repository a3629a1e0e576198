"""Bounds of a designed motion: what they count against the model itself, and every slope against differences."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from motion_problems import TipWalls, model_of, problem_of

from dynident.arrays import Array
from dynident.errors import BadOption
from dynident.excitation.collision.tool_speed import ToolPoint
from dynident.excitation.design.bounds import smooth_parameters
from dynident.excitation.design.design_problem import DesignProblem
from dynident.excitation.design.feasibility import feasible_start
from dynident.excitation.design.limits import ToolLimit, check_limits
from dynident.excitation.design.observation import TorqueUncertainty
from dynident.excitation.design.parametrisation import kinds
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import Motion
from dynident.model.friction.coulomb import Coulomb
from dynident.model.friction.spring import Spring
from dynident.model.robot import Robot

ARMS = ("planar_2r", "coupled_arm", "sliding_arm", "mimic_arm")


@pytest.fixture(params=ARMS)
def model(request: pytest.FixtureRequest) -> DynamicModel:
    return model_of(request.getfixturevalue(request.param))


def worst_of(problem: DesignProblem, x: Array) -> dict[tuple[str, str], list[float]]:
    """Return the shares of each owner and quantity, in the order of the rows."""
    found: dict[tuple[str, str], list[float]] = {}
    for label, used in zip(problem.labels, problem.point(x, 4.0).used, strict=True):
        found.setdefault((label.owner, label.quantity), []).append(float(used))
    return found


def check_slopes(problem: DesignProblem, seed: int = 5) -> None:
    """Compare every slope with central differences, at a point where no worst sample changes."""
    x = feasible_start(problem, np.random.default_rng(seed))
    point = problem.point(x, 4.0)
    assert point.used.shape == (len(problem.labels),) and point.slopes.shape == (len(problem.labels), problem.size)
    step = 1e-6
    for k in range(3):
        way = np.random.default_rng(k).normal(size=x.size)
        above, below = problem.point(x + step * way, 4.0), problem.point(x - step * way, 4.0)
        rise = (above.used - below.used) / (2 * step)
        np.testing.assert_allclose(rise, point.slopes @ way, rtol=2e-5, atol=2e-6 * np.abs(point.slopes @ way).max())
        slope = (above.objective - below.objective) / (2 * step)  # log det amplifies rounding, hence the tolerance
        assert slope == pytest.approx(float(point.gradient @ way), rel=1e-3, abs=1e-4)


def test_slopes_of_all_bounds_on_unlike_arms(model: DynamicModel) -> None:
    problem = problem_of(model, sigmas=2.0)
    quantities = ("position", "velocity", "acceleration", "jerk", "torque", "torque rate")
    assert [label.quantity for label in problem.labels if label.owner == "joint1"] == [
        *quantities[:4],
        *quantities[:4],
        *np.repeat(quantities[4:], 2),
    ]
    check_slopes(problem)


@pytest.mark.parametrize("kind", kinds())
@pytest.mark.parametrize("robot", ["planar_2r", "mimic_arm"])
def test_slopes_with_clearances(request: pytest.FixtureRequest, robot: str, kind: str) -> None:
    problem = problem_of(model_of(request.getfixturevalue(robot)), kind, clearance=TipWalls())
    assert [label for label in problem.labels if label.quantity == "clearance"] == [
        (name, "clearance") for name in TipWalls().names
    ]
    check_slopes(problem)


def test_slopes_with_a_tool_speed(model: DynamicModel) -> None:
    point = ToolPoint(model.robot.chain, len(model.robot.links) - 1, np.array([0.2, 0.1, -0.05]))
    problem = problem_of(model, tool=ToolLimit(point, 0.7))
    assert problem.labels[-1] == ("tool", "tool speed")
    check_slopes(problem)
    x = feasible_start(problem, np.random.default_rng(5))
    trajectory = problem.parametrisation.trajectory(problem.free(x))
    row = check_limits(trajectory, problem.limits, 6001, tool=problem.tool)[-1]
    assert (row.joint, row.quantity, row.unit, row.limit) == ("tool", "tool speed", "m/s", 0.7)
    time, step = np.array([row.time]), 1e-5
    ends = [point.position(trajectory.evaluate(time + side)[0])[0] for side in (-step, step)]
    assert row.value == pytest.approx(float(np.linalg.norm(ends[1] - ends[0])) / (2 * step), rel=1e-6)
    assert row.used == pytest.approx(row.value / 0.7) and row.kept
    with pytest.raises(BadOption, match=r"tool speed = 0.0 is not possible"):
        ToolLimit(point, 0.0)


def test_torque_and_its_rate_are_those_of_the_model(model: DynamicModel) -> None:
    problem = problem_of(model)
    x = feasible_start(problem, np.random.default_rng(1))
    motion, found = problem.motion(x), worst_of(problem, x)
    assert problem.theta is not None and problem.smooth_theta is not None
    torque = model.torque(motion, problem.theta)
    np.testing.assert_allclose(
        [found[joint, "torque"] for joint in problem.limits.joints],
        np.stack([torque.max(axis=0), -torque.min(axis=0)], axis=1) / problem.limits.torque[:, None],
        rtol=1e-9,
    )
    smooth = model.torque(motion, problem.smooth_theta)
    rate = np.diff(smooth, axis=0, append=smooth[:1]) * problem.samples / 6.0
    np.testing.assert_allclose(
        [found[joint, "torque rate"] for joint in problem.limits.joints],
        np.stack([rate.max(axis=0), -rate.min(axis=0)], axis=1) / problem.limits.torque_rate[:, None],
        rtol=1e-9,
        atol=1e-12,
    )


def test_the_chance_margin_is_the_standard_deviation_of_the_predicted_torque(model: DynamicModel) -> None:
    problem, plain = problem_of(model, sigmas=2.5), problem_of(model)
    x = feasible_start(problem, np.random.default_rng(1))
    assert problem.uncertainty is not None and problem.theta is not None
    motion = problem.motion(x)
    rows = model.regressor(motion)[..., problem.observation.base.independent]
    deviation = np.sqrt(np.einsum("sib,bc,sic->si", rows, problem.uncertainty.covariance, rows))
    torque = model.torque(motion, problem.theta)
    found, without = worst_of(problem, x), worst_of(plain, x)
    for i, joint in enumerate(problem.limits.joints):
        expected = [(torque + 2.5 * deviation)[:, i].max(), (2.5 * deviation - torque)[:, i].max()]
        np.testing.assert_allclose(found[joint, "torque"], np.array(expected) / problem.limits.torque[i], rtol=1e-9)
        assert min(np.subtract(found[joint, "torque"], without[joint, "torque"])) > 0
        assert found[joint, "torque rate"] == without[joint, "torque rate"]


def test_two_sigmas_cover_the_torques_of_robots_that_differ_that_much(planar_2r: Robot) -> None:
    """The margin of 2 sigmas holds at 95 % of the samples of models drawn from the covariance."""
    problem = problem_of(model_of(planar_2r), sigmas=2.0)
    motion = problem.motion(feasible_start(problem, np.random.default_rng(3)))
    model, base, theta = problem.observation.model, problem.observation.base, problem.theta
    assert theta is not None
    rows = model.regressor(motion)[..., base.independent]
    drawn = np.random.default_rng(0).normal(size=(4000, len(theta))) * 0.1 * np.abs(theta)
    off = np.einsum("sib,kb->ski", rows, drawn @ base.matrix.T)
    blocks = problem.observation.rows(motion)
    assert problem.spread_factors is not None
    for i, (block, factor) in enumerate(zip(blocks, problem.spread_factors, strict=True)):
        spread = np.linalg.norm(factor.T @ block, axis=0)
        assert np.mean(np.abs(off[..., i]) <= spread[:, None]) == pytest.approx(0.9545, abs=0.01)


def test_dry_friction_has_no_rate(coupled_arm: Robot) -> None:
    robot = model_of(coupled_arm).robot
    dry = {"Fc", "Fs", "Fl", "Fc+", "Fc-"}
    smooth_ones = ("viscous", "offset", "rotor_inertia", "polynomial", "periodic")
    for parts in ((Coulomb(width=0.0), *smooth_ones), ("coulomb", "stribeck", "load", *smooth_ones), ("asymmetric",)):
        model = DynamicModel(robot, parts)  # type: ignore[arg-type]
        smooth = smooth_parameters(model)
        assert smooth[: model.inertial_count].all() and len(smooth) == len(model.parameters)
        found = {p.symbol for p, counts in zip(model.parameters, smooth, strict=True) if not counts}
        assert found == dry & {p.symbol for p in model.parameters}


def test_parts_of_some_joints_have_a_rate_of_their_own(coupled_arm: Robot) -> None:
    robot = model_of(coupled_arm).robot
    first, *others = robot.joint_names
    parts = (Coulomb(0.01, joints=(first,)), Coulomb(0.02, joints=tuple(others)), Spring(joints=(first,)))
    model = DynamicModel(robot, parts)
    smooth = smooth_parameters(model)
    assert [p.symbol for p, counts in zip(model.parameters, smooth, strict=True) if not counts] == ["Fc"] * robot.dof


def test_bounds_that_are_not_stated_have_no_row(planar_2r: Robot) -> None:
    model = model_of(planar_2r)
    limits = problem_of(model).limits
    none = np.full(2, np.inf)
    bare = replace(limits, torque=none, torque_rate=np.array([np.inf, 100.0]), jerk=none)
    problem = problem_of(model, limits=bare)
    counted = [label.quantity for label in problem.labels]
    assert counted.count("jerk") == counted.count("torque") == 0 and counted.count("torque rate") == 2
    assert {label.owner for label in problem.labels if label.quantity == "torque rate"} == {"joint2"}
    check_slopes(problem)


def test_an_uncertainty_of_something_else(planar_2r: Robot) -> None:
    problem = problem_of(model_of(planar_2r))
    with pytest.raises(BadOption, match=r"of 3 parameters.*the model has \d+ base parameters; give their covariance"):
        replace(problem, uncertainty=TorqueUncertainty(np.eye(3)))
    right = TorqueUncertainty(np.eye(problem.observation.base.count))
    with pytest.raises(BadOption, match="uncertainty = 'of no torques' is not possible"):
        replace(problem, uncertainty=right, theta=None)


def test_without_uncertainty_of_anything_nothing_is_kept_free(planar_2r: Robot) -> None:
    problem = problem_of(model_of(planar_2r))
    count = problem.observation.base.count
    sure = replace(problem, uncertainty=TorqueUncertainty(np.zeros((count, count)), 3.0))
    x = feasible_start(problem, np.random.default_rng(3))
    np.testing.assert_allclose(sure.point(x, 4.0).used, problem.point(x, 4.0).used, atol=1e-12)
    np.testing.assert_allclose(sure.point(x, 4.0).slopes, problem.point(x, 4.0).slopes, atol=1e-12)
    still = Motion(*(np.zeros((1, 2)) for _ in range(3)))
    assert problem.observation.rows(still)[0].shape[1] == 1
