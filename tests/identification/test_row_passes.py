"""Passes over the rows against the rows in full."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from dynident.data.log import Log
from dynident.data.preprocessing import Preprocessing, preprocess
from dynident.data.preprocessing.butterworth import Butterworth
from dynident.identification.problem.problem import Problem, make_problem
from dynident.identification.residuals.row_passes import RowPasses
from dynident.model.reduction import reduce
from dynident.model.robot import Robot
from noisy_arms import Bench


@pytest.fixture(scope="module", params=["given", "filtered"])
def problem(request: pytest.FixtureRequest, spatial_3r: Robot, exact_log: Callable[..., Log]) -> Problem:
    """Return a problem of two logs, once with samples at rest left out and only every other row kept."""
    bench = Bench(spatial_3r, exact_log, samples=1300)
    if request.param == "given":
        return bench.problem(bench.white(0), cuts=(500,))
    how = Preprocessing(Butterworth(cutoff_hz=5.0), rate_hz=25.0, trim_s=0.2, standstill=0.3)
    parts = [replace(bench.log, dq=None, ddq=None).rows(part, "part") for part in (slice(0, 600), slice(600, 1300))]
    found = make_problem(bench.model, bench.base, [preprocess(part, how) for part in parts])
    assert not all(mask.all() for mask in found.masks)
    return found


@pytest.fixture(params=[1 << 28, 0], ids=["kept", "anew"])
def passes(request: pytest.FixtureRequest, problem: Problem) -> RowPasses:
    return RowPasses(problem, request.param)


def test_residuals_and_products_are_those_of_all_rows(problem: Problem, passes: RowPasses) -> None:
    rows = problem.rows
    generator = np.random.default_rng(0)
    beta, values = generator.normal(size=problem.base.count), generator.normal(size=passes.counting.shape)
    for _ in range(2):  # the second pass uses what the first one kept
        residual = passes.residuals(beta)
        np.testing.assert_allclose(residual[rows.samples, rows.joint], rows.torque - rows.matrix @ beta, atol=1e-9)
        assert np.all(residual[~passes.counting] == 0)
        expected = rows.matrix.T @ values[rows.samples, rows.joint]
        np.testing.assert_allclose(passes.products(values), expected, atol=1e-9 * np.abs(expected).max())


def test_weighted_triangles_are_those_of_weighted_rows(problem: Problem, passes: RowPasses) -> None:
    rows = problem.rows
    weights = np.random.default_rng(1).integers(0, 3, passes.counting.shape).astype(float)
    mine = weights[rows.samples, rows.joint]
    triangles = passes.triangles(weights)
    reduced = reduce(triangles, problem.base.count, np.ones(len(triangles)))
    matrix, target = rows.matrix * mine[:, None], rows.torque * mine
    np.testing.assert_allclose(reduced.r.T @ reduced.r, matrix.T @ matrix, atol=1e-8 * float(np.sum(matrix**2)))
    np.testing.assert_allclose(reduced.r.T @ reduced.z, matrix.T @ target, atol=1e-8 * float(np.sum(matrix**2)))
    assert reduced.rows == np.count_nonzero(mine)


def test_each_log_comes_whole(problem: Problem, passes: RowPasses) -> None:
    lengths = [len(log.keep) for log in problem.logs]
    found = list(passes.logs())
    assert [segment.samples for segment in found] == [slice(0, lengths[0]), slice(lengths[0], sum(lengths))]
    for segment in found:
        assert {block.shape[1] for block in segment.blocks} == {segment.samples.stop - segment.samples.start}
    parts = passes.by_log(np.arange(sum(lengths)))
    assert [len(part) for part in parts] == lengths and parts[1][0] == lengths[0]
