"""Smoothing spline and Kalman smoother: exact derivatives of known motions, dense linear algebra, stated deviations."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.interpolate

from dynident.data.log import Log
from dynident.data.preprocessing import FILTERS
from dynident.data.preprocessing.butterworth import Butterworth
from dynident.data.preprocessing.kalman_smoother import FACTORIALS, KalmanSmoother, likelihood, smoothed
from dynident.data.preprocessing.smoothing_spline import SmoothingSpline, penalty_of
from dynident.errors import BadOption

RATE, NOISE = 200.0, 2e-4
TIME = np.arange(2000) / RATE
W = 2 * np.pi * np.array([0.2, 0.5, 0.9])
HEIGHT = np.array([0.5, 0.2, 0.1])
EXACT = (
    np.sin(np.outer(TIME, W)) @ HEIGHT,
    np.cos(np.outer(TIME, W)) @ (W * HEIGHT),
    -np.sin(np.outer(TIME, W)) @ (W**2 * HEIGHT),
)
INSIDE = slice(200, -200)


def noisy(seed: int = 0, deviation: float = NOISE) -> Log:
    q = EXACT[0] + deviation * np.random.default_rng(seed).normal(size=len(TIME))
    return Log(("a",), TIME, q[:, None], torque=np.random.default_rng(seed + 99).normal(size=(len(TIME), 1)))


def errors(found: Log) -> list[float]:
    signals = (found.q, np.asarray(found.dq), np.asarray(found.ddq))
    return [float(np.std((signal[:, 0] - exact)[INSIDE])) for signal, exact in zip(signals, EXACT, strict=True)]


@pytest.mark.parametrize("name", ["kalman_smoother", "smoothing_spline"])
@pytest.mark.parametrize("stated", [None, NOISE])
def test_derivatives_under_noise_against_the_exact_ones(name: str, stated: float | None) -> None:
    """A small part of what central differences make of the accelerations, with nothing said about the motion."""
    log = noisy()
    found = errors(FILTERS.make(name, {"position_noise": stated}).apply(log))
    plain = np.gradient(np.gradient(log.q[:, 0], 1 / RATE), 1 / RATE)
    assert found[2] < 0.05 * np.std((plain - EXACT[2])[INSIDE])
    assert found[2] < 0.05 * np.std(EXACT[2])
    assert found[0] < 0.5 * NOISE


@pytest.mark.parametrize("model", ["jerk", "snap"])
def test_likelihood_finds_the_noise_and_states_honest_deviations_of_the_positions(model: str) -> None:
    log, part = noisy(3), KalmanSmoother(model=model)
    step = part.apply(log).source.steps[-1]
    assert float(step.split("noise of positions ")[1].split(",")[0]) == pytest.approx(NOISE, rel=0.1)
    stated = part.deviations(log)
    made = errors(part.apply(log))
    for error, deviation in zip(made, stated, strict=True):
        assert 0.3 < error / np.median(deviation[INSIDE]) < 1.5
    assert np.all(stated[2][-1] > np.median(stated[2]))  # the end is known worse


def process(order: int, ratio: float, steps: np.ndarray) -> tuple[list[np.ndarray], list[np.ndarray]]:
    moves, noises = [], []
    for step in steps:
        i, j = np.indices((order, order))
        gap = np.where(j >= i, j - i, 0)
        moves.append(np.where(j >= i, step**gap / FACTORIALS[gap], 0.0))
        power = 2 * order - 1 - i - j
        below = FACTORIALS[order - 1 - i] * FACTORIALS[order - 1 - j] * power
        noises.append(ratio * step**power / below)
    return moves, noises


@pytest.mark.parametrize("order", [3, 4])
def test_the_smoother_is_the_dense_least_squares_of_its_model_on_uneven_steps(order: int) -> None:
    """All states at once, measurement and process equations whitened: mean and covariance of that one problem."""
    generator = np.random.default_rng(order)
    count, ratio = 25, 0.3
    steps = generator.uniform(0.5, 1.6, count - 1)
    signal = 5 * np.sin(np.cumsum(np.r_[0, steps]) / 4) + generator.normal(size=count)
    moves, noises = process(order, ratio, steps)
    rows, right = [], []
    for t in range(count):
        row = np.zeros(count * order)
        row[t * order] = 1.0
        rows.append(row[None])
        right.append(signal[t : t + 1])
        if t < count - 1:
            block = np.zeros((order, count * order))
            block[:, t * order : (t + 1) * order] = -moves[t]
            block[:, (t + 1) * order : (t + 2) * order] = np.eye(order)
            whiten = np.linalg.inv(np.linalg.cholesky(noises[t]))
            rows.append(whiten @ block)
            right.append(np.zeros(order))
    matrix, target = np.concatenate(rows), np.concatenate(right)
    inverse = np.linalg.inv(matrix.T @ matrix)
    exact = (inverse @ matrix.T @ target).reshape(count, order)
    mean, deviation = smoothed(signal, steps, ratio, order)
    size = np.abs(exact).max(axis=0)
    np.testing.assert_allclose(
        mean / size, exact / size, atol=0.02
    )  # the wide start pulls a little at the first samples
    np.testing.assert_allclose(mean[5:] / size, exact[5:] / size, atol=0.005)
    np.testing.assert_allclose(deviation[5:], np.sqrt(np.diag(inverse)).reshape(count, order)[5:], rtol=0.02)


def test_the_likelihood_is_largest_near_the_truth() -> None:
    generator = np.random.default_rng(5)
    order, ratio, count = 3, 1e-3, 4000
    moves, noises = process(order, ratio, np.ones(1))
    root, state, signal = np.linalg.cholesky(noises[0]), np.zeros(order), np.empty(count)
    for t in range(count):
        signal[t] = state[0] + generator.normal()
        state = moves[0] @ state + root @ generator.normal(size=order)
    values = []
    for factor in (0.2, 0.5, 1.0, 2.0, 5.0):
        found = likelihood(signal, np.ones(count - 1), factor * ratio, order)
        values.append(-0.5 * (found.squares + found.log_variance))
    assert np.argmax(values) in (1, 2, 3)
    assert values[2] > values[0] + 2 and values[2] > values[4] + 2


@pytest.mark.parametrize("name", ["kalman_smoother", "smoothing_spline"])
def test_torque_and_regressor_pass_the_stated_low_pass_or_none(name: str) -> None:
    log = noisy()
    low = FILTERS.make(name, {"cutoff_hz": 4.0})
    assert log.torque is not None
    expected = Butterworth(4.0).smooth(log.torque.T, RATE).T
    np.testing.assert_allclose(np.asarray(low.apply(log).torque), expected, atol=1e-12)
    assert low.bandwidth() == 4.0 and low.reach(RATE) == Butterworth(4.0).reach(RATE)
    raw = FILTERS.make(name, {"torque": "none"})
    np.testing.assert_array_equal(np.asarray(raw.apply(log).torque), log.torque)
    assert raw.bandwidth() is None and raw.reach(RATE) == 0 and raw.statement()["cutoff_hz"] is None
    for option, value in (("torque", "half"), ("cutoff_hz", 0.0), ("position_noise", -1.0)):
        with pytest.raises(BadOption, match=option):
            FILTERS.make(name, {option: value})


def test_the_spline_is_scipys_for_its_penalty_and_leaves_the_stated_noise() -> None:
    log = noisy(7)
    column = log.q[:, 0]
    found = SmoothingSpline(position_noise=NOISE).apply(log)
    assert np.std(column - found.q[:, 0]) == pytest.approx(NOISE, rel=0.03)
    chosen = penalty_of(column, RATE, None)
    spline = scipy.interpolate.make_smoothing_spline(TIME, column, lam=chosen / RATE**3)
    free = SmoothingSpline().apply(log)
    np.testing.assert_allclose(free.q[:, 0], spline(TIME), atol=1e-10)
    np.testing.assert_allclose(np.asarray(free.ddq)[:, 0], spline.derivative(2)(TIME), atol=1e-6)


def test_cross_validation_is_near_that_of_scipy() -> None:
    """On a short log, where its dense rule can be afforded; the unit of time is a sample in both."""
    column = noisy(8, 5e-3).q[:300, 0]
    theirs = scipy.interpolate.make_smoothing_spline(np.arange(300.0), column)(np.arange(300.0))
    place = np.arange(300.0)
    ours = scipy.interpolate.make_smoothing_spline(place, column, lam=penalty_of(column, RATE, None))(place)
    error, same = np.std((theirs - EXACT[0][:300])[30:-30]), np.std((ours - EXACT[0][:300])[30:-30])
    assert same < 1.3 * error
