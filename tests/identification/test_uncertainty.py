"""Stated deviations hold for white, coloured and filtered noise and for logs of unequal noise; and their rivals."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import scipy.signal
import scipy.stats

from dynident.arrays import Array
from dynident.data.log import Log
from dynident.data.preprocessing import Preprocessing, preprocess
from dynident.data.preprocessing.butterworth import Butterworth
from dynident.errors import BadOption
from dynident.identification.build_problem import build_problem
from dynident.identification.estimators.consistent import Consistent
from dynident.identification.estimators.wls import WLS
from dynident.identification.fit import fit
from dynident.identification.identify import identify
from dynident.identification.problem.choices import Choices, FieldChoice
from dynident.identification.problem.problem import Problem, make_problem
from dynident.identification.residuals.bands import bands, filter_power
from dynident.identification.residuals.coloured import (
    Influence,
    Uncertainty,
    error_root,
    spectral_uncertainty,
    uncertainty_of,
)
from dynident.identification.residuals.quantiles import chi_square_tail, normal_quantile, normal_share, student_quantile
from dynident.identification.residuals.row_passes import RowPasses
from dynident.identification.residuals.stretches import stretches
from dynident.identification.simulated.estimators.kalman import bands_of_rows
from dynident.identification.uncertainty.bootstrap import BootstrapDraws, automatic_block, block_bootstrap
from dynident.identification.uncertainty.propagation import field_covariance
from dynident.identification.uncertainty.trust import refit_draws, with_diagnostics
from dynident.model.base_parameters import base_parameters
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction.balancer import Balancer
from dynident.model.reduction import least_squares
from dynident.model.robot import Robot
from noisy_arms import GIVEN, Bench

MakeLog = Callable[..., Log]


@pytest.fixture(scope="module")
def bench(planar_2r: Robot, exact_log: MakeLog) -> Bench:
    return Bench(planar_2r, exact_log, samples=1200)


def weights_of(problem: Problem) -> tuple[Array, Array]:
    solution = WLS().solve(problem)
    return solution.beta, solution.weights


@pytest.mark.parametrize("pole", [0.0, 0.9])
def test_intervals_hold_the_truth(bench: Bench, pole: float) -> None:
    """Pooled over parameters; the full Monte Carlo is benchmarks/coverage.py."""
    inside = []
    for seed in range(60):
        problem = bench.problem(bench.coloured(seed, pole))
        beta, weights = weights_of(problem)
        found = spectral_uncertainty(problem, weights, beta)
        inside.append(np.abs(beta - bench.truth) < found.half_widths())
    assert 0.91 < np.mean(inside) < 0.985


def test_filtered_rows_hold_the_truth(bench: Bench) -> None:
    how = Preprocessing(Butterworth(cutoff_hz=5.0), trim_s=0.2, rest="keep")
    inside = []
    for seed in range(40):
        torque = np.asarray(bench.log.torque) + bench.white(seed)
        log = Log(bench.log.joints, bench.log.time, bench.log.q, None, None, torque)
        estimate = fit(build_problem(bench.model, [log], how), WLS())
        clean = Log(bench.log.joints, bench.log.time, bench.log.q, None, None, np.asarray(bench.log.torque))
        truth = fit(build_problem(bench.model, [clean], how), WLS()).beta  # what the filter makes of no noise
        inside.append(np.abs(estimate.beta - truth) < estimate.half_widths())
    assert 0.90 < np.mean(inside) < 0.99


def test_white_noise_has_the_covariance_of_the_textbook(bench: Bench) -> None:
    ratios = []
    for seed in range(10):
        problem = bench.problem(bench.white(seed))
        beta, weights = weights_of(problem)
        found = spectral_uncertainty(problem, weights, beta)
        ratios.append(found.deviations**2 / np.diag(least_squares(problem.reduced(weights)).unscaled_covariance))
        assert np.all(found.degrees > 20)
    np.testing.assert_allclose(np.mean(ratios, axis=0), 1.0, atol=0.12)


def test_unequal_logs_have_their_own_noise(bench: Bench) -> None:
    """Ten times the noise in one of two logs: the true covariance is a sandwich over the logs."""
    size = np.where(np.arange(1200) < 600, 0.01, 0.1)[:, None]
    weights = 1.0 / bench.size
    stated = []
    for seed in range(12):
        problem = bench.problem(bench.white(seed, 1.0) * size, cuts=(600,))
        beta = least_squares(problem.reduced(weights)).beta
        stated.append(spectral_uncertainty(problem, weights, beta).covariance)
    problem = bench.problem(np.zeros((1200, 2)), cuts=(600,))
    rows = problem.rows
    weighted = rows.matrix * weights[rows.joint][:, None]
    inverse = np.linalg.inv(weighted.T @ weighted)
    meat = (weighted * size[rows.samples] ** 2).T @ weighted
    true = np.diag(inverse @ meat @ inverse)
    np.testing.assert_allclose(np.mean([np.diag(one) for one in stated], axis=0) / true, 1.0, atol=0.25)


def test_filter_power_is_that_of_filtered_noise(bench: Bench) -> None:
    how = Preprocessing(Butterworth(cutoff_hz=5.0), rate_hz=100.0, rest="keep")
    log = preprocess(bench.log, how)
    count, every = 200, 3
    shape = filter_power(log, count, every)
    noise = log.how.filter.smooth(np.random.default_rng(0).normal(size=(400, count * every)), log.log.rate)
    power = np.mean(np.abs(np.fft.rfft(noise[:, ::every], axis=1)) ** 2, axis=0) / count
    inside = shape > 0.3
    np.testing.assert_allclose(power[inside], shape[inside], rtol=0.35)
    assert shape[-1] < 1e-3 and shape[0] == pytest.approx(1 / every, abs=1e-3)


def test_thinned_stretches_keep_the_sums(bench: Bench) -> None:
    how = Preprocessing(Butterworth(cutoff_hz=3.0), trim_s=0.2, rest="keep")
    problem = build_problem(bench.model, [bench.log], how)
    passes = RowPasses(problem)
    whole = [np.concatenate([segment.blocks[1][:-1] for segment in passes], axis=1)]
    (part,) = list(stretches(passes))
    assert part.step > 1 and len(part.samples) == -(-problem.samples // part.step)
    full, thin = whole[0] @ whole[0].T, part.step * part.blocks[1] @ part.blocks[1].T
    np.testing.assert_allclose(np.diag(thin), np.diag(full), rtol=0.05)
    (band,) = list(bands(passes))
    spread = np.einsum("f,fik,fik->k", band.twice, band.rows.conj(), band.rows).real  # Parseval
    own = np.zeros(problem.base.count)
    for columns, block in zip(passes.columns, part.blocks, strict=True):
        own[columns] += part.step * np.sum(block**2, axis=1)
    np.testing.assert_allclose(spread, own, rtol=1e-9)


def test_half_widths_are_those_of_student() -> None:
    found = Uncertainty(np.diag([4.0, 1.0]), np.array([10.0, np.inf]))
    np.testing.assert_allclose(found.half_widths(), [2 * 2.2281, 1.95996], rtol=1e-4)


def test_an_average_is_as_wide_as_the_root_of_what_passes() -> None:
    """Odd, a half of the root of the frequencies that pass to either side, at most all, whatever the filter's gain."""
    (plain,) = bands_of_rows([np.zeros((400, 1, 1))])
    passed = np.arange(201) < 100
    shapes = {15: np.ones(201), 11: 1.0 * passed, 13: 0.3 + 0.7 * passed}
    for width, shape in shapes.items():
        for gain in (1.0, 0.1):
            assert replace(plain, shape=gain * shape).width == width
    (few,) = bands_of_rows([np.zeros((3, 1, 1))])
    assert few.width == 1


def test_degrees_of_freedom_are_those_of_the_averages_that_count() -> None:
    """An impulse has the same power everywhere; an average of 15 frequencies has 30 degrees, and two of them add."""
    time = 2 * np.pi * np.arange(400) / 400
    first, second = np.sin(22 * time), np.sin(52 * time)  # in the middle of the second and the fourth average
    rows = np.stack([first, first + second, first + 3.0 * second], axis=1)[:, None]
    impulse = np.zeros((400, 1))
    impulse[0] = 1.0
    made = Influence(np.eye(3)[None], np.zeros((3, 3)), np.zeros((1, 1)))
    found = uncertainty_of(bands_of_rows([rows]), impulse, made)
    np.testing.assert_allclose(found.degrees, [30.0, 60.0, 30.0 * (1 + 9) ** 2 / (1 + 81)], rtol=1e-9)
    np.testing.assert_allclose(np.diag(found.covariance), np.array([1.0, 2.0, 10.0]) * 200 / 400, rtol=1e-9)
    none = uncertainty_of(bands_of_rows([rows]), np.zeros((400, 1)), made)
    assert np.all(none.covariance == 0) and np.all(np.isinf(none.degrees))


def first_order(white: Array, memory: float) -> Array:
    return np.asarray(scipy.signal.lfilter([1.0], [1.0, -memory], white, axis=0))


def test_tails_and_quantiles_are_those_of_scipy_stats() -> None:
    values, degrees = np.array([-1.0, 0.0, 0.3, 0.99, 5.0, 80.0]), np.array([1.0, 2.0, 7.0])
    expected = scipy.stats.chi2.sf(values[:, None], degrees)
    np.testing.assert_allclose(chi_square_tail(values[:, None], degrees), expected, rtol=1e-12)
    assert np.isnan(chi_square_tail(1.0, 0.0)) and normal_share(0.0) == 0.5
    np.testing.assert_allclose(student_quantile(0.975, [3.0, np.inf]), [3.182446305, 1.959963985], rtol=1e-9)
    assert normal_quantile(0.975) == pytest.approx(1.959963985) and normal_share(1.959963985) == pytest.approx(0.975)


def test_errors_of_coloured_and_dependent_residuals() -> None:
    """The covariance of sum_i G_i X_i' e_i of a known process, against a sample of it."""
    generator = np.random.default_rng(0)
    time = np.arange(600) / 100
    waves = np.stack([np.sin(np.pi * time), np.sin(2 * np.pi * time), np.cos(1.4 * np.pi * time)], axis=1)
    rows = np.stack([waves * [1, 1, 0], waves * [0, 0, 1]], axis=1)
    mixing = np.array([[1.0, 0.8], [0.0, 0.6]])
    gains = np.stack([np.array([[1.0, 0.5, 0.0], [0.0, 0.0, 2.0]])] * 2)
    made = Influence(np.tile(np.eye(3) * 1e-9, (2, 1, 1)), np.zeros((3, 3)), np.eye(2))  # takes nothing from e
    whole, found = [], []
    for _ in range(300):
        white = generator.normal(size=(601, 2)) @ mixing
        error = white[1:] + 0.9 * white[:-1]
        whole.append(sum(gains[i] @ rows[:, i].T @ error[:, i] for i in range(2)))
        found.append(uncertainty_of(bands_of_rows([rows]), error, made, gains).covariance)
        root = error_root(bands_of_rows([rows]), error, made, gains)
        np.testing.assert_allclose(root.T @ root, found[-1], rtol=1e-9, atol=1e-9 * np.abs(found[-1]).max())
    expected, mean = np.cov(np.transpose(whole)), np.mean(found, axis=0)
    size = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    np.testing.assert_allclose(mean / size, expected / size, atol=0.15)


def test_what_a_fit_takes_at_some_frequencies_is_given_back() -> None:
    """A fit of waves leaves nothing of the noise at their frequencies; its errors are as large as ever."""
    generator, time = np.random.default_rng(0), np.arange(400) / 400
    waves = np.stack([wave(2 * np.pi * k * time) for k in range(2, 82, 4) for wave in (np.sin, np.cos)], axis=1)
    rows, inverse = waves[:, None], np.eye(40) / 200
    ratios = []
    for _ in range(100):
        error = generator.normal(size=400)
        residual = (error - waves @ (inverse @ waves.T @ error))[:, None]
        made = Influence(inverse[None], inverse, np.eye(1))
        ratios.append(np.diag(uncertainty_of(bands_of_rows([rows]), residual, made).covariance) * 200)
    assert 0.95 < np.mean(ratios) < 1.05


def test_an_error_that_is_known_beside_it_adds_and_is_sure() -> None:
    found = Uncertainty(np.diag([4.0, 1.0]), np.array([10.0, 10.0])).with_prior(np.diag([0.0, 3.0]))
    np.testing.assert_allclose(found.deviations, [2.0, 2.0])
    np.testing.assert_allclose(found.degrees, [10.0, 160.0])  # Satterthwaite: (4 / 1)^2 as many


def test_the_bootstrap_agrees_on_a_long_log(bench: Bench) -> None:
    problem = bench.problem(bench.white(1))
    beta, weights = weights_of(problem)
    found = spectral_uncertainty(problem, weights, beta).deviations
    draws = block_bootstrap(problem, weights, beta, draws=400)
    np.testing.assert_allclose(np.sqrt(np.diag(draws.covariance)) / found, 1.0, atol=0.35)
    np.testing.assert_array_equal(draws.beta, block_bootstrap(problem, weights, beta, draws=400).beta)
    low, high = draws.interval()
    assert np.all((low < beta) & (beta < high))


def test_blocks_grow_with_memory() -> None:
    white = np.random.default_rng(0).normal(size=(5000, 1))
    lengths = [automatic_block(first_order(white, p)) for p in (0.0, 0.5, 0.9)]
    assert lengths[0] < lengths[1] < lengths[2] and lengths[0] < 8
    assert automatic_block(np.zeros((50, 2))) == 1.0


def test_possible_robots_are_drawn_and_vary_no_more_than_free_ones(bench: Bench) -> None:
    problem = bench.problem(bench.white(3, 0.3))
    estimate = fit(problem, Consistent())
    draws = refit_draws(problem, Consistent().refit(problem), estimate.covariance, 60)
    assert draws.theta is not None and draws.theta.shape == (60, len(bench.theta))
    np.testing.assert_allclose(draws.beta, draws.theta @ problem.base.matrix.T)
    assert np.all(np.std(draws.beta, axis=0) < 1.5 * estimate.std)
    with pytest.raises(BadOption, match="bootstrap = 5"):
        with_diagnostics(estimate, problem, Consistent(), draws=5)
    assert isinstance(draws, BootstrapDraws) and draws.block == 0.0


def with_ratio(bench: Bench, ratio: float) -> DynamicModel:
    return replace(bench.model, friction=(*bench.model.friction, Balancer(ratio=ratio, vary=("ratio",))))


def balanced(bench: Bench, exact_log: MakeLog, seed: int) -> Log:
    """Return a noisy log of an arm with balancers of ratio 2."""
    exact = exact_log(with_ratio(bench, 2.0), np.append(bench.theta, BALANCERS), samples=1200)
    return replace(exact, torque=np.asarray(exact.torque) + bench.white(seed, 0.02))


#: Kb and Fb of the joints.
BALANCERS = (1.0, 0.5, -12.0, -6.0)


def test_intervals_count_that_a_field_of_friction_was_found(bench: Bench, exact_log: MakeLog) -> None:
    errors = []
    for seed in range(20):
        estimate = identify(with_ratio(bench, 3.0), [balanced(bench, exact_log, seed)], "wls", GIVEN)
        truth = base_parameters(estimate.model).from_standard(np.append(bench.theta, BALANCERS))
        errors.append((estimate.beta - truth) / estimate.std)
    spread = np.sqrt(np.mean(np.square(errors), axis=0))
    assert np.all((spread > 0.5) & (spread < 1.6)), spread


def test_estimates_move_with_a_field_as_their_covariance_says(bench: Bench, exact_log: MakeLog) -> None:
    """Beside fits at other values of the field: how far the estimate moves, and how much worse they are."""
    problem = build_problem(with_ratio(bench, 3.0), [balanced(bench, exact_log, 3)], GIVEN)
    assert problem.choices.non_linear is not None
    (field,) = problem.choices.non_linear
    (beta, weights), step = weights_of(problem), 0.02
    models = [with_ratio(bench, field.value * float(np.exp(by))) for by in (-step, 0.0, step)]
    sides = [make_problem(model, problem.base, problem.logs).reduced(weights) for model in models]
    moved = (least_squares(sides[2]).beta - least_squares(sides[0]).beta) / (2.0 * step)
    variance = 2.0 * step**2 / (sides[0].rest - 2.0 * sides[1].rest + sides[2].rest)
    added = field_covariance(problem, beta, 1.0 / weights, np.full(2, 4.0))
    wanted = 4.0 * variance * np.outer(moved, moved)
    np.testing.assert_allclose(added, wanted, rtol=0.1, atol=0.02 * float(np.max(added)))
    blind = field_covariance(problem, beta, 1e6 / weights, np.ones(2))  # then it may be anywhere in its range
    wanted = np.outer(moved, moved) * np.log(100.0 / 1.01) ** 2 / 12.0
    np.testing.assert_allclose(blind, wanted, rtol=0.1, atol=0.02 * float(np.max(wanted)))
    plain = bench.problem(bench.white(0))
    assert not field_covariance(plain, beta[: plain.base.count], np.ones(2), np.ones(2)).any()


def test_intervals_count_that_a_field_was_chosen_otherwise_than_stated(bench: Bench, exact_log: MakeLog) -> None:
    problem = build_problem(with_ratio(bench, 3.0), [balanced(bench, exact_log, 3)], GIVEN)
    beta, weights = weights_of(problem)
    part = replace(problem.model.friction[-1], vary=None, choose=("ratio",))
    value = part.options["ratio"]
    told = FieldChoice("balancer", None, "ratio", 3.0, value, value, 0.5, 0.1)
    model = replace(problem.model, friction=(*problem.model.friction[:-1], part))
    taken = replace(problem, model=model, choices=Choices(chosen_fields=(told,)))
    stated = replace(taken, choices=Choices(chosen_fields=(replace(told, stated=value),)))
    size = 1.0 / weights, np.ones(2)
    np.testing.assert_allclose(field_covariance(taken, beta, *size), field_covariance(problem, beta, *size))
    assert not field_covariance(stated, beta, *size).any()
