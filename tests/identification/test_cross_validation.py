"""Cross-validation on triangles gives what fits of the remaining rows give."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from dynident.data.log import Log
from dynident.errors import BadOption, SolverFailed
from dynident.identification.estimators import ESTIMATORS
from dynident.identification.estimators.consistent import Consistent
from dynident.identification.estimators.ols import OLS
from dynident.identification.problem.estimator import Solution
from dynident.identification.problem.problem import Problem
from dynident.identification.selection.cross_validation import cross_validate
from dynident.model.robot import Robot
from noisy_arms import Bench

MakeLog = Callable[..., Log]


@pytest.fixture(scope="module")
def bench(planar_2r: Robot, exact_log: MakeLog) -> Bench:
    return Bench(planar_2r, exact_log, samples=600)


def test_folds_are_fits_of_the_rest(bench: Bench) -> None:
    problem = bench.problem(bench.white(0))
    rows = problem.rows
    beta = OLS().solve(problem).beta
    found = cross_validate(problem, OLS(), beta, 4)
    square = 0.0
    for k, fold in enumerate(found.folds):
        out = (rows.samples >= 150 * k) & (rows.samples < 150 * (k + 1))
        direct = np.linalg.lstsq(rows.matrix[~out], rows.torque[~out])[0]
        np.testing.assert_allclose(fold.beta, direct, rtol=1e-6)
        error = rows.torque[out] - rows.matrix[out] @ direct
        assert fold.rows == 300 and fold.missing == ""
        assert fold.relative_error == pytest.approx(np.linalg.norm(error) / np.linalg.norm(rows.torque[out]))
        assert fold.rmse[1] == pytest.approx(np.sqrt(np.mean(error[rows.joint[out] == 1] ** 2)))
        square += float(error @ error)
    assert found.relative_error == pytest.approx(np.sqrt(square) / np.linalg.norm(rows.torque))
    assert found.relative_error > found.in_sample > 0
    assert found.figures()["folds"][0]["name"] == "rows 1 to 150"


def test_logs_are_left_out_one_by_one(bench: Bench) -> None:
    problem = bench.problem(bench.white(0), cuts=(200, 400))
    found = cross_validate(problem, Consistent(), Consistent().solve(problem).beta, 0)
    assert found.over == "logs" and found.estimator == "consistent" and len(found.folds) == 3
    assert [fold.rows for fold in found.folds] == [400, 400, 400]


def test_methods_that_need_rows_are_stood_in_for(bench: Bench) -> None:
    problem = bench.problem(bench.white(0))
    part = ESTIMATORS.make("huber")
    assert cross_validate(problem, part, part.solve(problem).beta, 2).estimator == "wls"


def test_a_rest_that_determines_nothing_is_named(bench: Bench) -> None:
    problem = bench.problem(bench.white(0), cuts=(400,))
    few = np.zeros((200, 2), bool)
    few[:3] = True
    problem = replace(problem, masks=(problem.masks[0], few))
    found = cross_validate(problem, OLS(), OLS().solve(problem).beta, 0)
    assert found.folds[0].missing == "the rest does not determine it" and np.isnan(found.relative_error)
    assert found.figures()["relative_error"] is None


def test_impossible_folds(bench: Bench) -> None:
    problem = bench.problem(bench.white(0))
    for folds, reason in ((1, "give 2 to"), (0, "there is one log"), (-2, "give 2 to"), (100_000, "give 2 to")):
        with pytest.raises(BadOption, match=reason):
            cross_validate(problem, OLS(), bench.truth, folds)


def test_a_fold_that_its_estimator_cannot_solve_says_why(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    problem = bench.problem(bench.white(0))
    beta = OLS().solve(problem).beta

    def stubborn(part: OLS, problem: Problem) -> Solution:
        raise SolverFailed("the stubborn fit", "it will not", "ask another")

    monkeypatch.setattr(OLS, "solve", stubborn)
    found = cross_validate(problem, OLS(), beta, 3)
    assert len(found.folds) == 3 and np.isnan(found.relative_error) and np.isfinite(found.in_sample)
    assert all("it will not; ask another" in fold.missing and np.all(np.isnan(fold.beta)) for fold in found.folds)
