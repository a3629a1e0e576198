"""Preprocessing: each filter against its definition, and the rows that are left."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.signal
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from dynident.data.log import Log
from dynident.data.preprocessing import Preprocessing, at_rest, preprocess, resample
from dynident.data.preprocessing.butterworth import Butterworth, central_differences
from dynident.data.preprocessing.five_point import FivePoint, five_point_smoothing
from dynident.data.preprocessing.fourier_fit import FourierFit, fourier_basis
from dynident.errors import BadOption, LogMismatch
from dynident.excitation.trajectories.fourier import FourierSeries

SMALL = st.floats(-10, 10)


def log_of(q, rate=200.0, **signals):
    q = np.asarray(q, dtype=float)
    q = q[:, None] if q.ndim == 1 else q
    shaped = {name: np.asarray(values, dtype=float).reshape(q.shape) for name, values in signals.items()}
    return Log(tuple("abc"[: q.shape[1]]), np.arange(len(q)) / rate, q, **shaped)


def tone(hertz, samples=4000, rate=200.0):
    return np.sin(2 * np.pi * hertz * np.arange(samples) / rate)


# Five-point smoothing (17)


@given(arrays(float, st.tuples(st.integers(5, 40), st.just(3)), elements=SMALL))
def test_five_points_are_the_savitzky_golay_filter(signal):
    """The interior is a moving cubic fit over five samples; so are the ends, read off the last full fit."""
    expected = scipy.signal.savgol_filter(signal, 5, 3, axis=0, mode="interp")
    np.testing.assert_allclose(five_point_smoothing(signal), expected, atol=1e-12)


@given(arrays(float, 17, elements=SMALL), st.integers(1, 6))
def test_repeats_are_repeats(signal, repeats):
    expected = signal
    for _ in range(repeats):
        expected = five_point_smoothing(expected)
    np.testing.assert_array_equal(five_point_smoothing(signal, repeats), expected)


def test_the_five_point_filter_treats_positions_and_torques_alike():
    generator = np.random.default_rng(0)
    q, torque = generator.normal(size=(2, 60, 2))
    made = FivePoint(repeats=3).apply(log_of(q, torque=torque))
    np.testing.assert_array_equal(made.q, five_point_smoothing(q, 3))
    np.testing.assert_array_equal(made.torque, five_point_smoothing(torque, 3))
    np.testing.assert_array_equal(made.raw_torque, torque)
    np.testing.assert_allclose(made.dq[1:-1], (made.q[2:] - made.q[:-2]) * 100)
    np.testing.assert_allclose(made.ddq[1:-1], (made.dq[2:] - made.dq[:-2]) * 100)
    assert made.source.steps == ("five-point cubic smoothing, 3 times",)
    assert FivePoint(repeats=3).statement()["repeats"] == 3


# Butterworth


@given(arrays(float, (3, 2), elements=SMALL))
def test_central_differences_are_exact_on_parabolas(coefficients):
    t = np.arange(20) / 50
    parabola = np.vander(t, 3) @ coefficients
    exact = np.vander(t, 2) @ (coefficients[:2] * np.array([[2.0], [1.0]]))
    np.testing.assert_allclose(central_differences(parabola, 50.0), exact, atol=1e-10)


@pytest.mark.parametrize("order", [1, 2, 4, 7])
def test_butterworth_halves_the_cut_off_keeps_the_phase_and_the_mean(order):
    part = Butterworth(cutoff_hz=8.0, order=order)
    middle = slice(1000, 3000)  # whole periods of each tone, far from the ends

    def response(hertz):
        """Return the complex gain at a frequency, from the filtered tone alone."""
        wave = np.exp(2j * np.pi * hertz * np.arange(4000) / 200.0)
        out = part.smooth(np.stack([wave.real, wave.imag]), 200.0)
        return np.mean((out[0] + 1j * out[1])[middle] * wave.conj()[middle])

    for hertz in (1.0, 8.0, 12.0):
        warped = np.tan(np.pi * hertz / 200) / np.tan(np.pi * 8 / 200)  # of the bilinear transform
        exact = 1 / (1 + warped ** (2 * order))  # twice |H|, so squared
        assert response(hertz) == pytest.approx(exact, abs=2e-6)
    assert response(8.0).real == pytest.approx(0.5, abs=2e-6)
    np.testing.assert_allclose(part.smooth(np.full((1, 500), 3.7), 200.0), 3.7, rtol=1e-9)


def test_butterworth_filters_both_sides_or_only_positions():
    q, torque = tone(1.0), tone(2.0) + tone(45.0)
    log = log_of(q, torque=torque)
    both = Butterworth(cutoff_hz=6.0, positions_hz=30.0)
    made = both.apply(log)
    np.testing.assert_allclose(made.torque, both.smooth(log.torque.T, 200.0).T, atol=1e-12)
    np.testing.assert_allclose(made.torque[500:-500, 0], tone(2.0)[500:-500], atol=2e-3)
    np.testing.assert_array_equal(made.raw_torque, log.torque)
    only = Butterworth(cutoff_hz=6.0, torque="none")
    made = only.apply(log)
    np.testing.assert_array_equal(made.torque, log.torque)
    np.testing.assert_array_equal(only.smooth(log.torque.T, 200.0), log.torque.T)
    assert only.reach(200.0) == 0
    w = 2 * np.pi
    time = log.time[500:-500, None]
    np.testing.assert_allclose(made.dq[500:-500], w * np.cos(w * time), atol=5e-3)
    np.testing.assert_allclose(made.ddq[500:-500], -(w**2) * np.sin(w * time), atol=5e-2)
    assert both.apply(log_of(q)).torque is None


def test_the_cut_off_of_the_positions_follows_unless_stated():
    def stated(part, rate):
        return part.apply(log_of(tone(0.5, rate=rate), rate)).source.steps[0]

    assert stated(Butterworth(5.0), 200.0) == (
        "zero-phase Butterworth, order 4, positions at 25 Hz, both sides at 5 Hz"
    )
    assert stated(Butterworth(30.0), 200.0).startswith("zero-phase Butterworth, order 4, positions at 80 Hz")
    assert stated(Butterworth(5.0, positions_hz=9.0), 200.0).startswith(
        "zero-phase Butterworth, order 4, positions at 9 Hz"
    )
    assert stated(Butterworth(5.0, torque="none"), 200.0) == (
        "zero-phase Butterworth, order 4, positions at 5 Hz, torque raw"
    )
    assert Butterworth(5.0).statement() == {
        "kind": "butterworth",
        "cutoff_hz": 5.0,
        "order": 4,
        "torque": "same",
        "positions_hz": 25.0,
    }


@pytest.mark.parametrize("order", [1, 4, 9])
def test_beyond_its_reach_a_filter_feels_nothing(order):
    part = Butterworth(cutoff_hz=10.0, order=order)
    reach = part.reach(200.0)
    pulse = np.zeros((1, 4 * reach + 1))
    pulse[0, 2 * reach] = 1.0
    answer = np.abs(part.smooth(pulse, 200.0)[0])
    far = np.abs(np.arange(pulse.size) - 2 * reach) > reach
    assert np.max(answer[far]) < 1e-8 * np.max(answer)


# Fourier fit


def periodic_log(periods=4, noise=0.0, rate=100.0, seed=0):
    """Return a log of whole periods of a series, its torque a periodic signal, and both truths of one period."""
    generator = np.random.default_rng(seed)
    sine, cosine = generator.normal(size=(2, 2, 3))
    series = FourierSeries([0.3, -0.2], sine, cosine, 5.0)
    time = np.arange(round(periods * 5.0 * rate)) / rate
    q = series.evaluate(time)[0]
    torque = np.cos(q)
    noisy = q + noise * generator.normal(size=q.shape), torque + noise * generator.normal(size=q.shape)
    return log_of(noisy[0], rate, torque=noisy[1]), series


def test_a_fourier_fit_recovers_the_series_and_its_derivatives():
    log, series = periodic_log()
    made = FourierFit(period_s=5.0, harmonics=3, torque_repeats=0).apply(log)
    assert made.samples == 500
    for got, want in zip((made.q, made.dq, made.ddq), series.evaluate(made.time), strict=True):
        np.testing.assert_allclose(got, want, atol=1e-10)
    np.testing.assert_allclose(made.torque, np.cos(made.q), atol=1e-12)
    assert made.source.steps == (
        "4 periods of 5 s averaged, Fourier fit of 3 harmonics, torque smoothed 0 times by five points",
    )


def test_the_fit_is_the_least_squares_series_of_the_averaged_periods():
    log, _ = periodic_log(noise=0.1)
    made = FourierFit(period_s=5.0, harmonics=2).apply(log)
    averaged = log.q.reshape(4, 500, 2).mean(axis=0)
    basis = fourier_basis(made.time, 5.0, 2)[0]
    assert np.max(np.abs(basis.T @ (averaged - made.q))) < 1e-9  # the residual is orthogonal to the basis
    np.testing.assert_array_equal(made.torque, five_point_smoothing(log.torque.reshape(4, 500, 2).mean(axis=0), 10))


@pytest.mark.parametrize(("period", "rate"), [(10 / 3, 100.0), (2 * np.pi, 1000.0), (25.13274, 200.0)])
def test_periods_of_no_whole_number_of_samples_are_not_smeared(period, rate):
    """Linear interpolation errs by at most ddq h^2 / 8, averaging out of step by samples."""
    series = FourierSeries([0.1], [[0.5, 0.2, 0.1]], [[0.3, -0.2, 0.1]], period)
    time = np.arange(int(6 * period * rate) + 1) / rate
    q, dq, ddq = series.evaluate(time)
    made = FourierFit(period, harmonics=3, torque_repeats=0).apply(log_of(q, rate, torque=dq))
    assert "6 periods" in made.source.steps[-1]
    assert made.samples == round(period * rate)
    bound = np.abs(ddq).max() / rate**2 / 8
    again = series.evaluate(made.time)
    np.testing.assert_allclose(made.q, again[0], atol=bound)
    np.testing.assert_allclose(made.dq, again[1], atol=10 * bound)
    np.testing.assert_allclose(made.torque, again[1], atol=10 * bound)


@pytest.mark.parametrize("periods", [4, 16])
def test_averaging_periods_divides_noise_by_the_root_of_their_number(periods):
    log, _ = periodic_log(periods, noise=0.1)
    made = FourierFit(period_s=5.0, harmonics=3, torque_repeats=0).apply(log)
    clean, _ = periodic_log(periods)
    left = made.raw_torque - clean.torque[:500]
    assert np.std(left) == pytest.approx(0.1 / np.sqrt(periods), rel=0.1)  # 1000 samples: 2.2 %


# Resampling and rows


def test_uniform_time_is_left_alone():
    log = log_of(tone(1.0, 50))
    assert resample(log) is log
    late = Log(log.joints, 1.7e9 + log.time, log.q)  # an epoch: 0.24 us of rounding
    assert resample(late) is late


@settings(max_examples=30)
@given(st.integers(0, 2**32 - 1), st.floats(0.01, 0.9))
def test_resampling_is_exact_on_straight_lines_at_any_jitter(seed, jitter):
    generator = np.random.default_rng(seed)
    time = (np.arange(80) + jitter * generator.uniform(-0.5, 0.5, 80)) / 100
    q = np.column_stack([3.0 * time - 1.0, -0.5 * time])
    made = resample(Log(("a", "b"), time, q, torque=2 * q))
    np.testing.assert_allclose(np.diff(made.time), made.duration / (made.samples - 1), rtol=1e-9)
    assert made.time[0] == time[0]
    assert made.time[-1] == pytest.approx(time[-1], abs=1e-12)
    np.testing.assert_allclose(made.q, np.column_stack([3.0 * made.time - 1.0, -0.5 * made.time]), atol=1e-12)
    np.testing.assert_allclose(made.torque, 2 * made.q, atol=1e-12)


def test_resampling_says_what_it_did():
    time = np.arange(20) / 100.0
    time[7] += 0.004
    assert resample(Log(("a",), time, np.zeros((20, 1)))).source.steps == ("resampled to 100 Hz (steps of 6 to 14 ms)",)


def test_rows_are_trimmed_and_thinned_after_the_filter():
    log = log_of(tone(1.0, 1001), torque=tone(1.0, 1001))
    how = Preprocessing(FivePoint(), rate_hz=50.0, trim_s=0.5)
    prepared = preprocess(log, how)
    np.testing.assert_array_equal(prepared.keep, np.arange(100, 901, 4))  # both ends of the trim are rows
    np.testing.assert_array_equal(prepared.kept.q, FivePoint().apply(log).q[prepared.keep])
    assert prepared.log.samples == 1001
    assert "201 of 1001 samples kept" in prepared.kept.source.steps[-1]
    everything = preprocess(log, Preprocessing(FivePoint()))
    np.testing.assert_array_equal(everything.keep, np.arange(1001))
    np.testing.assert_array_equal(everything.kept.q, everything.log.q)


def test_a_prepared_log_filters_signals_as_it_filtered_the_torque():
    log = log_of(tone(1.0), torque=tone(3.0))
    prepared = preprocess(log, Preprocessing(Butterworth(5.0)))
    np.testing.assert_allclose(prepared.smooth(log.torque.T).T, prepared.log.torque, atol=1e-15)


def test_rest_is_being_slow_for_long_enough():
    rate = 100.0
    dq = np.column_stack([np.r_[np.ones(30), np.zeros(15), np.ones(30), np.zeros(5), np.ones(20)], np.ones(100)])
    expected = np.zeros((100, 2), dtype=bool)
    expected[30:45, 0] = True  # 0.15 s; the 0.05 s later on are a joint that turns round
    np.testing.assert_array_equal(at_rest(dq, 0.1, rate), expected)
    expected[75:80, 0] = True
    np.testing.assert_array_equal(at_rest(-dq, 0.1, rate, shortest=0.05), expected)
    assert not at_rest(dq, 0.0, rate).any()
    assert at_rest(np.zeros((20, 1)), 0.1, rate).all()


def test_a_statement_names_filter_and_rows():
    how = Preprocessing(FourierFit(5.0, 3), rate_hz=100.0, trim_s=0.2, standstill=0.01, rest="keep")
    assert how.statement() == {
        "kind": "fourier_fit",
        "cutoff_hz": 0.6,
        "order": 3,
        "torque": "period average, five-point smoothing 10 times",
        "rate_hz": 100.0,
        "trim_s": 0.2,
        "standstill": 0.01,
        "rest": "keep",
    }


# Refusals


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: FivePoint(repeats=0), "repeats = 0 is not possible; give 1 or more"),
        (lambda: Butterworth(cutoff_hz=0.0), "cutoff_hz = 0.0 is not possible; give a frequency in Hz above 0"),
        (lambda: Butterworth(positions_hz=-1.0), "positions_hz = -1.0 is not possible; give a frequency in Hz above 0"),
        (lambda: Butterworth(order=0), "order = 0 is not possible; give an order from 1 to 20"),
        (lambda: Butterworth(torque="all"), "torque = 'all' is not possible; choose 'same' or 'none'"),
        (lambda: FourierFit(period_s=0.0), "period_s = 0.0 is not possible; give the period in s"),
        (lambda: FourierFit(harmonics=0), "harmonics = 0 is not possible; give 1 or more"),
        (lambda: FourierFit(torque_repeats=-1), "torque_repeats = -1 is not possible; give 0 or more"),
        (
            lambda: Preprocessing(FivePoint(), rate_hz=0.0),
            "rate_hz = 0.0 is not possible; give the samples a second to keep, above 0",
        ),
        (lambda: Preprocessing(FivePoint(), trim_s=-1.0), "trim_s = -1.0 is not possible; give seconds, 0 or more"),
        (
            lambda: Preprocessing(FivePoint(), standstill=-1.0),
            "standstill = -1.0 is not possible; give a speed, 0 or more",
        ),
        (lambda: Preprocessing(FivePoint(), rest="drop"), "rest = 'drop' is not possible; choose 'mask' or 'keep'"),
    ],
)
def test_options_that_cannot_be(make, message):
    with pytest.raises(BadOption) as caught:
        make()
    assert str(caught.value) == message


@pytest.mark.parametrize(
    ("part", "log", "message"),
    [
        (FivePoint(), log_of(np.zeros(4)), "simulated log: 4 samples; five-point smoothing takes at least 5 samples"),
        (
            Butterworth(5.0, positions_hz=120.0),
            log_of(np.zeros(4000)),
            "simulated log: 200 samples a second cannot carry a cut-off of 120 Hz; choose a cut-off below 100 Hz",
        ),
        (
            Butterworth(1.0),
            log_of(np.zeros(600)),
            "simulated log: 600 samples are too few for a cut-off of 1 Hz; it takes more than 600; give a longer log",
        ),
        (
            Butterworth(5.0),
            log_of(np.zeros(600), rate=2e5),
            "simulated log: steps of 5e-06 s, 0.00299 s in all; no log is as fast: is the time of this file in another "
            "unit than units: {time: ...} of the case says?",
        ),
        (
            Butterworth(1e-300),
            log_of(np.zeros(600)),
            "simulated log: 600 samples are too few for a cut-off of 1e-300 Hz; it takes more than 6e+302; "
            "give a longer log",
        ),
        (
            FourierFit(period_s=25.0),
            log_of(np.zeros(500)),
            "simulated log: 2.495 s at 200 Hz hold no whole period of 25 s; "
            "state the period of the excitation, or choose another filter",
        ),
        (
            FourierFit(period_s=0.001),
            log_of(np.zeros(500)),
            "simulated log: 2.495 s at 200 Hz hold no whole period of 0.001 s; "
            "state the period of the excitation, or choose another filter",
        ),
        (
            FourierFit(period_s=0.05),
            log_of(np.zeros(500)),
            "simulated log: 2.495 s at 200 Hz hold no whole period of 0.05 s with 5 harmonics; "
            "state the period of the excitation, or choose another filter",
        ),
    ],
)
def test_logs_that_a_filter_cannot_take(part, log, message):
    with pytest.raises(LogMismatch) as caught:
        part.apply(log)
    assert str(caught.value) == message


@pytest.mark.parametrize(
    ("time", "message"),
    [
        (np.arange(9) / 100, "simulated log: only 9 samples; an identification needs seconds of motion"),
        (
            np.r_[np.arange(10) / 100, 0.05],
            "simulated log: time does not run forward at sample 11 (0.09 to 0.05 s); "
            "sort the rows or remove the repeated ones",
        ),
        (
            np.r_[np.arange(10) / 100, 1.7e9],
            "simulated log: a gap of 1.7e+09 s after sample 10, 0.09 s from its start; split the log there",
        ),
    ],
)
def test_time_that_cannot_be_made_uniform(time, message):
    with pytest.raises(LogMismatch) as caught:
        resample(Log(("a",), time, np.zeros((len(time), 1))))
    assert str(caught.value) == message


@pytest.mark.parametrize("lost_s", [0.3, 2.0])
def test_rows_near_a_bridged_gap_are_left_out_and_the_others_stand(lost_s):
    """The filter of the whole motion, at the rows that are kept of one whose middle was lost, also when thinned out."""
    whole = log_of(np.stack([tone(0.7), tone(1.1)], axis=1), torque=np.stack([tone(0.9), tone(1.7)], axis=1))
    lost = np.flatnonzero((whole.time < 9.0) | (whole.time >= 9.0 + lost_s))
    how = Preprocessing(Butterworth(5.0), trim_s=0.5, longest_gap_s=2.1)
    broken = whole.rows(lost, "the middle lost")
    made, full = preprocess(broken, how), preprocess(whole, how)
    near = (made.log.time[made.keep] > 8.85) & (made.log.time[made.keep] < 9.15 + lost_s)
    assert not near.any() and len(full.keep) - len(made.keep) == pytest.approx(200 * (lost_s + 0.4), abs=4)
    kept = np.searchsorted(full.log.time, made.log.time[made.keep] - 1e-9)
    for name in ("q", "dq", "torque"):
        np.testing.assert_allclose(getattr(made.kept, name), getattr(full.log, name)[kept], atol=0.02)
    even = resample(broken, 2.1)
    np.testing.assert_allclose(even.gaps, [[8.995, 9.0 + lost_s]])
    again = preprocess(even.rows(slice(None, None, 2), "every other"), how)
    assert not np.any((again.kept.time > 8.85) & (again.kept.time < 9.15 + lost_s))


def test_a_longer_gap_is_refused_with_what_bridges_it():
    whole = log_of(tone(0.7), torque=tone(0.9))
    broken = whole.rows((whole.time < 5.0) | (whole.time >= 7.0), "the middle lost")
    with pytest.raises(LogMismatch) as caught:
        preprocess(broken, Preprocessing(Butterworth(5.0)))
    assert str(caught.value) == (
        "simulated log: a gap of 2.005 s after sample 1000, 4.995 s from its start; "
        "leave the samples near it out (preprocessing: {longest_gap_s: 2.2}), or split the log there"
    )
    assert len(preprocess(broken, Preprocessing(Butterworth(5.0), longest_gap_s=2.2)).keep) > 3000
    with pytest.raises(BadOption, match="longest_gap_s = 0 is not possible; give seconds, above 0"):
        Preprocessing(Butterworth(5.0), longest_gap_s=0)


def test_the_motion_before_a_part_begins_after_the_last_gap():
    """A log of two motions a minute apart, split in the pause: nothing is known of what came just before the second."""
    whole = log_of(tone(0.7), torque=tone(0.9))
    apart = replace(whole, time=np.where(np.arange(whole.samples) < 1500, whole.time, whole.time + 60.0))
    how = Preprocessing(Butterworth(5.0))
    for start, before in ((1500, 0), (2000, 501)):
        part = apart.part(start, whole.samples, "the second motion")
        found = preprocess(part, how).log.before
        assert (0 if found is None else found.samples) == before
    with pytest.raises(LogMismatch, match="a gap of 60"):
        preprocess(apart.part(1000, whole.samples, "both"), how)


def test_a_trim_that_leaves_nothing():
    with pytest.raises(LogMismatch) as caught:
        preprocess(log_of(np.zeros(100)), Preprocessing(FivePoint(), trim_s=3.0))
    assert str(caught.value) == (
        "simulated log: its 0.495 s are too short: 0 of 100 samples are left after 3 s trimmed at each end; "
        "give a longer log, or trim less"
    )
