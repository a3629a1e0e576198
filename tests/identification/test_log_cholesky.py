"""Log-Cholesky: exact Jacobian, the convex optimum where it lies inside, a verdict where it lies on the boundary."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from dynident.data.log import Log
from dynident.data.preprocessing import Preprocessing
from dynident.data.preprocessing.as_given import AsGiven
from dynident.errors import BadOption
from dynident.identification.build_problem import build_problem
from dynident.identification.consistency.log_cholesky_fit import BOUNDARY, CONVERGED, UNFINISHED, bodies_of
from dynident.identification.consistency.verdicts import broken_conditions
from dynident.identification.estimators.consistent import Consistent
from dynident.identification.estimators.log_cholesky import LogCholesky
from dynident.identification.problem.problem import Problem
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction.viscous import Viscous
from dynident.model.inertia import Inertia
from dynident.model.robot import Robot


def posed(robot: Robot, exact_log: Callable[..., Log], factor: float, noise: float) -> Problem:
    """Return a problem whose last link has its moments about the joint axis times a factor; negative: impossible."""
    model = DynamicModel(robot, (Viscous(),))
    assert robot.nominal is not None
    theta = np.append(robot.nominal, np.full(robot.dof, 0.5))
    theta[10 * robot.dof - 5] *= factor  # Izz
    return build_problem(model, [exact_log(model, theta, noise=noise)], Preprocessing(AsGiven(), rest="keep"))


def test_the_jacobian_is_exact() -> None:
    generator = np.random.default_rng(0)
    x = generator.uniform(-1, 1, 22)
    phi, slope = bodies_of(x, 2)
    np.testing.assert_allclose(phi[:10], Inertia.from_log_cholesky(x[:10]).vector)
    steps = 1e-6 * np.eye(22)
    expected = np.array([(bodies_of(x + s, 2)[0] - bodies_of(x - s, 2)[0]) / 2e-6 for s in steps]).T
    np.testing.assert_allclose(slope, expected, atol=1e-8)


@pytest.mark.parametrize("arm", ["planar_2r", "spatial_3r"])
def test_inside_it_is_the_convex_optimum(
    arm: str, request: pytest.FixtureRequest, exact_log: Callable[..., Log]
) -> None:
    problem = posed(request.getfixturevalue(arm), exact_log, 1.0, 0.2)
    found, best = LogCholesky().solve(problem), Consistent(bodies="free").solve(problem)
    assert found.run.verdict == CONVERGED and found.run.iterations < 40
    assert abs(found.run.gap) < 1e-6 and found.run.singular_links == []
    np.testing.assert_allclose(found.beta, best.beta, atol=1e-3 * np.abs(best.beta).max())


@pytest.mark.parametrize("arm", ["planar_2r", "spatial_3r"])
def test_an_end_on_the_boundary_far_from_the_proven_optimum_is_none(
    arm: str, request: pytest.FixtureRequest, exact_log: Callable[..., Log]
) -> None:
    robot = request.getfixturevalue(arm)
    problem = posed(robot, exact_log, -0.5, 0.2)
    found, best = LogCholesky().solve(problem), Consistent(bodies="free").solve(problem)
    assert found.run.verdict == UNFINISHED and found.run.iterations <= 100 and found.run.gap > 0.1
    assert robot.links[-1].name in found.run.singular_links
    assert found.theta is not None and broken_conditions(problem.model, found.theta) == ()
    assert any(robot.links[-1].name in words for words in best.run.active)


@pytest.mark.parametrize("arm", ["planar_2r", "spatial_3r"])
def test_on_the_boundary_near_the_proven_optimum_it_stops_and_says_so(
    arm: str, request: pytest.FixtureRequest, exact_log: Callable[..., Log]
) -> None:
    found = LogCholesky().solve(posed(request.getfixturevalue(arm), exact_log, 0.5, 3.0)).run
    assert found.verdict == BOUNDARY and found.iterations < 100 and found.singular_links and found.gap < 0.01


def test_too_few_steps_are_said(planar_2r: Robot, exact_log: Callable[..., Log]) -> None:
    found = LogCholesky(iterations=1).solve(posed(planar_2r, exact_log, 1.5, 0.2))
    assert found.run.verdict == UNFINISHED and found.run.gap > 0


@pytest.mark.parametrize(("option", "value"), [("pull", 0.0), ("iterations", 0)])
def test_options_that_are_none(option: str, value: float) -> None:
    with pytest.raises(BadOption):
        LogCholesky(**{option: value})  # type: ignore[arg-type]
