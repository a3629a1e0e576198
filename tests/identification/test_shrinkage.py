"""Ridge and MAP against closed forms, and cross-validation against leaving rows out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from dynident.data.log import Log
from dynident.errors import BadOption, SolverFailed
from dynident.identification.estimators.map import MAP, prior_sizes
from dynident.identification.estimators.ridge import Ridge, cross_validated
from dynident.identification.estimators.wls import WLS
from dynident.identification.residuals.covariance import residual_factors
from dynident.identification.residuals.row_passes import RowPasses
from dynident.model.robot import Robot
from noisy_arms import Bench


@pytest.fixture(scope="module")
def short(spatial_3r: Robot, exact_log: Callable[..., Log]) -> Bench:
    """Return a bench of so few samples that a prior and a pull matter."""
    return Bench(spatial_3r, exact_log, samples=25)


@pytest.mark.parametrize("strength", [0.0, 1e-4, 0.1])
def test_ridge_is_the_closed_form_with_unit_columns(strength: float, bench: Bench) -> None:
    problem = bench.problem(bench.white(0))
    rows, weights = problem.rows, WLS().solve(problem).weights
    matrix, target = rows.matrix * weights[rows.joint, None], rows.torque * weights[rows.joint]
    pull = strength * np.diag(np.sum(matrix**2, axis=0))
    expected = np.linalg.solve(matrix.T @ matrix + pull, matrix.T @ target)
    solution = Ridge(strength).solve(problem)
    np.testing.assert_allclose(solution.beta, expected, rtol=1e-6, atol=1e-8 * np.abs(expected).max())
    inverse = np.linalg.inv(matrix.T @ matrix + pull)
    np.testing.assert_allclose(solution.run.free_parameters, np.trace(inverse @ matrix.T @ matrix), rtol=1e-6)
    # White noise: the covariance is nearly s^2 (W'W + pull)^-1, with s = 1 in these weights.
    assert solution.covariance is not None
    ratio = np.sqrt(np.diag(solution.covariance) / np.diag(inverse))
    assert np.all(ratio > 0.75) and np.all(ratio < 1.5) and 0.9 < np.median(ratio) < 1.1


def test_generalised_cross_validation_is_its_definition() -> None:
    """V = r |(I - A) y|^2 / trace(I - A)^2 with the hat matrix A (Golub, Heath and Wahba 1979, (1.4))."""
    generator = np.random.default_rng(0)
    u, _ = np.linalg.qr(generator.normal(size=(60, 8)))
    v, _ = np.linalg.qr(generator.normal(size=(8, 8)))
    matrix = u * np.geomspace(1, 1e-3, 8) @ v.T
    target = matrix @ generator.normal(size=8) + 0.02 * generator.normal(size=60)

    def score(power: float) -> float:
        hat = matrix @ np.linalg.solve(matrix.T @ matrix + 10.0**power * np.eye(8), matrix.T)
        away = np.eye(60) - hat
        return float(np.sum((away @ target) ** 2) / np.trace(away) ** 2)

    left, values, _ = np.linalg.svd(matrix, full_matrices=False)
    data = left.T @ target
    found = cross_validated(values, data, float(target @ target - data @ data), 60)
    powers = np.linspace(-14, 0, 2001)
    best = powers[int(np.argmin([score(power) for power in powers]))]
    assert abs(np.log10(found) - best) < 0.02


def test_exact_data_need_no_pull() -> None:
    assert cross_validated(np.array([1.0, 0.1]), np.array([1.0, 1.0]), 0.0, 50) == 0.0


def test_ridge_helps_where_parameters_stand_on_noise(short: Bench) -> None:
    errors = []
    for seed in range(20):
        problem = short.problem(short.white(seed, share=0.3))
        norms = problem.reduced(1 / short.size).column_norms
        errors.append([np.linalg.norm((p.solve(problem).beta - short.truth) * norms) for p in (WLS(), Ridge())])
    plain, pulled = np.mean(errors, axis=0)
    assert pulled < 0.8 * plain


def test_map_on_standard_parameters_is_the_closed_form(short: Bench) -> None:
    """With friction given a very wide prior, the posterior of theta mapped to beta is the estimate."""
    problem = short.problem(short.white(0, share=0.2))
    theta0 = short.model.nominal()
    assert theta0 is not None
    part = MAP(share=0.1)
    solution = part.solve(problem)
    assert solution.covariance is not None
    count = short.model.inertial_count
    deviation = np.concatenate([0.1 * prior_sizes(short.model), np.full(len(theta0) - count, 1e4)])
    rows = problem.rows
    matrix = (rows.matrix @ short.base.matrix) * solution.weights[rows.joint, None]
    scaled = matrix * deviation
    gram = scaled.T @ scaled + np.eye(len(theta0))
    target = (rows.torque * solution.weights[rows.joint]) - matrix @ theta0
    theta = theta0 + deviation * np.linalg.solve(gram, scaled.T @ target)
    np.testing.assert_allclose(solution.beta, short.base.from_standard(theta), rtol=1e-5, atol=1e-5)
    mapped = short.base.matrix * deviation
    posterior = np.sqrt(np.diag(mapped @ np.linalg.solve(gram, mapped.T)))
    ratio = np.sqrt(np.diag(solution.covariance)) / posterior
    # The posterior's but for the colour of the noise, which 25 samples tell roughly.
    assert np.all((ratio > 0.5) & (ratio < 2.0)) and 0.8 < np.median(ratio) < 1.25


def test_a_wide_prior_is_weighted_least_squares_and_a_narrow_one_the_description(bench: Bench) -> None:
    problem = bench.problem(bench.white(0))
    wide, plain = MAP(share=1e5).solve(problem), WLS(iterations=30, tolerance=1e-10).solve(problem)
    factors = residual_factors(RowPasses(problem), plain.beta)
    np.testing.assert_allclose(wide.weights, plain.weights / np.sqrt(factors), rtol=2e-3)
    assert wide.covariance is not None
    assert np.all(np.abs(wide.beta - plain.beta) < 0.5 * np.sqrt(np.diag(wide.covariance)))
    for on in ("standard", "base"):
        narrow = MAP(share=1e-7, on=on).solve(problem)
        inertial = bench.base.independent < bench.model.inertial_count
        np.testing.assert_allclose(narrow.beta[inertial], bench.truth[inertial], atol=1e-5)
        assert narrow.run.learned < 0.01 < 0.99 < wide.run.learned


def test_a_good_prior_helps_and_its_deviations_are_right(short: Bench) -> None:
    """Truths drawn from the prior: the posterior's deviations cover them, and its error is smaller."""
    generator = np.random.default_rng(0)
    size = prior_sizes(short.model)
    errors, scores = [], []
    for seed in range(25):
        moved = np.array(short.theta)
        moved[: len(size)] += 0.05 * size * generator.normal(size=len(size))
        truth = short.base.from_standard(moved)
        extra = np.einsum("snb,b->sn", _regressor(short), truth - short.truth)
        problem = short.problem(short.white(seed, share=0.2) + extra)
        norms = problem.reduced(1 / short.size).column_norms
        solution = MAP(share=0.05).solve(problem)
        assert solution.covariance is not None
        errors.append([np.linalg.norm((s.beta - truth) * norms) for s in (WLS().solve(problem), solution)])
        scores.append((solution.beta - truth) / np.sqrt(np.diag(solution.covariance)))
    plain, informed = np.mean(errors, axis=0)
    assert informed < 0.8 * plain
    assert 0.7 < np.sqrt(np.mean(np.square(scores))) < 1.25


def _regressor(bench: Bench) -> np.ndarray:
    from dynident.identification.problem.regressor_stream import motion_of

    return bench.model.regressor(motion_of(bench.log))[..., bench.base.independent]


def test_a_description_without_inertias_is_no_prior(planar_2r: Robot, exact_log: Callable[..., Log]) -> None:
    bench = Bench(planar_2r, exact_log)
    problem = bench.problem(bench.white(0))
    links = (planar_2r.links[0], replace(planar_2r.links[1], inertia=None))
    bare = replace(problem, model=replace(bench.model, robot=replace(planar_2r, links=links)))
    with pytest.raises(SolverFailed, match="the robot model states no inertia of link2; complete the robot"):
        MAP().solve(bare)


def test_options_that_cannot_be_are_refused() -> None:
    with pytest.raises(BadOption, match=r"^strength = "):
        Ridge(-1.0)
    with pytest.raises(BadOption, match=r"^share = "):
        MAP(share=0.0)
    with pytest.raises(BadOption, match=r"^on = "):
        MAP(on="links")  # type: ignore[arg-type]
