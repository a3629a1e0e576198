"""Delays between torque and positions: found, applied, kept with the estimate, and left alone where there is none."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dynident.data.log import Log
from dynident.data.preprocessing import Preprocessing, preprocess
from dynident.data.preprocessing._local_polynomials import fractional_shift, shifted
from dynident.data.preprocessing.as_given import AsGiven
from dynident.data.preprocessing.butterworth import Butterworth
from dynident.errors import BadOption
from dynident.identification.files.estimate_file import read_estimate, write_estimate
from dynident.identification.identify import identify
from dynident.identification.problem.choices import DelayRecord
from dynident.identification.problem.regressor_stream import RegressorStream
from dynident.identification.selection.delay import common_delay, find_delays
from dynident.identification.selection.delay_rows import RANGE, DelayRows
from dynident.identification.validate import validate
from dynident.model.base_parameters import base_parameters
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import FRICTION, Motion
from dynident.model.robot import Robot

RATE = 200.0
AUTO = Preprocessing(Butterworth(cutoff_hz=8.0), rate_hz=50.0, trim_s=0.3, delay_s=None)

ExactMotion = Callable[..., Motion]


@pytest.fixture(scope="module")
def model(spatial_3r: Robot) -> DynamicModel:
    return DynamicModel(spatial_3r, tuple(FRICTION.make(name) for name in ("coulomb", "viscous", "offset")))


@pytest.fixture(scope="module")
def late(model: DynamicModel, exact_motion: ExactMotion) -> Callable[..., Log]:
    """Make a log whose torque is late by some samples, with noise of a twentieth of a percent to two."""
    assert model.robot.nominal is not None
    theta = np.append(model.robot.nominal, np.linspace(0.1, 0.5, 9))

    def make(samples: float, noise: float = 0.01, seed: int = 0, start: float = 0.0) -> Log:
        time = start + np.arange(2400) / RATE
        at_torque, measured = (exact_motion(3, time - lag, 1.0, seed=11) for lag in (samples / RATE, 0.0))
        torque = model.torque(at_torque, theta)
        torque = torque + noise * np.std(torque, axis=0) * np.random.default_rng(seed).normal(size=torque.shape)
        return Log(model.robot.joint_names, time, measured.q, torque=torque)

    return make


@pytest.mark.parametrize("samples", [0.3, -1.6, 4.0, 20.0])
def test_a_delay_is_found_to_a_tenth_of_a_sample(model: DynamicModel, late: Callable[..., Log], samples: float) -> None:
    log = late(samples)
    estimate = identify(model, [log], "wls", AUTO)
    (found,) = estimate.choices.delays
    assert found.seconds * RATE == pytest.approx(samples, abs=0.1)
    assert found.applied == found.seconds and 0 < found.std * RATE < 0.1
    blind = identify(model, [log], "wls", replace(AUTO, delay_s=0.0))
    assert estimate.train.total_relative_error < 0.9 * blind.train.total_relative_error
    stated = identify(model, [log], "wls", replace(AUTO, delay_s=samples / RATE))
    assert stated.train.total_relative_error == pytest.approx(estimate.train.total_relative_error, rel=0.02)


def test_no_delay_is_left_alone(model: DynamicModel, late: Callable[..., Log]) -> None:
    log = late(0.0)
    estimate, plain = (identify(model, [log], "wls", replace(AUTO, delay_s=each)) for each in (None, 0.0))
    (found,) = estimate.choices.delays
    assert abs(found.seconds) * RATE < 0.1
    if not found.applied:
        np.testing.assert_array_equal(estimate.beta, plain.beta)
    assert estimate.train.total_relative_error == pytest.approx(plain.train.total_relative_error, rel=0.01)


def test_each_log_has_its_own_and_others_the_common_one(
    model: DynamicModel, late: Callable[..., Log], tmp_path: Path
) -> None:
    estimate = identify(model, [late(2.0, seed=1), late(3.0, seed=2, start=5.0)], "wls", AUTO)
    found = [each.applied * RATE for each in estimate.choices.delays]
    assert found == pytest.approx([2.0, 3.0], abs=0.1)
    common = estimate.preprocessing.delay_s
    assert common is not None and common * RATE == pytest.approx(2.5, abs=0.1)
    write_estimate(estimate, tmp_path / "late.json")
    again = read_estimate(tmp_path / "late.json")
    assert again.preprocessing == estimate.preprocessing
    unseen = late(2.5, seed=3, start=3.0)
    good = validate(again, [unseen]).total_relative_error
    assert good == validate(estimate, [unseen]).total_relative_error
    assert good < 0.8 * validate(again, [unseen], replace(again.preprocessing, delay_s=0.0)).total_relative_error


def test_friction_that_turns_before_the_speed_is_no_delay(model: DynamicModel, exact_motion: ExactMotion) -> None:
    """Drives stick at reversals: their friction follows the torque there, so it turns ahead of the speed."""
    assert model.robot.nominal is not None
    time = np.arange(4000) / RATE
    motion, ahead = (exact_motion(3, time + lead, 1.0, seed=12) for lead in (0.0, 0.03))
    bodies = model.torque(motion, np.append(model.robot.nominal, np.zeros(9)))
    friction = 0.3 * np.std(bodies, axis=0) * np.tanh(ahead.dq / 0.01)
    noise = 0.01 * np.std(bodies, axis=0) * np.random.default_rng(2).normal(size=bodies.shape)
    log = Log(model.robot.joint_names, time, motion.q, torque=bodies + friction + noise)
    (found,) = identify(model, [log], "wls", AUTO).choices.delays
    assert abs(found.applied) * RATE < 0.1
    assert abs(found.seconds) < 3 * found.std


@pytest.mark.parametrize(("trim", "samples"), [(0.3, -1.6), (0.0, 20.0)])
def test_a_search_makes_the_rows_once_and_again_where_the_delay_leaves_their_range(
    model: DynamicModel, late: Callable[..., Log], monkeypatch: pytest.MonkeyPatch, trim: float, samples: float
) -> None:
    made = []
    segments = RegressorStream.segments
    monkeypatch.setattr(RegressorStream, "segments", lambda *given: made.append(given) or segments(*given))
    how = replace(AUTO, trim_s=trim)
    logs = [late(samples), late(samples, seed=1, start=5.0)]
    delays, prepared = find_delays(model, base_parameters(model), [preprocess(log, how) for log in logs])
    assert len(made) == (len(logs) if abs(samples) / RATE < max(trim, RANGE) else 2 * len(logs))
    for delay, log in zip(delays, prepared, strict=True):
        assert delay.applied * RATE == pytest.approx(samples, abs=0.1)
        assert log.delay_s == delay.applied


def test_a_torque_moved_by_a_known_time_moves_the_delay_by_it(
    model: DynamicModel, late: Callable[..., Log], monkeypatch: pytest.MonkeyPatch
) -> None:
    def found(log: Log) -> DelayRecord:
        return find_delays(model, base_parameters(model), [preprocess(log, AUTO)])[0][0]

    log = late(1.3, noise=0.05)
    moved = replace(log, torque=fractional_shift(np.asarray(log.torque), 2.45))
    first, second = found(log), found(moved)
    assert (second.seconds - first.seconds) * RATE == pytest.approx(2.45, abs=0.02)
    assert second.std == pytest.approx(first.std, rel=0.05)
    monkeypatch.setattr("dynident.identification.selection.delay.MOST", 500)
    monkeypatch.setattr("dynident.identification.selection.delay_rows.STRETCH", 100)
    fewer = found(log)
    assert abs(fewer.seconds - first.seconds) < 4 * fewer.std and fewer.std > first.std


def test_rows_tell_slopes_and_torques_between_samples(
    model: DynamicModel, late: Callable[..., Log], exact_motion: ExactMotion
) -> None:
    """With the oracle of a motion that is known at any time; rows near a gap tell none."""
    log = late(0.0, noise=0.0)
    prepared = preprocess(log, replace(AUTO, delay_s=0.0))
    rows = DelayRows(RegressorStream(model, base_parameters(model)), prepared, -RANGE, RANGE)
    at = log.time[prepared.keep]
    motion = exact_motion(3, at, 1.0, seed=11)
    told = rows.counting.all(axis=1)
    assert not told[:4].any() and told[4:-4].all()
    np.testing.assert_allclose(rows.slope(motion.q)[told], motion.dq[told], atol=1e-3 * np.abs(motion.dq).max())
    split = DelayRows(
        RegressorStream(model, base_parameters(model)),
        replace(prepared, keep=np.delete(prepared.keep, np.s_[100:110])),
        -RANGE,
        RANGE,
    )
    lost = np.flatnonzero(~split.counting[4:-4].any(axis=1)) + 4
    np.testing.assert_array_equal(lost, np.arange(96, 104))


def test_rows_beside_other_friction_are_those_made_afresh(model: DynamicModel, late: Callable[..., Log]) -> None:
    prepared = preprocess(late(0.0), replace(AUTO, delay_s=0.0))
    more = replace(model, friction=(*model.friction, FRICTION.make("stribeck")))
    plain, other = (RegressorStream(each, base_parameters(each)) for each in (model, more))
    before = DelayRows(plain, prepared, -RANGE, RANGE)
    afresh = DelayRows(other, prepared, -RANGE, RANGE)
    for known in (before, DelayRows(plain, prepared, -2.0 * RANGE, RANGE)):  # the second has fewer rows
        for found, expected in zip(
            DelayRows(other, prepared, -RANGE, RANGE, before=known).blocks, afresh.blocks, strict=True
        ):
            np.testing.assert_allclose(found, expected, atol=1e-13)


def test_the_surest_delay_counts_most() -> None:
    delays = (DelayRecord("a", 1e-3, 1e-4, 1e-3), DelayRecord("b", 2e-3, 2e-4, 2e-3))
    assert common_delay(delays) == pytest.approx((4 * 1e-3 + 2e-3) / 5)
    with np.errstate(all="raise"):  # of logs that tell nothing, as where no joint moves
        assert common_delay([DelayRecord("still", 0.0, np.inf, 0.0)] * 2) == 0.0


@settings(deadline=None)
@given(st.floats(-25.0, 25.0), st.floats(0.0, 0.1))
def test_a_tone_is_shifted_by_any_part_of_a_sample(samples: float, frequency: float) -> None:
    index = np.arange(200)
    tone, moved = (np.sin(2 * np.pi * frequency * (index - lag)) for lag in (0.0, samples))
    found = fractional_shift(tone[:, None], samples)[:, 0]
    np.testing.assert_allclose(found[40:-40], moved[40:-40], atol=1e-4)
    rows = np.arange(0, 200, 7)
    np.testing.assert_array_equal(fractional_shift(tone[:, None], samples, rows)[:, 0], found[rows])


@given(st.integers(-30, 30))
def test_whole_samples_are_moved_as_they_are(samples: int) -> None:
    signal = np.random.default_rng(0).normal(size=(50, 2))
    index = np.clip(np.arange(50) - samples, 0, 49)
    np.testing.assert_array_equal(fractional_shift(signal, float(samples)), signal[index])


def test_motion_moves_torque_and_time_stay(exact_motion: ExactMotion) -> None:
    time = np.arange(600) / 100.0
    motion = exact_motion(2, time, 1.0, seed=3)
    log = Log(("a", "b"), time, motion.q, motion.dq, motion.ddq, torque=motion.q)
    moved = shifted(log, 0.0123)
    earlier = exact_motion(2, time - 0.0123, 1.0, seed=3)
    for name in ("q", "dq", "ddq"):
        np.testing.assert_allclose(getattr(moved, name)[10:-10], getattr(earlier, name)[10:-10], atol=1e-6)
    np.testing.assert_array_equal(moved.torque, log.torque)
    assert moved.source.steps[-1] == "motion shifted by 12.3 ms to align it with the torque"
    kept = preprocess(log, Preprocessing(AsGiven(), delay_s=0.05))
    assert kept.log.time[kept.keep[0]] >= 0.05 and kept.delay_s == 0.05
    assert kept.statement()["delay_s"] == 0.05 and "delay_s" not in Preprocessing(AsGiven()).statement()


@pytest.mark.parametrize("value", [2.0, np.nan, -np.inf])
def test_a_delay_that_is_none(value: float) -> None:
    with pytest.raises(BadOption, match=r"delay_s = .*give seconds between"):
        Preprocessing(AsGiven(), delay_s=value)
