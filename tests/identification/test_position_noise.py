"""Errors that no residual shows: noise of the positions is taken out, and the pull of a prior is in the intervals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dynident import DynamicModel, FourierSeries, Log, identify, read_robot
from dynident.data.preprocessing import FILTERS, Preprocessing, default_preprocessing
from dynident.data.preprocessing._spectra import like_noise
from dynident.data.preprocessing._zero_phase import low_passed
from dynident.diagnosis.warnings import warnings_of
from dynident.identification.build_problem import build_problem
from dynident.identification.estimate.estimate import Estimate
from dynident.identification.estimators import ESTIMATORS
from dynident.identification.estimators.wls import WLS
from dynident.identification.fit import fit
from dynident.identification.residuals.coloured import spectral_uncertainty
from dynident.identification.uncertainty.position_noise import bias_of
from dynident.identification.uncertainty.trust import TrustOptions
from dynident.model.friction import FRICTION, Motion
from dynident.model.reduction import Triangle, least_squares, reduce
from dynident.results.choices import choice_tables

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


def found(noise: float, cutoff_hz: float, seed: int = 0, by: str = "wls") -> tuple[Estimate, Estimate, np.ndarray]:
    """The estimate by `identify`, the bare fit, and the true base parameters."""
    model, log, theta = moved(noise, seed)
    whole = identify(model, [log], by, how(cutoff_hz))
    bare = fit(build_problem(model, [log], how(cutoff_hz)), ESTIMATORS.make(by))
    return whole, bare, whole.base.from_standard(theta)


def test_without_noise_of_the_positions_estimate_and_covariance_are_those_of_the_fit() -> None:
    whole, bare, _ = found(0.0, 10.0)
    assert whole.choices.position_noise is None
    assert np.array_equal(whole.beta, bare.beta)
    assert np.array_equal(whole.covariance, bare.covariance)
    assert not any("noise of the positions" in text for text in warnings_of(whole))


def test_the_bias_is_taken_out_and_the_intervals_hold_the_truth() -> None:
    draws = [found(2e-4, 25.0, seed) for seed in range(4)]
    before = np.array([bare.beta - truth for _, bare, truth in draws])
    after = np.array([whole.beta - truth for whole, _, truth in draws])
    wide = np.array([whole.half_widths() for whole, *_ in draws])
    assert np.mean(np.abs(before) < [bare.half_widths() for _, bare, _ in draws]) < 0.7
    assert np.mean(np.abs(after) < wide) > 0.8
    biased = np.abs(before.mean(axis=0)) > 3 * before.std(axis=0)
    assert biased.sum() >= 3
    assert np.linalg.norm((after / wide).mean(axis=0)) < 0.7 * np.linalg.norm((before / wide).mean(axis=0))
    (title, table), *_ = choice_tables(draws[0][0].choices, draws[0][0].model)
    assert title == "Noise of the positions: its bias is taken out, but for 50 % that may be left"
    assert "50 % of it may be left" in table.note
    told = [whole.choices.position_noise for whole, *_ in draws]
    assert all(one is not None and 0.0 < one.left < 0.95 for one in told)
    assert np.allclose(next(one.positions for one in told if one)[:2], 2e-4, rtol=0.1)


@pytest.mark.parametrize("name", ["consistent", "ols", "huber"])
def test_what_asks_for_rows_is_widened_and_the_others_are_mended(name: str) -> None:
    whole, bare, truth = found(2e-4, 25.0, by=name)
    told = whole.choices.position_noise
    assert told is not None
    if name == "huber":
        assert told.left == 1.0
        assert np.array_equal(whole.beta, bare.beta)
    else:
        assert np.linalg.norm((whole.beta - truth) / bare.std) < 0.7 * np.linalg.norm((bare.beta - truth) / bare.std)
        assert whole.consistency.consistent or name == "ols"
    assert np.mean(np.abs(whole.beta - truth) < whole.half_widths()) > 0.8


def test_noise_that_drowns_the_motion_is_not_taken_out_and_the_intervals_say_so() -> None:
    with pytest.warns(UserWarning, match="nothing explained"):
        whole, bare, truth = found(2e-2, 60.0)
    told = whole.choices.position_noise
    assert told is not None and told.left == 1.0
    assert np.array_equal(whole.beta, bare.beta)
    assert np.median(whole.std / bare.std) > 2
    assert np.mean(np.abs(whole.beta - truth) < whole.half_widths()) > np.mean(
        np.abs(bare.beta - truth) < bare.half_widths()
    )


def test_the_bias_is_that_of_noisy_rows() -> None:
    generator = np.random.default_rng(5)
    clean, noise = generator.normal(size=(4000, 5)), generator.normal(size=(4000, 5)) * [0.1, 0.5, 0.0, 1.0, 0.3]
    beta = np.array([1.0, -2.0, 0.5, 3.0, 0.1])
    rows, exact = np.column_stack([clean + noise, clean @ beta]), np.column_stack([clean, clean @ beta])
    triangle = Triangle(np.arange(5), np.asfortranarray(np.linalg.qr(rows)[1]), 4000)
    reduced = reduce([triangle], 5, [1.0])
    bias, spread, share = bias_of(reduced, rows.T @ rows - exact.T @ exact)
    assert np.allclose(least_squares(reduced).beta - bias, beta, rtol=1e-9)
    assert np.allclose(spread, np.linalg.solve(clean.T @ clean, rows[:, :5].T @ rows[:, :5]))
    assert 0.3 < share < 0.6
    moved = least_squares(reduce([triangle.shifted(bias)], 5, [1.0])).beta
    assert np.allclose(moved, beta, rtol=1e-9)
    assert triangle.shifted(bias).residual_square(moved) == pytest.approx(triangle.residual_square(moved + bias))
    assert np.allclose(bias_of(reduced, np.zeros((6, 6)))[0], 0.0, atol=1e-12)


def test_what_follows_the_fit_follows_the_mended_one() -> None:
    model, log, theta = moved(2e-4)
    halves = [log.rows(slice(0, 2000), "first"), log.rows(slice(2000, None), "rest")]
    trust = TrustOptions(diagnose=True, folds=2, bootstrap=40)
    found = identify(model, halves, "consistent", how(25.0), trust=trust)
    assert found.choices.position_noise is not None and found.choices.position_noise.left == 0.5
    facts = found.diagnostics
    assert facts is not None
    assert found.standard_deviations is not None and np.median(found.standard_deviations) > 0
    assert sum(part["leverage"] for part in facts["parts"]) == pytest.approx(1.0)
    assert max(part["cook"] for part in facts["parts"]) < 5
    low, high = np.array(facts["bootstrap"]["low"]), np.array(facts["bootstrap"]["high"])
    assert np.mean((low <= found.beta) & (found.beta <= high)) > 0.9
    truth = found.base.from_standard(theta)
    assert np.linalg.norm((found.beta - truth) / found.std) < 0.7 * np.linalg.norm(
        (fit(build_problem(model, halves, how(25.0)), ESTIMATORS.make("consistent")).beta - truth) / found.std
    )


def test_the_warning_of_it_helps() -> None:
    warned, _, truth = found(2e-4, 25.0, by="huber")
    text = next(text for text in warnings_of(warned) if "noise of the positions" in text)
    assert "lower the cut-off" in text and "errors-in-variables bias" in text
    obeyed, _, _ = found(2e-4, 4.0)
    assert not any("noise of the positions" in text for text in warnings_of(obeyed))
    weight = np.sqrt(np.diag(obeyed.covariance))
    assert np.linalg.norm((obeyed.beta - truth) / weight) < 0.5 * np.linalg.norm((warned.beta - truth) / weight)


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


def test_a_direction_of_noise_alone_widens_no_other() -> None:
    """Noise that is overestimated where it is all there is had moved every parameter by many deviations."""
    generator = np.random.default_rng(6)
    mixing = np.eye(5) + 0.2 * generator.normal(size=(5, 5))
    parts, sizes = generator.normal(size=(4000, 5)), np.array([1.0, 1.0, 1.0, 1.0, 0.05])
    rows, beta = parts * sizes @ mixing, np.array([1.0, -2.0, 0.5, 3.0, 0.1])
    triangle = Triangle(np.arange(5), np.asfortranarray(np.linalg.qr(np.column_stack([rows, rows @ beta]))[1]), 4000)
    reduced = reduce([triangle], 5, [1.0])
    added = np.zeros((6, 6))
    for share in (0.9, 1.3, 4.0):
        noise = np.sqrt(4000 * share) * 0.05 * mixing[4]
        added[:5, :5] = np.outer(noise, noise)
        bias, spread, found = bias_of(reduced, added)
        assert found == pytest.approx(share, rel=0.1)
        assert np.linalg.norm(bias) <= 2.0 * np.linalg.norm(beta) and np.linalg.norm(spread, 2) < 9.0


@pytest.mark.parametrize("steps", [0.0, 1e-3])
def test_noise_as_the_positions_have_it(steps: float) -> None:
    """White, or what rounding adds: of its power at slow motion a low-pass leaves more than of white noise's."""
    time, generator = np.arange(20000) / 200.0, np.random.default_rng(7)
    motion = np.column_stack([np.sin(0.5 * time), 0.02 * np.sin(0.5 * time)])
    q = motion + (2e-4 * generator.normal(size=motion.shape) if not steps else 0.0)
    log = Log(("a", "b"), time, np.round(q / steps) * steps if steps else q)
    noise = like_noise(log, log.resolution if steps else np.zeros(2), generator)
    real, drawn = (low_passed(one, 4, 5.0, 200.0)[2000:-2000] for one in (log.q - motion, noise))
    assert np.allclose(np.std(noise, axis=0), np.std(log.q - motion, axis=0), rtol=0.1)
    assert np.allclose(np.std(drawn, axis=0), np.std(real, axis=0), rtol=0.35)
    passed = np.std(drawn, axis=0) / np.std(noise, axis=0)  # of white noise the root of 5 in 100 Hz, 0.22
    assert (passed[1] > 1.5 * passed[0]) == bool(steps)
