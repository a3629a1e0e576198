"""Sensitivity to the cut-off: quiet where the model is right, loud where an error grows with the frequency."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from dynident.data.log import Log
from dynident.data.preprocessing import Preprocessing, default_preprocessing
from dynident.data.preprocessing.as_given import AsGiven
from dynident.data.preprocessing.butterworth import Butterworth
from dynident.diagnosis.warnings import warnings_of
from dynident.identification.estimate.estimate import Estimate
from dynident.identification.files.estimate_file import read_estimate, summary, write_estimate
from dynident.identification.identify import identify
from dynident.identification.uncertainty.trust import TrustOptions
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction.coulomb import Coulomb
from dynident.model.friction.viscous import Viscous
from dynident.model.robot import Robot
from dynident.results.choices import cutoff_lines

HOW = replace(default_preprocessing(), filter=Butterworth(6.0))


@pytest.fixture(scope="module")
def model(planar_2r: Robot) -> DynamicModel:
    return DynamicModel(planar_2r, (Coulomb(0.05), Viscous()))


@pytest.fixture(scope="module")
def log(model: DynamicModel, exact_log: Callable[..., Log]) -> Log:
    theta = np.append(model.robot.nominal, np.tile([0.5, 0.3], 2))
    return replace(exact_log(model, theta, noise=0.3, samples=4000, rate=200.0), dq=None, ddq=None)


def sensitive(model: DynamicModel, log: Log, how: Preprocessing = HOW) -> Estimate:
    return identify(model, [log], "wls", how, trust=TrustOptions(sensitivity=True))


def test_a_right_model_moves_by_chance_alone(model: DynamicModel, log: Log) -> None:
    estimate = sensitive(model, log)
    found = estimate.choices.cutoff_sensitivity
    assert found is not None
    assert [row.cutoff_hz for row in found.table] == [3.0, 6.0, 12.0]
    own = found.table[1]
    assert own.largest_change == 0.0
    assert all(row.beyond_chance < 3 for row in found.table)
    # held out at its own cut-off: noise through the filter, which the fit cannot remove
    assert own.cross_validation_error == pytest.approx(estimate.train.total_relative_error, rel=0.1)
    assert not any("moves by" in warning for warning in warnings_of(estimate))


def test_changes_are_those_of_fits_at_the_other_cut_offs(model: DynamicModel, log: Log) -> None:
    estimate = sensitive(model, log)
    found = estimate.choices.cutoff_sensitivity
    assert found is not None
    for row in found.table:
        other = identify(model, [log], "wls", replace(HOW, filter=Butterworth(row.cutoff_hz)))
        change = (other.beta - estimate.beta) / estimate.std
        np.testing.assert_allclose(row.changes, change, atol=0.15)
        assert row.largest_change == pytest.approx(np.abs(row.changes).max())


def test_a_log_whose_motion_is_in_one_block_alone_has_no_table(model: DynamicModel, log: Log) -> None:
    """Without that block the rows determine nothing: a raw LinAlgError before."""
    q = np.where(np.arange(len(log.q))[:, None] < 3400, log.q[3400], log.q)
    assert sensitive(model, replace(log, q=q)).choices.cutoff_sensitivity is None


def test_noise_of_the_positions_that_biases_is_told(model: DynamicModel, log: Log) -> None:
    noisy = replace(log, q=log.q + 1e-3 * np.random.default_rng(0).normal(size=log.q.shape))
    estimate = sensitive(model, noisy)
    (warning,) = [text for text in warnings_of(estimate) if "moves by" in text]
    assert "standard deviations where the cut-off is 12 Hz" in warning
    assert ("intervals allow for it" in warning) == (estimate.choices.position_noise is None)


def test_what_moves_beyond_chance_enters_the_intervals_and_nothing_else(
    model: DynamicModel, log: Log, exact_log: Callable[..., Log]
) -> None:
    """Friction whose sign turns faster than the model's was up to 5.6 of its standard deviations off."""
    theta = np.append(model.robot.nominal, np.tile([0.5, 0.3], 2))
    noisy = replace(log, q=log.q + 1e-3 * np.random.default_rng(0).normal(size=log.q.shape))
    sharp = DynamicModel(model.robot, (Coulomb(0.001), Viscous()))
    turning = replace(exact_log(sharp, theta, noise=0.03, samples=4000, rate=200.0), dq=None, ddq=None)
    for one, is_wrong in ((log, False), (noisy, False), (turning, True)):
        plain, estimate = identify(model, [one], "wls", HOW), sensitive(model, one)
        np.testing.assert_array_equal(plain.beta, estimate.beta)
        error, wider = np.abs(estimate.beta - estimate.base.from_standard(theta)), estimate.std > 1.01 * plain.std
        assert np.count_nonzero(wider) == 3 * is_wrong and np.all(estimate.std[~wider] == plain.std[~wider])
        if is_wrong:
            assert np.max(error[wider] / plain.std[wider]) > 5.0
            assert np.max(error[wider] / estimate.std[wider]) < 2.0


def test_lines_json_and_file(model: DynamicModel, log: Log, tmp_path) -> None:  # type: ignore[no-untyped-def]
    estimate = sensitive(model, log)
    (line,) = cutoff_lines(estimate.choices)
    assert line.startswith("held-out error on blocks of the training data: ") and "at 12 Hz (" in line
    assert summary(estimate)["extras"]["cutoff_sensitivity"]["folds"] == 5
    write_estimate(estimate, tmp_path / "e.json")
    again = read_estimate(tmp_path / "e.json")
    assert cutoff_lines(again.choices) == [line] and again.preprocessing == estimate.preprocessing
    chosen = identify(model, [log], "wls", trust=TrustOptions(sensitivity=True))
    assert len(cutoff_lines(chosen.choices)) == 2


def test_nothing_is_said_without_a_cut_off_or_beyond_the_log(
    model: DynamicModel, exact_log: Callable[..., Log]
) -> None:
    theta = np.append(model.robot.nominal, np.tile([0.5, 0.3], 2))
    given = exact_log(model, theta, noise=0.1)
    assert sensitive(model, given, Preprocessing(AsGiven())).choices.cutoff_sensitivity is None
    assert identify(model, [given], "wls", Preprocessing(AsGiven())).choices.cutoff_sensitivity is None
    high = sensitive(model, given, replace(HOW, filter=Butterworth(15.0)))  # 50 samples a second
    found = high.choices.cutoff_sensitivity
    assert found is not None and [row.cutoff_hz for row in found.table] == [7.5, 15.0]
