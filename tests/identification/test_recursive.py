"""Recursive least squares against the whole, and forgetting against weights written out."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dynident.data.preprocessing import Preprocessing
from dynident.data.preprocessing.as_given import AsGiven
from dynident.data.preprocessing.butterworth import Butterworth
from dynident.errors import BadOption
from dynident.identification.build_problem import build_problem
from dynident.identification.estimators.ols import OLS
from dynident.identification.estimators.rls import RLS
from dynident.identification.estimators.wls import WLS
from dynident.identification.fit import fit
from dynident.identification.recursive import RecursiveLeastSquares
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction.coulomb import Coulomb
from dynident.model.friction.viscous import Viscous
from dynident.model.reduction import Reduced, least_squares


@pytest.fixture(scope="module", params=["given", "filtered"])
def problem(request, spatial_3r, exact_log):
    """Return a noisy problem, with samples at rest left out and rows thinned where it is filtered."""
    model = DynamicModel(spatial_3r, (Coulomb(), Viscous()))
    theta = np.append(spatial_3r.nominal, np.tile([1.0, 0.5], 3))
    log = exact_log(model, theta, noise=0.3, samples=700)
    how = Preprocessing(AsGiven(), rest="keep")
    if request.param == "filtered":
        how = Preprocessing(Butterworth(5.0, positions_hz=15.0), rate_hz=25.0, standstill=0.05)
    return build_problem(model, [log, exact_log(model, theta, noise=0.3, seed=1)], how)


def test_without_forgetting_it_is_least_squares(problem):
    plain = RLS(weighted=False).solve(problem)
    whole = OLS().solve(problem).beta
    np.testing.assert_allclose(plain.beta, whole, atol=1e-9 * np.abs(whole).max())
    weighted = RLS().solve(problem)
    expected = least_squares(problem.reduced(WLS().solve(problem).weights)).beta
    np.testing.assert_allclose(weighted.beta, expected, atol=1e-9 * np.abs(expected).max())
    assert weighted.run.course[-1] == weighted.beta.tolist() and weighted.covariance is None
    assert len(weighted.run.times) == len(weighted.run.trace) >= 40


def test_forgetting_weighs_samples_as_written_out(problem):
    rows, forgetting = problem.rows, 0.99
    age = problem.samples - 1 - rows.samples
    root = np.sqrt(forgetting) ** age
    expected = np.linalg.lstsq(rows.matrix * root[:, None], rows.torque * root)[0]
    found = RLS(forgetting, weighted=False).solve(problem)
    np.testing.assert_allclose(found.beta, expected, atol=1e-9 * np.abs(expected).max())
    assert found.covariance is not None and found.degrees is not None
    short, long = (fit(problem, RLS(value)).std for value in (0.99, 0.999))
    assert np.all(short > long)  # a shorter memory knows less
    assert found.run.memory == pytest.approx(100.0)


def test_rows_one_by_one_and_at_once_are_the_same():
    generator = np.random.default_rng(0)
    matrix, torque = generator.normal(size=(60, 4)), generator.normal(size=60)
    one, at_once = RecursiveLeastSquares(4, 0.95), RecursiveLeastSquares(4, 0.95)
    for row, value in zip(matrix, torque, strict=True):
        one.update(row[None], [value])
    at_once.update(matrix, torque, np.arange(60)[::-1])
    np.testing.assert_allclose(one.estimate(), at_once.estimate(), rtol=1e-12)
    np.testing.assert_allclose(one.covariance(), at_once.covariance(), rtol=1e-10)
    weighted = matrix * (0.95 ** np.arange(60)[::-1])[:, None]
    np.testing.assert_allclose(one.covariance(), np.linalg.inv(matrix.T @ weighted), rtol=1e-9)
    assert one.samples == at_once.samples == 60


def test_it_follows_a_parameter_that_moves():
    generator = np.random.default_rng(1)
    state = RecursiveLeastSquares(2, 0.98)
    for k in range(1000):
        row = generator.normal(size=(1, 2))
        truth = np.array([1.0, 2.0 if k < 500 else 3.0])
        state.update(row, row @ truth + 0.01 * generator.normal(size=1))
    np.testing.assert_allclose(state.estimate(), [1.0, 3.0], atol=0.02)


@given(
    seed=st.integers(0, 10_000),
    size=st.integers(1, 6),
    window=st.integers(1, 30),
    rows=st.integers(1, 3),
    spread=st.floats(0.0, 4.0),
)
def test_a_window_is_least_squares_over_its_rows(seed, size, window, rows, spread):
    generator = np.random.default_rng(seed)
    sizes = 10.0 ** generator.uniform(-spread, spread, size)
    samples = 2 * window + 7
    matrix = generator.normal(size=(samples, rows, size)) * sizes
    torque = generator.normal(size=(samples, rows))
    state = RecursiveLeastSquares(size, window=window)
    for one, right in zip(matrix, torque, strict=True):
        state.update(one, right)
    whole = np.column_stack([matrix[-window:].reshape(-1, size), torque[-window:].ravel()])
    kept = state.rows_alone
    found = np.column_stack([kept.r, kept.z])
    scale = np.append(sizes, 1.0)
    gram = found.T @ found + np.diag(np.append(np.zeros(size), kept.rest))
    assert state.held == window
    np.testing.assert_allclose(
        gram / np.outer(scale, scale), whole.T @ whole / np.outer(scale, scale), atol=1e-9 * window
    )


def drift_of_rounding(samples: int) -> float:
    """Return the largest distance of a window's estimate from the batch over its rows, in their deviations."""
    generator = np.random.default_rng(3)
    size, window, block = 8, 500, 10_000
    state, worst = RecursiveLeastSquares(size, window=window), 0.0
    turn = np.linalg.qr(generator.normal(size=(size, size)))[0] * np.logspace(0, -2, size)  # condition number 100
    for _ in range(samples // block):
        matrix = generator.normal(size=(block, size)) @ turn.T
        torque = matrix @ np.arange(size) + generator.normal(size=block)
        for row, value in zip(matrix, torque, strict=True):
            state.update(row[None], value[None])
        whole, right = matrix[-window:], torque[-window:]
        error = state.estimate() - np.linalg.lstsq(whole, right)[0]
        worst = max(worst, float(np.abs(error / np.sqrt(np.diag(np.linalg.inv(whole.T @ whole)))).max()))
    assert state.rebuilt == 0
    return worst


def test_rounding_does_not_add_up():
    assert drift_of_rounding(20_000) < 1e-9


@pytest.mark.battery
def test_rounding_does_not_add_up_over_a_million_samples():
    assert drift_of_rounding(1_000_000) < 1e-9


def test_a_row_that_decides_nearly_all_leaves_and_the_rest_is_built_anew():
    generator = np.random.default_rng(4)
    state = RecursiveLeastSquares(3, window=10)
    matrix, torque = generator.normal(size=(14, 3)), generator.normal(size=14)
    matrix[2] *= 1e9  # it hides sixteen digits of the others
    for row, value in zip(matrix, torque, strict=True):
        state.update(row[None], [value])
    assert state.rebuilt >= 1
    expected = np.linalg.lstsq(matrix[-10:], torque[-10:])[0]
    np.testing.assert_allclose(state.estimate(), expected, rtol=1e-9)


def plain_covariance_form(rows, torque, forgetting, start=1e6):
    """Return the textbook recursion of the covariance P (Ljung 1999, (11.16)): the last estimate and P."""
    beta, p = np.zeros(rows.shape[1]), start * np.eye(rows.shape[1])
    for row, value in zip(rows, torque, strict=True):
        gain = p @ row / (forgetting + row @ p @ row)
        beta, p = beta + gain * (value - row @ beta), (p - np.outer(gain, row @ p)) / forgetting
    return beta, p


def test_the_textbook_recursion_winds_up_and_breaks_where_the_triangle_with_a_prior_stays():
    """One direction is shown for 300 samples and not for 6000 more: P grows by 0.99^-6000, R0 holds the variance."""
    generator = np.random.default_rng(5)
    rows = generator.normal(size=(6300, 3))
    rows[300:, 2] = rows[300:, 1]  # from here on nothing tells the last two apart
    torque = rows @ [1.0, 2.0, 3.0] + 0.1 * generator.normal(size=6300)
    with np.errstate(all="ignore"):
        beta, p = plain_covariance_form(rows, torque, 0.99)
    # No covariance any more: it has grown without bound, and rounding has taken its symmetry. Which eigenvalue rounding
    # turns negative, and how far beta goes, depends on the processor.
    assert np.abs(p).max() > 1e12 and np.abs(p - p.T).max() > 1.0 and np.abs(beta - [1.0, 2.0, 3.0]).max() > 1.0
    deviations = np.array([0.5, 0.5, 0.5]) / 0.1  # in units of the noise, as the rows
    prior = Reduced(np.diag(1 / deviations), np.array([1.0, 2.0, 3.0]) / deviations, 0.0, 0)
    state = RecursiveLeastSquares(3, 0.99, prior=prior)
    for row, value in zip(rows / 0.1, torque / 0.1, strict=True):
        state.update(row[None], [value])
    spread = 0.1 * np.sqrt(np.diag(state.covariance()))
    np.testing.assert_allclose(state.estimate(), [1.0, 2.0, 3.0], atol=0.05)
    assert np.all(spread <= 0.1 * deviations) and spread[2] > 0.6 * np.sqrt(0.5) * 0.1 * deviations[2]


def test_what_no_row_shows_any_more_goes_back_to_what_was_known():
    """The recursion of Kulhavy and Zarrop, L <- lambda L + (1 - lambda) L0 and rows, written out with matrices."""
    generator = np.random.default_rng(6)
    root = np.triu(generator.normal(size=(3, 3))) + 3 * np.eye(3)
    mean, forgetting = np.array([1.0, -1.0, 0.5]), 0.9
    state = RecursiveLeastSquares(3, forgetting, prior=Reduced(root, root @ mean, 0.0, 0))
    information, vector = root.T @ root, root.T @ root @ mean
    for k in range(400):
        row = generator.normal(size=(1, 3)) if k < 100 else np.zeros((1, 3))
        value = generator.normal(size=1)
        information = forgetting * information + (1 - forgetting) * root.T @ root + row.T @ row
        vector = forgetting * vector + (1 - forgetting) * root.T @ root @ mean + row.T @ value
        state.update(row, value)
        if k == 120:
            np.testing.assert_allclose(state.estimate(), np.linalg.solve(information, vector), rtol=1e-9)
            np.testing.assert_allclose(state.covariance(), np.linalg.inv(information), rtol=1e-9)
    np.testing.assert_allclose(state.estimate(), mean, atol=1e-10)
    np.testing.assert_allclose(state.covariance(), np.linalg.inv(root.T @ root), rtol=1e-9)


def test_clearing_leaves_what_is_known_beforehand():
    state = RecursiveLeastSquares(1, window=3, prior=Reduced(np.eye(1), np.array([2.0]), 0.0, 0))
    for _ in range(5):
        state.update([[1.0]], [4.0])
    np.testing.assert_allclose(state.estimate(), [3.5])
    state.clear()
    np.testing.assert_allclose(state.estimate(), [2.0])
    state.update([[1.0]], [4.0])
    np.testing.assert_allclose(state.estimate(), [3.0])


def test_what_it_refuses():
    with pytest.raises(BadOption, match="forgetting = 0 "):
        RecursiveLeastSquares(2, 0)
    with pytest.raises(BadOption, match="forgetting"):
        RLS(1.5)
    with pytest.raises(BadOption, match="size = 0"):
        RecursiveLeastSquares(0)
    with pytest.raises(BadOption, match="window = 0"):
        RecursiveLeastSquares(2, window=0)
    with pytest.raises(BadOption, match="not both"):
        RecursiveLeastSquares(2, 0.9, window=5)
    with pytest.raises(BadOption, match="of 1 parameters"):
        RecursiveLeastSquares(2, prior=Reduced(np.eye(1), np.zeros(1), 0.0, 0))
    with pytest.raises(ValueError, match="rows of shape"):
        RecursiveLeastSquares(2).update(np.zeros((3, 3)), np.zeros(3))
    state = RecursiveLeastSquares(2)
    with pytest.raises(ValueError, match="not a number"):
        state.update([[1.0, np.nan]], [1.0])
    assert state.samples == 0
    np.testing.assert_array_equal(state.estimate(), [0.0, 0.0])
