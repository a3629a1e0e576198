"""The chosen cut-off against a scan of cut-offs with known truth, its parts against closed forms."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from dynident.arrays import Array
from dynident.data.log import Log
from dynident.data.preprocessing import Preprocessing, default_preprocessing, preprocess
from dynident.data.preprocessing.as_given import AsGiven
from dynident.data.preprocessing.butterworth import Butterworth
from dynident.identification.build_problem import build_problem
from dynident.identification.identify import identify
from dynident.identification.problem.problem import unreduced
from dynident.identification.residuals.coloured import spectral_uncertainty
from dynident.identification.selection.cutoff import choice
from dynident.identification.selection.cutoff.block_triangles import block_triangles
from dynident.identification.selection.cutoff.candidates import Bench, CutoffCandidate, stretch_of, thinned_out
from dynident.identification.selection.cutoff.choice import choose_cutoff, with_cutoff
from dynident.model.base_parameters import base_parameters
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction.coulomb import Coulomb
from dynident.model.friction.viscous import Viscous
from dynident.model.robot import Robot

MakeLog = Callable[..., Log]
HOW = default_preprocessing()


class Cell:
    """A two-joint arm whose truth is known, and noisy logs of it without velocities."""

    def __init__(self, robot: Robot, exact_log: MakeLog) -> None:
        self.model = DynamicModel(robot, (Coulomb(0.05), Viscous()))
        assert robot.nominal is not None
        self.theta = np.append(robot.nominal, np.tile([0.5, 0.3], 2))
        self.base = base_parameters(self.model)
        self.truth = self.base.from_standard(self.theta)
        self.exact = exact_log(self.model, self.theta, samples=4000, rate=200.0)

    def log(self, position: float = 0.0, torque: float = 0.0, step: float = 0.0, seed: int = 0) -> Log:
        generator = np.random.default_rng(seed)
        q = self.exact.q + position * generator.normal(size=self.exact.q.shape)
        q = np.round(q / step) * step if step else q
        size = np.std(np.asarray(self.exact.torque), axis=0)
        tau = np.asarray(self.exact.torque) + torque * size * generator.normal(size=q.shape)
        return Log(self.exact.joints, self.exact.time, q, torque=tau)

    def bench(self, log: Log, noise: float = 0.0) -> Bench:
        return Bench(self.model, self.base, (log,), (0.0,), HOW, (np.full(2, noise),))


@pytest.fixture(scope="module")
def cell(planar_2r: Robot, exact_log: MakeLog) -> Cell:
    return Cell(planar_2r, exact_log)


@pytest.mark.parametrize(
    "noise",
    [
        {"position": 1e-4, "torque": 0.01},
        {"position": 5e-6, "torque": 0.01},
        {"step": 1e-3, "torque": 0.01},
        {"torque": 0.1},
    ],
    ids=["encoder", "fine encoder", "quantised", "torque"],
)
def test_the_choice_is_near_the_best_of_a_scan(cell: Cell, noise: dict[str, float]) -> None:
    """Mean squared error of the predicted torque over seeds, within 1.3 of the least on a grid of cut-offs."""
    grid = 2.0 ** np.arange(-0.5, 5.6, 0.5)
    errors = np.zeros(len(grid))
    gram: Array = cell.bench(cell.log()).rows(4.0).reduced.r
    for seed in range(4):
        bench = cell.bench(cell.log(**noise, seed=seed))
        errors += [float(np.sum((gram @ (bench.rows(hertz).fit[0] - cell.truth)) ** 2)) for hertz in grid]
    for seed in (0, 1):
        choice = choose_cutoff(cell.model, [cell.log(**noise, seed=seed)], HOW)
        ratio = float(np.exp(np.interp(np.log(choice.hertz), np.log(grid), np.log(errors)))) / errors.min()
        assert ratio < 1.3, (choice.hertz, grid[np.argmin(errors)])


def test_more_encoder_noise_asks_for_a_lower_cut_off(cell: Cell) -> None:
    chosen = [
        choose_cutoff(cell.model, [cell.log(position=noise, torque=0.01)], HOW).hertz for noise in (1e-6, 3e-5, 1e-3)
    ]
    assert chosen[0] > chosen[1] > chosen[2]


def test_the_noise_bias_is_what_noise_does_to_the_mean_estimate(cell: Cell) -> None:
    """SIMEX against the mean over many draws of the noise, where the bias is well above the variance."""
    noise, hertz = 1e-4, 16.0
    exact = cell.bench(cell.log()).rows(hertz).fit[0]
    draws = [cell.bench(cell.log(position=noise, seed=seed)).rows(hertz).fit[0] for seed in range(30)]
    bias = np.mean(draws, axis=0) - exact
    found = np.mean(
        [cell.bench(cell.log(position=noise, seed=s), noise).candidate(hertz).bias for s in range(100, 106)],  # type: ignore[union-attr]
        axis=0,
    )
    gram = cell.bench(cell.log()).rows(4.0).reduced.r
    assert np.linalg.norm(gram @ (found - bias)) < 0.3 * np.linalg.norm(gram @ bias)


def test_block_covariance_agrees_with_the_spectral_one(cell: Cell) -> None:
    log = cell.log(torque=0.05)
    problem = build_problem(cell.model, [log], replace(HOW, filter=Butterworth(8.0)))
    blocks = block_triangles(problem, 0.25, 40)
    assert len(blocks.blocks) == 40
    np.testing.assert_allclose(blocks.influences.sum(axis=0), 0, atol=1e-9 * np.abs(blocks.influences).max())
    beta, weights = blocks.fit
    spectral = spectral_uncertainty(problem, weights, beta).covariance
    gram = blocks.reduced.r.T @ blocks.reduced.r
    assert np.sum(gram * blocks.covariance) == pytest.approx(np.sum(gram * spectral), rel=0.35)


def test_block_triangles_are_the_rows(cell: Cell) -> None:
    """Triangles of blocks against those of the problem, and a fit without a block against one without its rows."""
    log = replace(cell.exact, torque=cell.log(torque=0.05).torque)
    how = Preprocessing(AsGiven(), rest="keep")
    problem = build_problem(cell.model, [log], how)
    blocks = block_triangles(problem, 0.0, 5)
    for whole, own in zip(problem.triangles, blocks.total, strict=True):
        np.testing.assert_allclose(own.factor.T @ own.factor, whole.factor.T @ whole.factor, rtol=1e-9, atol=1e-9)
        assert own.rows == whole.rows
    rest = [log.rows(slice(0, 1600), ""), log.rows(slice(2400, 4000), "")]
    prepared = [preprocess(part, how) for part in rest]
    expected = block_triangles(unreduced(cell.model, cell.base, prepared), 0.0, 1).fit[0]
    np.testing.assert_allclose(blocks.without([2]), expected, rtol=1e-7)


def test_a_stated_cut_off_is_kept_and_a_log_that_says_nothing_gets_the_stated_default(cell: Cell) -> None:
    stated = replace(HOW, filter=Butterworth(3.0))
    assert with_cutoff(cell.model, [cell.log()], stated) == (stated, None)
    given = replace(HOW, filter=AsGiven())
    assert with_cutoff(cell.model, [cell.log()], given) == (given, None)
    still = replace(cell.log(), torque=None)
    how, choice = with_cutoff(cell.model, [still], HOW)
    assert how.filter == Butterworth(5.0)
    assert choice is not None and "could be tried" in choice.reason and not choice.candidates


def test_identification_states_its_cut_off_and_why(cell: Cell) -> None:
    estimate = identify(cell.model, [cell.log(position=1e-4, torque=0.01)], "wls")
    choice = estimate.choices.cutoff_choice
    assert choice is not None
    assert estimate.preprocessing.filter == Butterworth(choice.cutoff_hz)
    assert estimate.train.filter["cutoff_hz"] == choice.cutoff_hz
    for joint in choice.spectra["joints"]:
        assert joint["position_noise_std"] == pytest.approx(1e-4, rel=0.1)
        assert len(joint["position"]) == len(joint["torque"]) == len(choice.spectra["hertz"])
        assert joint["excited_hz"] < joint["noise_from_hz"]


def test_thinning_before_the_filter_changes_next_to_nothing(cell: Cell) -> None:
    log = cell.log(torque=0.02)
    thin = thinned_out(log, 50.0)
    assert thin.samples == 1000 and thin.rate == pytest.approx(50.0)
    np.testing.assert_allclose(thin.q[50:-50], log.q[::4][50:-50], atol=2e-4)
    half, share = stretch_of([log, log], 20.0)
    assert share == pytest.approx(0.5, rel=0.01) and [part.samples for part in half] == [2000, 2000]


def test_eight_rows_a_period_know_as_much_as_all(cell: Cell) -> None:
    """The covariance, and the estimate, of one row in five against those of all."""
    log = cell.log(torque=0.05)
    all_rows = replace(HOW, filter=Butterworth(5.0), rate_hz=None, rows_per_period=None)
    few = identify(cell.model, [log], "wls", replace(all_rows, rows_per_period=8.0))
    every = identify(cell.model, [log], "wls", all_rows)
    assert every.samples / few.samples == pytest.approx(5.0, rel=0.01)
    np.testing.assert_allclose(few.std, every.std, rtol=0.05)
    assert np.max(np.abs(few.beta - every.beta) / every.std) < 0.2


@pytest.mark.parametrize(
    ("errors", "best", "sharpest"),
    [
        ([(9.0, 0.0), (4.0, 0.5), (4.0, 2.0), (4.0, 9.0)], 1, 2),  # 6 is below twice 4.5, 13 is not
        ([(4.0, 0.0), (9.0, 0.0), (4.0, 0.0)], 0, 0),  # what lies beyond a bad one is not looked at
        ([(5.0, 0.0), (4.0, 0.0)], 1, 1),
    ],
)
def test_motion_is_imitated_with_the_detail_that_noise_leaves(
    errors: list[tuple[float, float]], best: int, sharpest: int
) -> None:
    assert choice.sharpest_of(errors, best) == sharpest


def test_a_cut_off_within_the_motion_does_not_win_by_its_own_small_torque() -> None:
    """At 1 Hz hardly any torque of the second parameter passes: only by what passes there it is the best."""

    def one(hertz: float, variances: list[float], gram: list[float]) -> CutoffCandidate:
        return CutoffCandidate(hertz, np.zeros(2), np.diag(variances), np.zeros(2), np.diag(gram))

    low, high, noisy = one(1, [0.1, 90.0], [1.0, 0.01]), one(4, [1.5, 1.5], [1.0, 1.0]), one(16, [4.0, 4.0], [1.0, 2.0])
    assert sum(low.error(low.gram)) < sum(high.error(low.gram)) < sum(noisy.error(low.gram))
    assert choice.metric_of([low, high, noisy]) is high.gram
