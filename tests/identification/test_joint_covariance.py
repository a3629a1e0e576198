"""The joints' covariance and generalised least squares with it, against dense matrices."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.signal

from dynident.arrays import Array, BoolArray
from dynident.data.log import Log
from dynident.identification.estimators.irls import IRLS
from dynident.identification.estimators.wls import WLS
from dynident.identification.problem.problem import Problem
from dynident.identification.residuals.joint_covariance import JointWhitening, joint_covariance, whitener
from dynident.identification.residuals.row_passes import RowPasses
from dynident.model.reduction import least_squares, reduce
from dynident.model.robot import Robot
from noisy_arms import Bench

TINY = np.full(3, 1e-9)


def correlated(bench: Bench, seed: int) -> tuple[Array, Array]:
    """Return noise that the joints share, shape (N, n), and its covariance."""
    mixing = 0.02 * bench.size[:, None] * np.array([[1.0, 0, 0], [0.9, 0.4, 0], [-0.8, 0.3, 0.5]])
    noise = np.random.default_rng(seed).normal(size=(bench.log.samples, 3)) @ mixing.T
    return noise, mixing @ mixing.T


def dense(problem: Problem, covariance: Array, keep: BoolArray) -> tuple[Array, Array]:
    """Return generalised least squares and its covariance, sample by sample, with the rows in ``keep`` only."""
    rows = problem.rows
    gram, right = np.zeros((problem.base.count,) * 2), np.zeros(problem.base.count)
    for sample in range(problem.samples):
        mine = (rows.samples == sample) & keep[rows.samples, rows.joint]
        joints = rows.joint[mine]
        if not len(joints):
            continue
        precision = np.linalg.inv(covariance[np.ix_(joints, joints)])
        gram += rows.matrix[mine].T @ precision @ rows.matrix[mine]
        right += rows.matrix[mine].T @ precision @ rows.torque[mine]
    return np.linalg.solve(gram, right), np.linalg.inv(gram)


def test_a_whitener_whitens() -> None:
    root = np.random.default_rng(0).normal(size=(4, 4))
    covariance = root @ root.T * np.outer([1, 10, 1e3, 1e-2], [1, 10, 1e3, 1e-2])
    upper = whitener(covariance)
    assert np.array_equal(upper, np.triu(upper))
    np.testing.assert_allclose(upper @ covariance @ upper.T, np.eye(4), atol=1e-9)


def test_covariance_of_whole_samples_is_the_mean_square() -> None:
    residual = np.random.default_rng(0).normal(size=(200, 3)) @ np.array([[1, 0.5, 0], [0, 1, 0.2], [0, 0, 1]])
    found = joint_covariance(residual, np.ones(residual.shape, bool), np.ones(200), TINY)
    np.testing.assert_allclose(found, residual.T @ residual / 200)


def test_pairs_that_contradict_each_other_still_give_a_covariance() -> None:
    """Three joints of which any two are alike in other samples, in signs that cannot all be."""
    shared = np.random.default_rng(0).normal(size=(90, 1))
    residual = np.repeat(shared, 3, axis=1)
    residual[:30, 1] *= -1
    residual[30:60, 2] *= -1
    residual[60:, 0] *= -1
    counting = np.ones((90, 3), bool)
    counting[:30, 2] = counting[30:60, 0] = counting[60:, 1] = False
    found = joint_covariance(residual, counting, np.ones(90), TINY)
    assert np.linalg.eigvalsh(found).min() > 0
    np.testing.assert_allclose(np.diag(found), np.sum(residual**2 * counting, axis=0) / counting.sum(axis=0))


def test_few_shared_samples_give_no_correlation() -> None:
    residual = np.ones((8, 2))
    found = joint_covariance(residual, np.ones((8, 2), bool), np.ones(8), TINY[:2])
    np.testing.assert_array_equal(found, np.eye(2))


def test_whitened_rows_are_generalised_least_squares(bench: Bench) -> None:
    problem = bench.problem(bench.white(0))
    keep = np.random.default_rng(2).random(bench.white(0).shape) < 0.8
    _, covariance = correlated(bench, 0)
    white = JointWhitening(RowPasses(problem), covariance, keep)
    found = least_squares(reduce(white.triangles(np.ones(problem.samples)), problem.base.count, np.ones(3)))
    beta, inverse = dense(problem, covariance, keep)
    np.testing.assert_allclose(found.beta, beta, rtol=1e-7, atol=1e-8 * np.abs(beta).max())
    np.testing.assert_allclose(found.unscaled_covariance, inverse, rtol=1e-6, atol=1e-9 * np.abs(inverse).max())
    residual = np.random.default_rng(3).normal(size=keep.shape)
    square = np.sum(white.residuals(residual) ** 2, axis=1)
    one = residual[5][keep[5]]
    assert np.isclose(square[5], one @ np.linalg.solve(covariance[np.ix_(keep[5], keep[5])], one))


def test_irls_settles_at_its_own_covariance(bench: Bench) -> None:
    noise, truth = correlated(bench, 1)
    problem = bench.problem(noise)
    solution = IRLS(weights="none", tolerance=1e-8).solve(problem)
    residual = RowPasses(problem).residuals(solution.beta)
    free = 1 - problem.base.count / residual.size
    covariance = residual.T @ residual / len(residual) / free
    beta, _ = dense(problem, covariance, np.ones(residual.shape, bool))
    np.testing.assert_allclose(solution.beta, beta, rtol=1e-6, atol=1e-7 * np.abs(beta).max())
    deviations = np.sqrt(np.diag(truth))
    np.testing.assert_allclose(solution.run.correlation, truth / np.outer(deviations, deviations), atol=0.1)
    np.testing.assert_allclose(1 / solution.weights, deviations, rtol=0.1)


def test_rows_at_the_threshold_do_not_come_and_go_for_ever(spatial_3r: Robot, exact_log: Callable[..., Log]) -> None:
    """Here the fit with a row leaves it out, and the fit without it takes it in again."""
    bench = Bench(spatial_3r, exact_log, samples=800, friction=("coulomb", "viscous", "offset"))
    white = np.random.default_rng(28).normal(size=(1000, 3)) * bench.size
    noise = 0.05 * np.asarray(scipy.signal.lfilter([np.sqrt(0.19)], [1, -0.9], white, axis=0))[200:]
    run = IRLS().solve(bench.problem(noise)).run
    assert 20 < run.iterations < 30 and 0 < sum(run.rejected) < 10


def test_shared_noise_is_used(bench: Bench) -> None:
    """Where joints share their noise, the joint fit is much better than that of each by itself, and knows it."""
    errors, scores = [], []
    for seed in range(10):
        problem = bench.problem(correlated(bench, seed)[0])
        solution = IRLS().solve(problem)
        norms = problem.reduced(1 / bench.size).column_norms
        errors.append([np.linalg.norm((s.beta - bench.truth) * norms) for s in (WLS().solve(problem), solution)])
        assert solution.covariance is not None
        scores.append((solution.beta - bench.truth) / np.sqrt(np.diag(solution.covariance)))
    plain, joint = np.mean(errors, axis=0)
    assert joint < 0.7 * plain
    assert 0.8 < np.sqrt(np.mean(np.square(scores))) < 1.25
