"""Total least squares against the singular value decomposition, and on columns with errors."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from dynident.arrays import Array
from dynident.data.log import Log
from dynident.errors import BadOption, SolverFailed
from dynident.identification.estimators.tls import TLS, constant_columns, smallest_error
from dynident.identification.estimators.wls import WLS
from dynident.model.reduction import Triangle, triangle_of
from dynident.model.robot import Robot
from noisy_arms import Bench


def by_svd(matrix: Array, target: Array, exact: int, ratio: float) -> Array:
    """Return mixed LS-TLS from the right singular vector, the first columns exact (Van Huffel and Vandewalle 1991)."""
    norms = np.linalg.norm(matrix, axis=0)
    size = np.linalg.norm(target)
    scale = np.concatenate([norms[:exact], norms[exact:] * ratio, [size]])
    full = np.column_stack([matrix, target]) / scale
    triangle = triangle_of(np.asfortranarray(full))
    vector = np.linalg.svd(triangle[exact:, exact:])[2][-1]
    noisy = -vector[:-1] / vector[-1]
    known = np.linalg.solve(triangle[:exact, :exact], triangle[:exact, -1] - triangle[:exact, exact:-1] @ noisy)
    return np.concatenate([known, noisy]) / scale[:-1] * size


@pytest.mark.parametrize("ratio", [0.3, 1.0])
def test_tls_is_the_smallest_right_singular_vector(ratio: float, bench: Bench) -> None:
    problem = bench.problem(bench.white(0, share=0.005))
    solution = TLS(ratio).solve(problem)
    rows = problem.rows
    matrix, target = rows.matrix * solution.weights[rows.joint, None], rows.torque * solution.weights[rows.joint]
    expected = by_svd(matrix, target, 0, ratio)
    np.testing.assert_allclose(solution.beta, expected, rtol=1e-6, atol=1e-6 * np.abs(expected).max())
    assert solution.run.exact == []


def test_columns_of_offsets_are_exact(spatial_3r: Robot, exact_log: Callable[..., Log]) -> None:
    bench = Bench(spatial_3r, exact_log, friction=("viscous", "offset"))
    problem = bench.problem(bench.white(0, share=0.005))
    exact = constant_columns(problem)
    assert [bench.base.names[k] for k in np.flatnonzero(exact)] == ["F0[joint1]", "F0[joint2]", "F0[joint3]"]
    solution = TLS().solve(problem)
    order = np.argsort(~exact, kind="stable")
    rows = problem.rows
    matrix, target = rows.matrix * solution.weights[rows.joint, None], rows.torque * solution.weights[rows.joint]
    expected = np.empty(len(order))
    expected[order] = by_svd(matrix[:, order], target, 3, 1.0)
    np.testing.assert_allclose(solution.beta, expected, rtol=1e-6, atol=1e-6 * np.abs(expected).max())


def test_ratio_zero_is_weighted_least_squares(bench: Bench) -> None:
    problem = bench.problem(bench.white(0))
    expected = WLS().solve(problem).beta
    np.testing.assert_allclose(TLS(0.0).solve(problem).beta, expected, rtol=1e-6, atol=1e-7 * np.abs(expected).max())


def test_tls_removes_the_bias_of_noisy_columns_where_its_assumption_holds(
    pendulum: Robot, exact_log: Callable[..., Log]
) -> None:
    """Errors of 15 % of each column's norm, independent of each other: wls is biased towards zero, tls is not."""
    bench = Bench(pendulum, exact_log, samples=4000, friction=("viscous",))
    exact = bench.problem(np.zeros((4000, 1)))
    rows, share = exact.rows, 0.15
    spread = share * np.sqrt(np.mean(rows.matrix**2, axis=0))
    errors = []
    for seed in range(20):
        generator = np.random.default_rng(seed)
        matrix = rows.matrix + spread * generator.normal(size=rows.matrix.shape)
        torque = rows.torque + share * np.sqrt(np.mean(rows.torque**2)) * generator.normal(size=len(rows.torque))
        own = exact.triangles[0]
        factor = triangle_of(np.asfortranarray(np.column_stack([matrix[:, own.columns], torque])))
        noisy = replace(exact, triangles=(Triangle(own.columns, factor, own.rows),))
        solution = TLS().solve(noisy)
        errors.append([s.beta - bench.truth for s in (WLS().solve(noisy), solution)])
    norms = np.linalg.norm(rows.matrix, axis=0) / np.linalg.norm(rows.torque)
    plain, total = np.linalg.norm(np.mean(errors, axis=0) * norms, axis=1)
    assert plain > 0.015
    assert total < 0.25 * plain


def test_a_fit_that_belongs_to_the_columns_is_refused() -> None:
    scaled, target = np.eye(2) * [1.0, 1e-3], np.array([0.5, 0.0])
    with pytest.raises(SolverFailed, match="give a smaller ratio"):
        smallest_error(scaled, target, 0.5, np.array([False, False]), 1.0)
    assert smallest_error(scaled, target, 0.5, np.array([True, True]), 1.0) == 0.5


def test_options_that_cannot_be_are_refused() -> None:
    with pytest.raises(BadOption, match=r"^ratio = -1"):
        TLS(-1.0)
