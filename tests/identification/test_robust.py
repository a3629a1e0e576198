"""Huber, Tukey, L1 and IRLS: against other solvers, and against gross errors."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import scipy.optimize
import scipy.stats
from hypothesis import given
from hypothesis import strategies as st

from dynident.arrays import Array
from dynident.data.log import Log
from dynident.errors import BadOption, SolverFailed
from dynident.identification.estimators import ESTIMATORS
from dynident.identification.estimators.huber import Huber
from dynident.identification.estimators.irls import IRLS
from dynident.identification.estimators.l1 import L1
from dynident.identification.estimators.tukey import Tukey
from dynident.identification.estimators.wls import WLS
from dynident.identification.problem.problem import Problem
from dynident.identification.residuals.robust import (
    Loss,
    biweight_loss,
    huber_loss,
    robust_fit,
    robust_scales,
    robust_uncertainty,
)
from dynident.identification.residuals.row_passes import RowPasses
from dynident.model.reduction import least_squares
from dynident.model.robot import Robot
from noisy_arms import Bench


@pytest.fixture(scope="module")
def dirty(bench: Bench) -> Problem:
    return bench.problem(bench.gross(3))


def standard_rows(problem: Problem, scale: Array) -> tuple[Array, Array]:
    rows = problem.rows
    return rows.matrix / scale[rows.joint, None], rows.torque / scale[rows.joint]


def scipy_fit(problem: Problem, scale: Array, loss: str | Callable[[Array], Array], start: Array) -> Array:
    """Return scipy's M-estimate in units of the column norms, so that its steps are well scaled."""
    matrix, target = standard_rows(problem, scale)
    norms = np.linalg.norm(matrix, axis=0)
    found = scipy.optimize.least_squares(
        lambda x: matrix / norms @ x - target,
        start * norms,
        jac=lambda x: matrix / norms,  # type: ignore[arg-type]
        loss=loss,  # type: ignore[arg-type]
        f_scale=1.0,
        xtol=1e-14,
        ftol=1e-14,
        gtol=1e-12,
    )
    return found.x / norms


@pytest.mark.parametrize("loss", [huber_loss(1.345), biweight_loss(4.685)], ids=["huber", "tukey"])
@given(st.floats(-20, 20))
def test_slope_and_weight_belong_to_psi(loss: Loss, u: float) -> None:
    array, step = np.array([u]), 1e-6
    ahead, behind = loss.psi(array + step), loss.psi(array - step)
    if abs(abs(u) - 1.345) > 1e-5:  # Huber's psi has a corner there
        np.testing.assert_allclose((ahead - behind) / (2 * step), loss.slope(array), atol=1e-5)
    np.testing.assert_allclose(loss.weight(array) * u, loss.psi(array), atol=1e-12)


def test_psi_costs_five_per_cent_of_efficiency() -> None:
    """Asymptotic variance on normal data, E psi^2 / (E psi')^2, is 1 / 0.95."""
    u = np.linspace(-12, 12, 200_001)
    weight = np.exp(-(u**2) / 2) / np.sum(np.exp(-(u**2) / 2))
    for loss in (huber_loss(1.345), biweight_loss(4.685)):
        variance = (weight @ loss.psi(u) ** 2) / (weight @ loss.slope(u)) ** 2
        assert abs(1 / variance - 0.95) < 0.001


def test_huber_is_the_minimum_that_scipy_finds(dirty: Problem) -> None:
    solution = Huber(tolerance=1e-10).solve(dirty)
    scale = np.array(solution.run.scale) * 1.345
    expected = scipy_fit(dirty, scale, "huber", WLS().solve(dirty).beta)
    np.testing.assert_allclose(solution.beta, expected, rtol=1e-6, atol=1e-7 * np.abs(expected).max())
    # The scales are those of the residuals at the solution.
    passes = RowPasses(dirty)
    np.testing.assert_allclose(robust_scales(dirty, passes.residuals(solution.beta), passes.counting), scale / 1.345)


def test_tukey_is_the_minimum_that_scipy_finds(dirty: Problem) -> None:
    solution = Tukey(tolerance=1e-10).solve(dirty)
    scale = np.array(solution.run.scale) * 4.685

    def rho(square: Array) -> Array:
        inside = np.maximum(1 - square, 0.0)
        return np.stack([(1 - inside**3) / 3, inside**2, -2 * inside])

    expected = scipy_fit(dirty, scale, rho, Huber().solve(dirty).beta)
    np.testing.assert_allclose(solution.beta, expected, rtol=1e-6, atol=1e-7 * np.abs(expected).max())


def test_huber_with_a_wide_bound_is_weighted_least_squares(bench: Bench) -> None:
    problem = bench.problem(bench.white(0))
    solution = Huber(bound=1e6, tolerance=1e-9).solve(problem)
    expected = least_squares(problem.reduced(solution.weights)).beta
    np.testing.assert_allclose(solution.beta, expected, rtol=1e-7, atol=1e-8 * np.abs(expected).max())


def test_l1_is_the_optimum_of_the_linear_program(planar_2r: Robot, exact_log: Callable[..., Log]) -> None:
    bench = Bench(planar_2r, exact_log, samples=80)
    problem = bench.problem(bench.gross(0))
    solution = L1(iterations=30, tolerance=1e-12).solve(problem)
    matrix, target = standard_rows(problem, np.array(solution.run.scale))
    rows, count = matrix.shape
    found = scipy.optimize.linprog(
        np.r_[np.zeros(count), np.ones(2 * rows)],
        A_eq=np.hstack([matrix, np.eye(rows), -np.eye(rows)]),
        b_eq=target,
        bounds=[(None, None)] * count + [(0, None)] * (2 * rows),
    )
    assert found.fun is not None
    np.testing.assert_allclose(np.abs(target - matrix @ solution.beta).sum(), found.fun, rtol=1e-6)
    np.testing.assert_allclose(solution.beta, found.x[:count], atol=1e-4 * np.abs(solution.beta).max())
    assert solution.run.gap <= 1e-6


ROBUST = {"huber": 0.06, "tukey": 0.05, "irls": 0.05, "l1": 0.06}


@pytest.mark.parametrize("name", ROBUST)
def test_gross_errors_in_one_row_of_twenty_hardly_move_it(name: str, bench: Bench) -> None:
    """5 % of the rows are off by once to three times the torque's spread, all to one side: wls fails, these do not."""
    errors = []
    for seed in range(4):
        problem = bench.problem(bench.gross(seed))
        norms = problem.reduced(1 / bench.size).column_norms
        parts = (WLS(), ESTIMATORS.make(name))
        errors.append([np.linalg.norm((part.solve(problem).beta - bench.truth) * norms) for part in parts])
    plain, robust = np.mean(errors, axis=0)
    assert robust < ROBUST[name] * plain


@pytest.mark.parametrize("name", ["tukey", "irls"])
def test_the_rows_with_gross_errors_are_the_ones_left_out(name: str, bench: Bench) -> None:
    hit = np.abs(bench.gross(3) - bench.white(3)) > 0
    rejected = ESTIMATORS.make(name).solve(bench.problem(bench.gross(3))).run.rejected
    np.testing.assert_allclose(rejected, hit.sum(axis=0), atol=2)


@pytest.mark.parametrize("name", ["huber", "tukey", "l1", "irls", "student"])
@pytest.mark.parametrize("kind", ["white", "gross"])
def test_errors_are_as_large_as_stated(name: str, kind: str, bench: Bench) -> None:
    part = IRLS(weights="student") if name == "student" else ESTIMATORS.make(name)
    scores = []
    for seed in range(10):
        solution = part.solve(bench.problem(getattr(bench, kind)(seed)))
        assert solution.covariance is not None
        scores.append((solution.beta - bench.truth) / np.sqrt(np.diag(solution.covariance)))
    assert 0.8 < np.sqrt(np.mean(np.square(scores))) < 1.25


@pytest.mark.parametrize("kept", [1 << 28, 0])
def test_rows_kept_or_made_anew_are_the_same(kept: int, dirty: Problem) -> None:
    start = least_squares(dirty.reduced()).beta
    fit = robust_fit(RowPasses(dirty, kept), huber_loss(1.345), start, None, 100, 1e-6)
    np.testing.assert_array_equal(fit.beta, Huber(tolerance=1e-6).solve(dirty).beta)


def test_too_few_steps_are_an_error(dirty: Problem) -> None:
    with pytest.raises(SolverFailed, match=r"the last of 1 steps was still .* standard deviations long; allow more"):
        Huber(iterations=1).solve(dirty)
    with pytest.raises(SolverFailed, match="after 1 fits it still changes by"):
        IRLS(iterations=1).solve(dirty)


def test_a_fit_that_runs_away_is_an_error(dirty: Problem) -> None:
    away = Loss(lambda u: np.full_like(u, 1e300), np.ones_like, np.ones_like)
    with np.errstate(over="ignore", invalid="ignore"), pytest.raises(SolverFailed, match=r"the last of \d+ steps"):
        robust_fit(RowPasses(dirty), away, least_squares(dirty.reduced()).beta, None, 200, 1e-2)


@pytest.mark.parametrize(
    ("part", "option"),
    [
        (lambda: Huber(bound=0.0), "bound"),
        (lambda: Tukey(bound=1.0), "bound"),
        (lambda: Huber(tolerance=0.0), "tolerance"),
        (lambda: IRLS(threshold=1.0), "threshold"),
        (lambda: IRLS(freedom=0.5), "freedom"),
        (lambda: L1(iterations=0), "iterations"),
    ],
)
def test_options_that_cannot_be_are_refused(part: Callable[[], object], option: str) -> None:
    with pytest.raises(BadOption, match=f"^{option} = "):
        part()


def test_more_rows_far_out_than_near_have_no_errors(bench: Bench) -> None:
    """Far out the biweight falls: where most rows lie there, the criterion has no minimum to tell errors by."""
    problem = bench.problem(bench.white(0))
    passes, start = RowPasses(problem), least_squares(problem.reduced()).beta
    fit = robust_fit(passes, biweight_loss(4.685), start, None, 50, 1e-3)
    assert np.all(robust_uncertainty(passes, biweight_loss(4.685), fit).deviations > 0)
    standard = np.array(fit.standard)
    standard[:, 1] = np.where(np.arange(len(standard)) % 3, 3.5, 0.1)
    with pytest.raises(SolverFailed, match="more rows of joint2 lie far out than near; check the torque of that joint"):
        robust_uncertainty(passes, biweight_loss(4.685), replace(fit, standard=standard))


def test_scales_are_medians(bench: Bench) -> None:
    problem = bench.problem(np.zeros_like(bench.white(0)))
    passes = RowPasses(problem)
    residual = np.random.default_rng(0).standard_t(2, passes.counting.shape)
    counting = passes.counting & (np.arange(len(residual)) % 2 == 0)[:, None]
    free = 1 - problem.base.count / counting.sum()
    expected = 1.482602218505602 * np.median(np.abs(residual[::2]), axis=0) / np.sqrt(free)
    np.testing.assert_allclose(robust_scales(problem, residual, counting), expected)
    exact = robust_scales(replace(problem), np.zeros_like(residual), counting)
    assert np.all(exact > 0) and np.all(exact < 1e-8 * bench.size * 10)
