"""Recursive least squares against the whole, and forgetting against weights written out."""

from __future__ import annotations

import numpy as np
import pytest

from dynident.errors import BadOption
from dynident.estimation.estimators.ols import OLS
from dynident.estimation.estimators.rls import RLS
from dynident.estimation.estimators.wls import WLS
from dynident.estimation.identify import estimate_of, pose
from dynident.estimation.recursive import RecursiveLeastSquares
from dynident.experiment.preprocessing import Preprocessing
from dynident.experiment.preprocessing.as_given import AsGiven
from dynident.experiment.preprocessing.butterworth import Butterworth
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction.coulomb import Coulomb
from dynident.model.friction.viscous import Viscous
from dynident.model.reduction import least_squares


@pytest.fixture(scope="module", params=["given", "filtered"])
def problem(request, spatial_3r, exact_log):
    """Return a noisy problem, with rows at rest left out and rows thinned where it is filtered."""
    model = DynamicModel(spatial_3r, (Coulomb(), Viscous()))
    theta = np.append(spatial_3r.nominal, np.tile([1.0, 0.5], 3))
    log = exact_log(model, theta, noise=0.3, samples=700)
    how = Preprocessing(AsGiven(), rest="keep")
    if request.param == "filtered":
        how = Preprocessing(Butterworth(5.0, positions_hz=15.0), rate_hz=25.0, standstill=0.05)
    return pose(model, [log, exact_log(model, theta, noise=0.3, seed=1)], how)


def test_without_forgetting_it_is_least_squares(problem):
    plain = RLS(weighted=False).solve(problem)
    whole = OLS().solve(problem).beta
    np.testing.assert_allclose(plain.beta, whole, atol=1e-9 * np.abs(whole).max())
    weighted = RLS().solve(problem)
    expected = least_squares(problem.reduced(WLS().solve(problem).weights)).beta
    np.testing.assert_allclose(weighted.beta, expected, atol=1e-9 * np.abs(expected).max())
    assert weighted.extras["course"][-1] == weighted.beta.tolist() and weighted.covariance is None
    assert len(weighted.extras["times"]) == len(weighted.extras["trace"]) >= 40


def test_forgetting_weighs_samples_as_written_out(problem):
    rows, forgetting = problem.rows, 0.99
    age = problem.samples - 1 - rows.samples
    root = np.sqrt(forgetting) ** age
    expected = np.linalg.lstsq(rows.matrix * root[:, None], rows.torque * root)[0]
    found = RLS(forgetting, weighted=False).solve(problem)
    np.testing.assert_allclose(found.beta, expected, atol=1e-9 * np.abs(expected).max())
    assert found.covariance is not None and found.degrees is not None
    short, long = (estimate_of(problem, RLS(value)).deviations for value in (0.99, 0.999))
    assert np.all(short > long)  # a shorter memory knows less
    assert found.extras["memory"] == pytest.approx(100.0)


def test_rows_one_by_one_and_at_once_are_the_same():
    generator = np.random.default_rng(0)
    matrix, torque = generator.normal(size=(60, 4)), generator.normal(size=60)
    one = RecursiveLeastSquares(4, 0.95)
    for row, value in zip(matrix, torque, strict=True):
        one = one.update(row[None], [value])
    at_once = RecursiveLeastSquares(4, 0.95).update(matrix, torque, np.arange(60)[::-1])
    np.testing.assert_allclose(one.beta, at_once.beta, rtol=1e-12)
    np.testing.assert_allclose(one.unscaled_covariance, at_once.unscaled_covariance, rtol=1e-10)
    weighted = matrix * (0.95 ** np.arange(60)[::-1])[:, None]
    np.testing.assert_allclose(one.unscaled_covariance, np.linalg.inv(matrix.T @ weighted), rtol=1e-9)
    assert one.samples == at_once.samples == 60


def test_it_follows_a_parameter_that_moves():
    generator = np.random.default_rng(1)
    state = RecursiveLeastSquares(2, 0.98)
    for k in range(1000):
        row = generator.normal(size=(1, 2))
        truth = np.array([1.0, 2.0 if k < 500 else 3.0])
        state = state.update(row, row @ truth + 0.01 * generator.normal(size=1))
    np.testing.assert_allclose(state.beta, [1.0, 3.0], atol=0.02)


def test_what_it_refuses():
    with pytest.raises(BadOption, match="forgetting = 0 "):
        RecursiveLeastSquares(2, 0)
    with pytest.raises(BadOption, match="forgetting"):
        RLS(1.5)
    with pytest.raises(BadOption, match="size = 0"):
        RecursiveLeastSquares(0)
    with pytest.raises(ValueError, match="rows of shape"):
        RecursiveLeastSquares(2).update(np.zeros((3, 3)), np.zeros(3))
    np.testing.assert_array_equal(RecursiveLeastSquares(2).beta, [0.0, 0.0])
