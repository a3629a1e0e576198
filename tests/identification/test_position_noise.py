"""Errors that no residual shows are in the intervals: noise of the positions, and the pull of a prior."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dynident import DynamicModel, FourierSeries, Log, identify, read_robot
from dynident.data.preprocessing import FILTERS, Preprocessing, default_preprocessing
from dynident.diagnosis.warnings import warnings_of
from dynident.identification.build_problem import build_problem
from dynident.identification.estimate.estimate import Estimate
from dynident.identification.estimators.wls import WLS
from dynident.identification.fit import fit
from dynident.identification.residuals.coloured import spectral_uncertainty
from dynident.model.friction import FRICTION, Motion
from dynident.model.reduction import least_squares

RATE = 200.0


def how(cutoff_hz: float) -> Preprocessing:
    return replace(default_preprocessing(), filter=FILTERS.make("butterworth", {"cutoff_hz": cutoff_hz}))


def moved(noise: float, seed: int = 0) -> tuple[DynamicModel, Log, np.ndarray]:
    """An arm that moved for 20 s; white noise of the positions in rad or m, and of the torques."""
    model = DynamicModel(read_robot("generic-scara"), (FRICTION.make("viscous"), FRICTION.make("coulomb")))
    drawn = np.random.default_rng(0)
    scale = np.array([0.6, 0.6, 0.02, 0.8])[:, None]
    middle = [0.5 * (j.limits.lower + j.limits.upper) if np.isfinite(j.limits.lower) else 0 for j in model.robot.active]
    sine, cosine = scale * drawn.normal(size=(2, 4, 4)) / 2
    motion = FourierSeries(np.array(middle), sine, cosine, 10.0)
    time = np.arange(int(20 * RATE)) / RATE
    q, dq, ddq = motion.evaluate(time)
    nominal = model.nominal()
    assert nominal is not None
    theta = np.r_[nominal[: model.inertial_count], np.tile([0.5, 1.0], 4)]
    torque = model.torque(Motion(q, dq, ddq), theta)
    generator = np.random.default_rng(100 + seed)
    torque = torque + 0.002 * np.abs(torque).max(axis=0) * generator.normal(size=q.shape)
    q = q + noise * np.array([1.0, 1.0, 0.03, 1.0]) * generator.normal(size=q.shape)
    return model, Log(model.robot.joint_names, time, q, torque=torque), theta


def found(noise: float, cutoff_hz: float, seed: int = 0) -> tuple[Estimate, Estimate, np.ndarray]:
    """The estimate by `identify`, the bare fit, and the errors of both."""
    model, log, theta = moved(noise, seed)
    whole = identify(model, [log], "wls", how(cutoff_hz))
    bare = fit(build_problem(model, [log], how(cutoff_hz)), WLS())
    assert np.array_equal(whole.beta, bare.beta)
    return whole, bare, whole.beta - whole.base.from_standard(theta)


def test_without_noise_of_the_positions_the_covariance_is_that_of_the_residual() -> None:
    whole, bare, _ = found(0.0, 10.0)
    assert whole.choices.position_noise is None
    assert np.array_equal(whole.covariance, bare.covariance)
    assert not any("noise of the positions" in text for text in warnings_of(whole))


def test_intervals_hold_the_truth_under_noise_of_the_positions() -> None:
    pairs = [found(2e-4, 25.0, seed) for seed in range(6)]
    errors = np.array([error for *_, error in pairs])
    bare = np.mean([np.abs(error) < one.half_widths() for _, one, error in pairs])
    whole = np.mean([np.abs(error) < one.half_widths() for one, _, error in pairs])
    assert bare < 0.7
    assert whole > 0.9
    told = [one.choices.position_noise for one, *_ in pairs]
    assert all(one is not None for one in told)
    bias, stated = errors[:3].mean(axis=0), np.mean([one.parameters for one in told[:3] if one], axis=0)
    large = np.abs(bias) > 3 * errors[:3].std(axis=0)
    assert large.sum() >= 3
    ratio = stated[large] / bias[large]
    assert np.all((ratio > 0.4) & (ratio < 2.5)), ratio
    assert np.allclose(next(one.positions for one in told if one)[:2], 2e-4, rtol=0.1)


def test_the_warning_of_it_helps() -> None:
    warned, _, error = found(2e-4, 25.0)
    text = next(text for text in warnings_of(warned) if "noise of the positions" in text)
    assert "lower the cut-off" in text and "errors-in-variables bias" in text
    obeyed, _, less = found(2e-4, 4.0)
    assert not any("noise of the positions" in text for text in warnings_of(obeyed))
    weight = np.sqrt(np.diag(obeyed.covariance))
    assert np.linalg.norm(less / weight) < 0.5 * np.linalg.norm(error / weight)


@pytest.mark.parametrize("name", ["consistent", "log_cholesky"])
def test_what_a_prior_moves_is_in_the_intervals(name: str) -> None:
    model, log, _ = moved(0.0)
    problem = build_problem(model, [log], how(5.0))
    estimate = identify(model, [log], name, how(5.0))
    weights = WLS().solve(problem).weights
    pull = estimate.beta - least_squares(problem.reduced(weights)).beta
    own = spectral_uncertainty(problem, weights, estimate.beta).covariance
    assert np.any(pull != 0)
    assert np.allclose(estimate.covariance, own + np.outer(pull, pull), rtol=1e-9, atol=1e-15)
