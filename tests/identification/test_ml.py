"""Coloured residuals: whitening against the dense covariance, and the estimator against exact generalised LS."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg
import scipy.optimize
import scipy.signal

from dynident.arrays import Array
from dynident.errors import BadOption, SolverFailed
from dynident.identification.estimators.ml import ML
from dynident.identification.estimators.wls import WLS
from dynident.identification.residuals.colour import best_order, colour_of, unbroken_runs, with_white_part
from noisy_arms import Bench


def autoregression(coefficients: list[float], samples: int, seed: int) -> Array:
    """Return a stationary process, its beginning cut off."""
    noise = np.random.default_rng(seed).normal(size=samples + 500)
    values = np.zeros(samples + 500)
    for t in range(len(coefficients), len(values)):
        values[t] = noise[t] + sum(a * values[t - k] for k, a in enumerate(coefficients, start=1))
    return values[500:]


def test_each_reflection_minimises_the_errors_forwards_and_backwards() -> None:
    """Burg's definition, by a search over the last coefficient of each order; runs are taken together."""
    runs = [autoregression([1.2, -0.5, 0.1], length, length) for length in (200, 90, 4)]
    colour = colour_of(runs, 5, 1e-9)
    for order in range(1, 6):
        last = colour.predictors[order - 1]

        def error(reflection: float, order: int = order, last: Array = last) -> float:
            full = np.append(last - reflection * last[::-1], reflection)
            total = 0.0
            for run in runs:
                for series in (run, run[::-1]):
                    lagged = [series[order - k : len(series) - k] for k in range(1, order + 1)]
                    total += float(np.sum((series[order:] - full @ np.array(lagged)) ** 2)) if len(run) > order else 0.0
            return total

        found = scipy.optimize.minimize_scalar(error, bounds=(-1, 1), method="bounded", options={"xatol": 1e-10})
        np.testing.assert_allclose(colour.predictors[order][-1], found.x, atol=1e-6)  # type: ignore[attr-defined]
        ratio = colour.variances[order] / colour.variances[order - 1]
        np.testing.assert_allclose(ratio, 1 - colour.predictors[order][-1] ** 2)
    np.testing.assert_allclose(colour.variances[0], sum(run @ run for run in runs) / 294)


@pytest.mark.parametrize("length", [1, 2, 3, 40])
def test_whitening_is_that_of_the_stationary_covariance(length: int) -> None:
    """|white|^2 = e' C^-1 e with the Toeplitz matrix of the process: the exact likelihood, beginning included."""
    colour = colour_of([autoregression([0.8, -0.3], 300, 1)], 2, 1e-9)
    covariance = [colour.variances[0]]
    covariance.append(colour.predictors[1][0] * covariance[0])
    for _ in range(2, length):
        covariance.append(float(colour.predictors[2] @ [covariance[-1], covariance[-2]]))
    matrix = scipy.linalg.toeplitz(covariance[:length])
    rows = np.random.default_rng(0).normal(size=(3, length))
    white = colour.whitened(rows)
    np.testing.assert_allclose(white @ white.T, rows @ np.linalg.solve(matrix, rows.T), rtol=1e-7, atol=1e-9)


def test_a_white_part_is_added_to_the_process() -> None:
    """AR(1) of pole a plus white noise: the new predictors solve the Yule-Walker equations of the sum."""
    colour = colour_of([autoregression([0.9], 500, 2)], 1, 1e-9)
    pole, power = colour.predictors[1][0], colour.variances[0]
    lags = power * pole ** np.arange(9)
    lags[0] *= 1.3
    found = with_white_part(colour, 0.3, 8)
    assert found.order == 8
    for order in range(1, 9):
        np.testing.assert_allclose(
            found.predictors[order], scipy.linalg.solve_toeplitz(lags[:order], lags[1 : order + 1])
        )
        np.testing.assert_allclose(found.variances[order], lags[0] - found.predictors[order] @ lags[1 : order + 1])
    assert with_white_part(colour, 0.0, 8) is colour


def test_what_a_filter_has_removed_is_not_brought_back(bench: Bench) -> None:
    """Gain of the whitening at the highest frequency, where filtered noise has nothing, over the residual's size."""
    slow = scipy.signal.sosfiltfilt(
        scipy.signal.butter(4, 0.1, output="sos"), np.random.default_rng(0).normal(size=3000)
    )
    alternating = np.tile([1.0, -1.0], 200)[None]
    gains = []
    for share in (0.0, 0.1):
        colour = with_white_part(colour_of([slow], 20, 1e-12), share, 20)
        gains.append(np.abs(colour.whitened(alternating)[0, 100:]).max() * np.std(slow))
    assert gains[0] > 100 and gains[1] < 1.05 / np.sqrt(0.1)


def test_the_order_is_found() -> None:
    for seed in range(5):
        series = autoregression([1.3, -0.7], 2000, seed)
        assert best_order(colour_of([series], 20, 1e-9), len(series)) == 2
    white = np.random.default_rng(0).normal(size=2000)
    assert best_order(colour_of([white], 20, 1e-9), 2000) == 0


def test_runs_end_where_rows_are_missing_or_do_not_count() -> None:
    keep = np.array([0, 2, 4, 6, 12, 14, 16, 18])
    counting = np.array([True, True, True, False, True, True, False, True])
    assert unbroken_runs(keep, 2, counting) == [slice(0, 3), slice(4, 6), slice(7, 8)]


def test_a_perfect_predictor_ends_the_recursion() -> None:
    sine = np.sin(np.arange(5000) * 0.3)
    colour = colour_of([sine, np.zeros(3)], 20, 1e-12)
    assert np.all(np.isfinite(colour.variances)) and np.all(colour.variances > 0)
    nothing = colour_of([np.zeros(50)], 5, 1e-3)
    assert nothing.order == 0 and nothing.variances.tolist() == pytest.approx([1e-6])


def test_ml_is_generalised_least_squares_with_its_colour(bench: Bench) -> None:
    problem = bench.problem(bench.coloured(0, 0.8), cuts=(150,))
    solution = ML(floor=0.0, order=1, tolerance=1e-9).solve(problem)
    rows, count = problem.rows, problem.base.count
    free = 1 - count / len(rows.torque)
    gram, right = np.zeros((count, count)), np.zeros(count)
    for joint in range(3):
        mine = rows.joint == joint
        matrix, torque = rows.matrix[mine], rows.torque[mine]
        error = (torque - matrix @ solution.beta) / np.sqrt(free)
        parts = [slice(0, 150), slice(150, 400)]
        pairs = [(error[p][1:], error[p][:-1]) for p in parts]
        pole = 2 * sum(a @ b for a, b in pairs) / sum(a @ a + b @ b for a, b in pairs)
        for part in parts:
            covariance = scipy.linalg.toeplitz(np.mean(error**2) * pole ** np.arange(part.stop - part.start))
            gram += matrix[part].T @ np.linalg.solve(covariance, matrix[part])
            right += matrix[part].T @ np.linalg.solve(covariance, torque[part])
    expected = np.linalg.solve(gram, right)
    np.testing.assert_allclose(solution.beta, expected, rtol=1e-6, atol=1e-7 * np.abs(expected).max())
    assert solution.covariance is not None
    fisher = np.sqrt(np.diag(np.linalg.inv(gram)))
    ratio = np.sqrt(np.diag(solution.covariance)) / fisher
    assert np.all(ratio > 0.7) and np.all(ratio < 1.6) and 0.85 < np.median(ratio) < 1.2


def test_order_zero_is_weighted_least_squares(bench: Bench) -> None:
    problem = bench.problem(bench.white(0))
    found, expected = ML(order=0, tolerance=1e-9).solve(problem), WLS(iterations=50, tolerance=1e-12).solve(problem)
    np.testing.assert_allclose(found.beta, expected.beta, rtol=1e-6, atol=1e-8 * np.abs(expected.beta).max())
    np.testing.assert_allclose(found.weights, expected.weights, rtol=1e-6)


@pytest.mark.parametrize("floor", [0.0, 0.1])
def test_coloured_noise_is_used(floor: float, bench: Bench) -> None:
    errors, scores, orders = [], [], []
    for seed in range(10):
        problem = bench.problem(bench.coloured(seed, 0.95, share=0.05))
        solution = ML(floor=floor).solve(problem)
        norms = problem.reduced(1 / bench.size).column_norms
        errors.append([np.linalg.norm((s.beta - bench.truth) * norms) for s in (WLS().solve(problem), solution)])
        assert solution.covariance is not None
        scores.append((solution.beta - bench.truth) / np.sqrt(np.diag(solution.covariance)))
        orders.append(solution.run.orders)
    plain, whitened = np.mean(errors, axis=0)
    assert whitened < 0.85 * plain
    assert 0.8 < np.sqrt(np.mean(np.square(scores))) < 1.4
    assert np.median(orders) == 1


def test_refusals(bench: Bench) -> None:
    for option, value in {"floor": -1.0, "order": -1, "longest": -1, "iterations": 0, "tolerance": 2.0}.items():
        with pytest.raises(BadOption, match=f"^{option} = "):
            ML(**{option: value})  # type: ignore[arg-type]
    with pytest.raises(SolverFailed, match="did not settle in 1 rounds; allow more iterations"):
        ML(iterations=1, tolerance=1e-12).solve(bench.problem(bench.coloured(0, 0.9)))
