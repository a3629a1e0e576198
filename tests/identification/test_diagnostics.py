"""Diagnostics find what was put in, and nothing where nothing was."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from dynident.applications.predicted_torque import torque_deviations
from dynident.arrays import Array
from dynident.data.log import Log
from dynident.data.preprocessing import Preprocessing, preprocess
from dynident.data.preprocessing.as_given import AsGiven
from dynident.data.preprocessing.butterworth import Butterworth, central_differences
from dynident.errors import BadOption
from dynident.identification.build_problem import build_problem
from dynident.identification.estimators.consistent import Consistent
from dynident.identification.estimators.wls import WLS
from dynident.identification.identify import identify
from dynident.identification.problem.regressor_stream import RegressorStream
from dynident.identification.residuals.row_passes import RowPasses
from dynident.identification.uncertainty.diagnostics import DECIDES, constancy_of, diagnose, whiteness_of
from dynident.identification.uncertainty.propagation import mass_matrix, prediction_deviations, standard_covariance
from dynident.identification.uncertainty.trust import TrustOptions
from dynident.identification.validate import validate
from dynident.model.friction import Motion
from dynident.model.kernels import batched
from dynident.model.robot import Robot
from noisy_arms import GIVEN, Bench

MakeLog = Callable[..., Log]


@pytest.fixture(scope="module")
def bench(planar_2r: Robot, exact_log: MakeLog) -> Bench:
    return Bench(planar_2r, exact_log, samples=1200)


def noisy(bench: Bench, noise: Array) -> Log:
    return replace(bench.log, torque=np.asarray(bench.log.torque) + noise)


def test_white_noise_has_nothing_to_find(bench: Bench) -> None:
    """Twelve seeds, two joints: p-values are spread evenly, so few are small."""
    white, same = [], []
    for seed in range(12):
        problem = bench.problem(bench.white(seed))
        found = diagnose(problem, WLS(), WLS().solve(problem).beta, 0)
        white += found.whiteness.tolist()
        same += found.constant_variance.tolist()
        assert found.effective_rows == pytest.approx(found.rows, rel=0.35)
        assert found.leverage.sum() == pytest.approx(1.0) and np.all(found.cook < 0.5)
    assert np.sum(np.array(white) < 0.05) <= 5 and np.sum(np.array(same) < 0.05) <= 5
    assert np.mean(white) == pytest.approx(0.5, abs=0.18) and np.mean(same) == pytest.approx(0.5, abs=0.18)


def test_coloured_noise_is_not_white(bench: Bench) -> None:
    problem = bench.problem(bench.coloured(0, 0.7))
    found = diagnose(problem, WLS(), WLS().solve(problem).beta, 0)
    assert np.all(found.whiteness < 1e-4) and found.effective_rows < 0.5 * found.rows
    assert any("autocorrelated: all joints" in sentence for sentence in found.verdicts())


def test_what_the_fit_takes_is_no_colour(planar_2r: Robot, exact_log: MakeLog) -> None:
    """Residuals with the power that the fit leaves of white noise, by the hat matrix in time, have nothing to find."""
    short = Bench(planar_2r, exact_log, samples=200)
    problem = short.problem(short.white(0))
    solution, samples = WLS().solve(problem), short.log.samples
    rows = short.model.regressor(Motion(short.log.q, short.log.dq, short.log.ddq))[..., short.base.independent]
    inverse = np.linalg.inv(sum(w**2 * rows[:, i].T @ rows[:, i] for i, w in enumerate(solution.weights)))
    residual, turned = np.empty((samples, 2)), np.empty(0)
    for i, weight in enumerate(solution.weights):
        left = np.eye(samples) - weight**2 * rows[:, i] @ inverse @ rows[:, i].T
        power = np.real(np.diag(np.fft.fft(np.fft.fft(left, axis=0).conj().T, axis=0)))[: samples // 2 + 1] / samples
        assert 0.0 <= power.min() < 0.9
        turned = np.exp(2j * np.pi * np.random.default_rng(i).random(len(power)))
        residual[:, i] = np.fft.irfft(np.sqrt(np.maximum(power, 0.1)) * turned, samples) / weight
    passes = RowPasses(problem)
    np.testing.assert_allclose(whiteness_of(passes, residual, solution.weights), 1.0, atol=1e-12)
    flat = np.fft.irfft(np.abs(np.fft.rfft(residual[:, :1], axis=0)) ** 0 * turned[:, None], samples, axis=0)
    assert np.all(whiteness_of(passes, np.repeat(flat, 2, axis=1), solution.weights) < 1.0 - 1e-9)


def test_noise_before_a_filter_counts_as_white(bench: Bench) -> None:
    how = Preprocessing(Butterworth(cutoff_hz=8.0, torque="same"), trim_s=0.3, rest="keep")
    p_values = []
    for seed in range(6):
        log = noisy(bench, bench.white(seed, 0.2))
        problem = build_problem(bench.model, [log], how)
        p_values += diagnose(problem, WLS(), WLS().solve(problem).beta, 0).whiteness.tolist()
    assert np.sum(np.array(p_values) < 0.01) <= 2


def test_noise_that_grows_with_speed_is_found(bench: Bench) -> None:
    speed = np.abs(np.asarray(bench.log.dq))
    problem = bench.problem(bench.white(0) * (0.1 + speed / speed.mean(axis=0)))
    found = diagnose(problem, WLS(), WLS().solve(problem).beta, 0)
    assert np.all(found.constant_variance < 1e-3)
    assert any("depends on speed or torque: all joints" in sentence for sentence in found.verdicts())


def test_a_part_that_decides_is_named(bench: Bench) -> None:
    noise = bench.white(0)
    noise[480:600] += 3.0 * bench.size * np.sign(np.sin(np.arange(120) / 7))[:, None]
    problem = bench.problem(noise)
    found = diagnose(problem, WLS(), WLS().solve(problem).beta, 0)
    assert int(np.argmax(found.cook)) == 4
    noise[480:600] += 5.0 * bench.size * np.sign(np.asarray(bench.log.dq)[480:600])
    problem = bench.problem(noise)
    found = diagnose(problem, WLS(), WLS().solve(problem).beta, 0)
    assert int(np.argmax(found.cook)) == 4 and found.cook[4] > DECIDES
    told = f"block 5 of 10 is influential (Cook's distance {found.cook[4]:.2g})"
    assert found.verdicts()[-1] == told


def test_noisy_states_bias_least_squares_and_are_found(bench: Bench) -> None:
    """Plain differences of noisy positions, commanded positions free of the noise."""
    generator = np.random.default_rng(0)
    clean = bench.log
    q = clean.q + 2e-3 * generator.normal(size=clean.q.shape)
    dq = central_differences(q, clean.rate)
    log = replace(noisy(bench, bench.white(1)), q=q, dq=dq, ddq=central_differences(dq, clean.rate), q_ref=clean.q)
    how = Preprocessing(AsGiven(), rest="keep", trim_s=0.1)
    found = diagnose(
        build_problem(bench.model, [log], how), WLS(), WLS().solve(build_problem(bench.model, [log], how)).beta, 0
    )
    assert found.exogeneity is not None and found.exogeneity.is_biased()
    assert any("errors-in-variables bias: significant" in sentence for sentence in found.verdicts())
    near = {name: getattr(clean, name) + 1e-7 * generator.normal(size=q.shape) for name in ("q", "dq", "ddq")}
    quiet = replace(noisy(bench, bench.white(1)), **near, q_ref=clean.q)
    fine = diagnose(build_problem(bench.model, [quiet], how), WLS(), bench.truth, 0)
    assert fine.exogeneity is not None and not fine.exogeneity.is_biased()
    assert any("errors-in-variables bias: not significant (p = " in sentence for sentence in fine.verdicts())
    exact = diagnose(
        build_problem(bench.model, [replace(noisy(bench, bench.white(1)), q_ref=clean.q)], how), WLS(), bench.truth, 0
    )
    assert exact.exogeneity is None and "the instruments are the regressor itself" in exact.reference
    none = diagnose(bench.problem(bench.white(1)), WLS(), bench.truth, 0)
    assert none.exogeneity is None and "q_ref" in none.reference


def test_several_logs_are_left_out_one_by_one_too(bench: Bench) -> None:
    problem = bench.problem(bench.white(0), cuts=(400, 800))
    parts, logs = diagnose(problem, WLS(), WLS().solve(problem).beta, 4).cross_validation
    assert (parts.over, len(parts.folds)) == ("blocks", 4) and (logs.over, len(logs.folds)) == ("logs", 3)
    assert logs.in_sample == pytest.approx(parts.in_sample) and logs.relative_error > logs.in_sample


def test_a_joint_without_any_residual_changes_with_nothing(bench: Bench) -> None:
    noise = bench.white(0)
    noise[:, 1] = 0.0
    problem = bench.problem(noise)
    passes = RowPasses(problem)
    residual = np.stack([np.asarray(noise[:, 0]), np.zeros(len(noise))], axis=1)
    assert constancy_of(problem, passes, residual)[1] == 1.0


def test_an_estimate_carries_its_diagnostics(bench: Bench) -> None:
    estimate = identify(
        bench.model, [noisy(bench, bench.white(0))], "wls", GIVEN, trust=TrustOptions(folds=3, bootstrap=50)
    )
    found = estimate.diagnostics
    assert found is not None and len(found["cross_validation"][0]["folds"]) == 3
    assert found["bootstrap"]["kind"] == "blocks"
    np.testing.assert_allclose(np.array(found["bootstrap"]["std"]) / estimate.std, 1.0, atol=0.5)
    assert identify(bench.model, [noisy(bench, bench.white(0))], "wls", GIVEN).diagnostics is None


def test_covariances_that_follow(bench: Bench) -> None:
    """Standard parameters, torque and mass matrix against draws from the base parameters' covariance."""
    problem = bench.problem(bench.white(0, 0.2))
    estimate = identify(bench.model, [noisy(bench, bench.white(0, 0.2))], Consistent(), GIVEN)
    standard = standard_covariance(estimate, problem)
    matrix = estimate.base.matrix
    with pytest.raises(BadOption, match=r"pull = 0\.0 is not possible; give a number above 0"):
        standard_covariance(estimate, problem, 0.0)
    back = matrix @ standard @ matrix.T
    assert np.all(np.diag(back) <= np.diag(estimate.covariance) * (1 + 1e-6))
    np.testing.assert_allclose(np.diag(back), np.diag(estimate.covariance), rtol=0.05)
    draws = np.random.default_rng(0).multivariate_normal(estimate.beta, estimate.covariance, 4000)
    q, joints = np.array([0.3, -0.8]), 2
    rest = Motion(np.tile(q, (3, 1)), np.zeros((3, 2)), np.array([[1.0, 0], [0, 1.0], [0, 0]]))
    rows = bench.model.regressor(rest)[..., estimate.base.independent]
    masses = draws @ (rows[:joints] - rows[joints]).reshape(-1, len(estimate.beta)).T
    theta = bench.model.robot.nominal
    assert theta is not None
    exact = replace(estimate, beta=bench.truth)
    np.testing.assert_allclose(
        mass_matrix(exact, q)[0], batched.mass_matrix(bench.model.robot.chain, theta, q[None])[0]
    )
    np.testing.assert_allclose(mass_matrix(estimate, q)[1], masses.std(axis=0).reshape(joints, joints).T, rtol=0.06)
    few = bench.log.rows(slice(0, 20), "few")
    torques = np.einsum("nib,db->dni", _rows(bench, few), draws)
    np.testing.assert_allclose(torque_deviations(estimate, preprocess(few, GIVEN)), torques.std(axis=0), rtol=0.06)


def test_bands_hold_the_share_of_rows_that_they_state(bench: Bench) -> None:
    """95 % of the rows of another run lie in the band; that of the parameters holds 95 % of the true torques."""
    shares, held = [], []
    for seed in range(20):
        estimate = identify(
            bench.model,
            [noisy(bench, bench.white(seed, 0.2))],
            "wls",
            GIVEN,
            trust=TrustOptions(diagnose=True, folds=0),
        )
        found = validate(estimate, [noisy(bench, bench.white(100 + seed, 0.2))])
        shares += [joint["inside"] for joint in found.bands()]
        widths, truth = found.half_widths(), validate(estimate, [bench.log]).measured
        assert widths is not None and found.deviations is not None
        held.append(np.mean(np.abs(found.predicted - truth) <= widths[0]))
        train = estimate.train
        assert train.deviations is not None and train.deviations.shape == train.measured.shape
        np.testing.assert_array_equal(np.asarray(train.noise), estimate.joint_deviations)
    assert 0.94 < np.mean(shares) < 0.96
    assert 0.90 < np.mean(held) < 0.99
    regressor, few = RegressorStream(bench.model, bench.base), preprocess(bench.log, GIVEN)
    np.testing.assert_allclose(
        prediction_deviations(regressor, few, np.eye(bench.base.count))[:5],
        np.linalg.norm(_rows(bench, bench.log)[:5], axis=2),
        rtol=1e-9,
    )


def _rows(bench: Bench, log: Log) -> Array:
    motion = Motion(log.q, np.asarray(log.dq), np.asarray(log.ddq))
    return bench.model.regressor(motion)[..., bench.base.independent]
