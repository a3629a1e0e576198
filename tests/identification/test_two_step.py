"""Two steps against dense least squares, and what the second owes to the first."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from dynident.data.log import Log
from dynident.errors import BadOption, PoorExcitation, SolverFailed
from dynident.identification.build_problem import build_problem
from dynident.identification.estimators.two_step import TwoStep, slow_samples
from dynident.identification.estimators.wls import WLS
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import FRICTION
from dynident.model.robot import Robot
from noisy_arms import GIVEN, Bench


@pytest.fixture(scope="module")
def bench(spatial_3r: Robot, exact_log: Callable[..., Log]) -> Bench:
    return Bench(spatial_3r, exact_log, friction=("coulomb", "viscous", "offset"))


def test_it_is_two_weighted_fits(bench: Bench) -> None:
    problem = bench.problem(bench.white(0))
    solution = TwoStep(share=0.6).solve(problem)
    slow, _ = slow_samples(problem, 0.6)
    held, rows = problem.base.is_friction, problem.rows
    assert solution.run.friction == [name for name in bench.base.names if name[:2] in ("Fc", "Fv", "F0")]
    early = slow[rows.samples]
    scale, beta = np.ones(3), np.zeros(bench.base.count)
    for _ in range(11):
        row = 1 / scale[rows.joint[early]]
        beta = np.linalg.lstsq(rows.matrix[early] * row[:, None], rows.torque[early] * row)[0]
        error = rows.torque[early] - rows.matrix[early] @ beta
        scale = np.array([np.sqrt(np.mean(error[rows.joint[early] == j] ** 2)) for j in range(3)])
    np.testing.assert_allclose(solution.beta[held], beta[held], rtol=1e-3, atol=1e-4)
    rest = rows.torque - rows.matrix[:, held] @ solution.beta[held]
    row = solution.weights[rows.joint]
    rigid = np.linalg.lstsq(rows.matrix[:, ~held] * row[:, None], rest * row)[0]
    np.testing.assert_allclose(solution.beta[~held], rigid, rtol=1e-3, atol=1e-4)


def test_all_samples_make_both_steps_one(bench: Bench) -> None:
    problem = bench.problem(bench.white(0))
    expected = WLS().solve(problem)
    solution = TwoStep(share=1.0).solve(problem)
    np.testing.assert_allclose(solution.beta, expected.beta, rtol=1e-3, atol=1e-3 * np.abs(expected.beta).max())


def test_slow_samples_are_those_with_the_smallest_acceleration(bench: Bench) -> None:
    problem = bench.problem(bench.white(0), cuts=(100,))
    slow, bound = slow_samples(problem, 0.3)
    acceleration = np.asarray(bench.log.ddq)
    relative = np.max(np.abs(acceleration) / np.sqrt(np.mean(acceleration**2, axis=0)), axis=1)
    assert slow.sum() == 120 and np.isclose(relative[slow].max(), bound) and relative[~slow].min() > bound


def test_too_few_slow_samples_are_refused(bench: Bench) -> None:
    with pytest.raises(
        PoorExcitation, match=r"friction in the samples with little acceleration, undetermined: .*share"
    ):
        TwoStep(share=0.005).solve(bench.problem(bench.white(0)))


def test_a_model_without_friction_is_refused(planar_2r: Robot, exact_log: Callable[..., Log]) -> None:
    model = DynamicModel(planar_2r, (FRICTION.make("rotor_inertia"),))
    assert planar_2r.nominal is not None
    problem = build_problem(model, [exact_log(model, np.append(planar_2r.nominal, [0.01, 0.02]), noise=0.1)], GIVEN)
    with pytest.raises(SolverFailed, match="no friction parameter; add friction parts to the model, or use wls"):
        TwoStep().solve(problem)
    with pytest.raises(BadOption, match=r"^share = "):
        TwoStep(share=0.0)
