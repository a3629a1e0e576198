"""Essential parameters: which go, which must stay, and what is said about them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.stats import f as fisher

from dynident.data.log import Log
from dynident.errors import BadOption
from dynident.identification.estimators.essential import Essential, restricted, wald
from dynident.identification.estimators.ols import OLS
from dynident.identification.estimators.wls import WLS
from dynident.identification.fit import fit
from dynident.identification.residuals.row_passes import RowPasses
from dynident.model.robot import Robot
from noisy_arms import Bench


@pytest.fixture(scope="module")
def bench(spatial_3r: Robot, exact_log: Callable[..., Log]) -> Bench:
    return Bench(spatial_3r, exact_log, friction=("viscous", "offset"))


def test_a_restricted_problem_is_the_one_of_fewer_columns(bench: Bench) -> None:
    problem = bench.problem(bench.white(0))
    keep = np.arange(bench.base.count) % 3 != 1
    fewer = restricted(problem, keep)
    assert fewer.base.names == tuple(np.array(bench.base.names)[keep])
    expected = np.linalg.lstsq(problem.rows.matrix[:, keep], problem.rows.torque)[0]
    np.testing.assert_allclose(OLS().solve(fewer).beta, expected, rtol=1e-7, atol=1e-8 * np.abs(expected).max())
    beta = np.random.default_rng(0).normal(size=int(keep.sum()))
    np.testing.assert_allclose(fewer.rows.matrix, problem.rows.matrix[:, keep], atol=1e-12)
    residual = RowPasses(fewer).residuals(beta)
    np.testing.assert_allclose(np.sum(residual**2, axis=0), fewer.residual_squares(beta), rtol=1e-9)


def test_the_wald_statistic_is_the_rise_of_the_error() -> None:
    """For least squares of known variance, W = (SSE of the restricted fit - SSE) / variance."""
    generator = np.random.default_rng(0)
    matrix, target = generator.normal(size=(50, 5)), generator.normal(size=50)
    beta, rest = np.linalg.lstsq(matrix, target)[:2]
    few = np.linalg.lstsq(matrix[:, [0, 2, 4]], target)[1]
    found = wald(beta, np.linalg.inv(matrix.T @ matrix), np.array([1, 3]))
    np.testing.assert_allclose(found, few - rest)


def test_zeros_go_and_what_matters_stays(bench: Bench) -> None:
    """Offsets that are truly zero are dropped in nearly all runs; parameters with small errors never are."""
    theta = np.array(bench.theta)
    names = [p.name for p in bench.model.parameters]
    zero = [k for k, name in enumerate(names) if name.startswith("F0")]
    removed = bench.base.from_standard(np.where(np.isin(np.arange(len(theta)), zero), theta, 0.0))
    rows = bench.problem(np.zeros_like(bench.white(0))).rows
    shift = np.zeros_like(bench.white(0))
    shift[rows.samples, rows.joint] = rows.matrix @ removed
    truth = bench.truth - removed
    gone, scores = [], []
    for seed in range(10):
        problem = bench.problem(bench.white(seed) - shift)
        estimate = fit(problem, Essential())
        dropped = {item.name for item in estimate.run.dropped}
        gone.append(sum(name in dropped for name in ("F0[joint1]", "F0[joint2]", "F0[joint3]")))
        plain = fit(problem, WLS())
        sure = {n for n, r in zip(bench.base.names, plain.relative_std, strict=True) if r < 0.1}
        assert not dropped & sure
        assert np.all(estimate.std > 0)
        assert [estimate.beta[bench.base.names.index(name)] for name in dropped] == [0.0] * len(dropped)
        assert estimate.run.kept + len(dropped) == bench.base.count
        scores.append((estimate.beta - truth) / estimate.std)
    assert np.mean(gone) > 2.5
    assert np.sqrt(np.mean(np.square(scores))) < 1.4


def test_the_error_rises_by_no_more_than_the_test_allows(bench: Bench) -> None:
    problem = bench.problem(bench.white(1, share=0.3))
    solution = Essential(limit=0.2, level=0.05, rise=1.0).solve(problem)
    plain = WLS().solve(problem)
    squares = [float(np.sum(problem.residual_squares(s.beta) * plain.weights**2)) for s in (plain, solution)]
    count, rows = len(solution.run.dropped), int(problem.counts.sum())
    assert count > 0 and solution.run.significance > 0.05
    statistic = (squares[1] - squares[0]) / count / (squares[0] / (rows - bench.base.count))
    assert statistic < fisher.isf(0.05, count, rows - bench.base.count) * 1.5
    stricter = Essential(limit=0.2, level=0.9, rise=1.0).solve(problem)
    assert stricter.run.kept > solution.run.kept


def test_the_residual_rises_by_no_more_than_the_stated_share(bench: Bench) -> None:
    problem = bench.problem(bench.white(1, share=0.3))
    weights = WLS().solve(problem).weights
    norms, kept = [], []
    for rise in (1e-4, 1e-3, 1e-2):
        solution = Essential(limit=0.1, level=1e-9, rise=rise).solve(problem)
        norms.append(np.sqrt(weights**2 @ problem.residual_squares(solution.beta)))
        kept.append(solution.run.kept)
    least = np.sqrt(weights**2 @ problem.residual_squares(WLS().solve(problem).beta))
    assert kept[0] > kept[1] > kept[2]
    assert np.all(np.array(norms) / least - 1 <= [1e-4, 1e-3, 1e-2])


def test_it_asks_any_estimator_of_base_parameters(bench: Bench) -> None:
    problem = bench.problem(bench.gross(0))
    robust, plain = Essential(of="huber").solve(problem), Essential(of="wls").solve(problem)
    norms = problem.reduced(1 / bench.size).column_norms
    errors = [np.linalg.norm((s.beta - bench.truth) * norms) for s in (robust, plain)]
    assert errors[0] < 0.2 * errors[1]


def test_refusals(bench: Bench) -> None:
    for of in ("essential", "wlss"):
        with pytest.raises(BadOption, match=r"^of = "):
            Essential(of=of)
    with pytest.raises(BadOption, match=r"^limit = "):
        Essential(limit=0.0)
    with pytest.raises(BadOption, match="it finds standard parameters of whole bodies; give wls or huber"):
        Essential(of="consistent").solve(bench.problem(bench.white(0)))
