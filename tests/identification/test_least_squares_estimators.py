"""OLS and WLS against the dense matrix, and the laws of weights."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from arm_models import model_of, theta_of
from dynident.arrays import Array
from dynident.data.log import Log
from dynident.data.preprocessing import Preprocessing
from dynident.data.preprocessing.as_given import AsGiven
from dynident.errors import BadOption
from dynident.identification.build_problem import build_problem
from dynident.identification.estimators.ols import OLS
from dynident.identification.estimators.wls import WLS
from dynident.identification.problem.problem import Problem
from dynident.model.robot import Robot

ARMS = ("pendulum", "planar_2r", "spatial_3r", "sliding_arm", "scara", "mimic_arm", "coupled_arm")
GIVEN = Preprocessing(AsGiven(), rest="keep")

MakeLog = Callable[..., Log]


def noise_of(joints: int) -> Array:
    """Return standard deviations that differ from joint to joint by a factor of ten."""
    return np.geomspace(2.0, 0.2, joints)


@pytest.mark.parametrize("arm", ARMS)
def test_ols_is_least_squares_of_all_rows(arm: str, request: pytest.FixtureRequest, exact_log: MakeLog) -> None:
    model = model_of(request.getfixturevalue(arm))
    problem = build_problem(model, [exact_log(model, theta_of(model), noise=noise_of(model.robot.dof))], GIVEN)
    solution = OLS().solve(problem)
    expected = np.linalg.lstsq(problem.rows.matrix, problem.rows.torque)[0]
    np.testing.assert_allclose(solution.beta, expected, rtol=1e-8, atol=1e-9 * np.abs(expected).max())
    np.testing.assert_array_equal(solution.weights, np.ones(model.robot.dof))
    assert solution.theta is None


def weighted(problem: Problem, steps: int) -> Array:
    """Return dense least squares with each joint over its residual deviation, renewed ``steps`` times."""
    rows = problem.rows
    beta = np.linalg.lstsq(rows.matrix, rows.torque)[0]
    share = 1 - problem.base.count / len(rows.torque)
    for _ in range(steps):
        error = rows.torque - rows.matrix @ beta
        own = [rows.joint == joint for joint in range(problem.model.robot.dof)]
        scale = np.empty(len(error))
        for mask in own:
            scale[mask] = np.sqrt(np.sum(error[mask] ** 2) / (mask.sum() * share))
        beta = np.linalg.lstsq(rows.matrix / scale[:, None], rows.torque / scale)[0]
    return beta


@pytest.mark.parametrize("steps", [1, 2])
@pytest.mark.parametrize("arm", ARMS)
def test_wls_is_reweighted_least_squares(
    arm: str, steps: int, request: pytest.FixtureRequest, exact_log: MakeLog
) -> None:
    model = model_of(request.getfixturevalue(arm))
    problem = build_problem(model, [exact_log(model, theta_of(model), noise=noise_of(model.robot.dof))], GIVEN)
    solution = WLS(iterations=steps, tolerance=0.0).solve(problem)
    expected = weighted(problem, steps)
    np.testing.assert_allclose(solution.beta, expected, rtol=1e-7, atol=1e-8 * np.abs(expected).max())
    np.testing.assert_allclose(solution.weights, 1 / problem.joint_deviations(solution.beta))
    assert solution.run.iterations == (1 if model.robot.dof == 1 else steps)  # one joint has nothing to weigh


def test_wls_settles(spatial_3r: Robot, exact_log: MakeLog) -> None:
    model = model_of(spatial_3r, "coulomb", "viscous", "offset")
    problem = build_problem(model, [exact_log(model, theta_of(model), noise=noise_of(3))], GIVEN)
    settled, forced = WLS(), WLS(iterations=50, tolerance=1e-12)
    assert settled.solve(problem).run.iterations < 6
    np.testing.assert_allclose(settled.solve(problem).beta, forced.solve(problem).beta, rtol=1e-3, atol=1e-3)
    np.testing.assert_allclose(1 / settled.solve(problem).weights, noise_of(3), rtol=0.15)


def test_wls_does_not_care_about_the_unit_of_a_joint(sliding_arm: Robot, exact_log: MakeLog) -> None:
    """Rows of a joint in other units, both sides alike: the weights take it up, and the estimate stays."""
    model = model_of(sliding_arm, "coulomb", "viscous", "offset")
    problem = build_problem(model, [exact_log(model, theta_of(model), noise=noise_of(3))], GIVEN)
    first, second, third = problem.triangles
    in_other_units = replace(problem, triangles=(first, replace(second, factor=1e3 * second.factor), third))
    plain, other = (WLS(iterations=30, tolerance=1e-10).solve(p) for p in (problem, in_other_units))
    np.testing.assert_allclose(other.beta, plain.beta, rtol=1e-6, atol=1e-8)
    np.testing.assert_allclose(other.weights, plain.weights * [1, 1e-3, 1], rtol=1e-6)
    moved = OLS().solve(in_other_units).beta - OLS().solve(problem).beta
    assert np.abs(moved).max() > 1e-3
    for unit in (1e-3, 1e3):
        scaled = replace(problem, triangles=tuple(replace(t, factor=unit * t.factor) for t in problem.triangles))
        assert WLS().solve(scaled).run == WLS().solve(problem).run  # it ends by the relative change


def test_wls_beats_ols_where_noise_differs(spatial_3r: Robot, exact_log: MakeLog) -> None:
    model = model_of(spatial_3r, "coulomb", "viscous", "offset")
    theta = theta_of(model)
    errors = []
    for seed in range(10):
        problem = build_problem(model, [exact_log(model, theta, noise=np.array([5.0, 5.0, 0.05]), seed=seed)], GIVEN)
        truth = problem.base.from_standard(theta)
        quiet = problem.triangles[2].columns  # the parameters that move the joint with little noise
        errors.append([np.linalg.norm((part.solve(problem).beta - truth)[quiet]) for part in (OLS(), WLS())])
    ols, wls = np.mean(errors, axis=0)
    assert wls < 0.3 * ols


def test_at_least_one_iteration() -> None:
    with pytest.raises(BadOption) as caught:
        WLS(iterations=0)
    assert str(caught.value) == "iterations = 0 is not possible; give 1 or more"
