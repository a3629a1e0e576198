"""What every filter must do, whoever writes it: one battery for the whole folder."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from dynident.arrays import Array
from dynident.data.log import Log
from dynident.data.preprocessing import FILTERS
from dynident.data.preprocessing.base import Filter
from dynident.errors import LogMismatch

PARTS = FILTERS.names()
RATE = 20.0
TIME = np.arange(1000) / RATE  # two periods of 25 s, the default of the periodic part

#: Parts that take the motion for periodic: a straight line is no motion of theirs.
PERIODIC = {"fourier_fit"}


@pytest.fixture(params=PARTS)
def part(request: pytest.FixtureRequest) -> Filter:
    return FILTERS.make(request.param)


def log_of(q: Array, dq: Array, ddq: Array, torque: Array) -> Log:
    """Return a log of two joints that move alike."""

    def two(signal: Array) -> Array:
        return np.column_stack([signal, -0.5 * signal])

    return Log(("a", "b"), TIME, two(q), two(dq), two(ddq), two(torque))


def swing() -> Log:
    """Return a slow periodic motion, two periods long."""
    w = 2 * np.pi / 25 * np.array([1, 2, 3])
    phase = np.outer(TIME, w)
    height = np.array([0.5, -0.3, 0.2])
    q, dq, ddq = np.sin(phase) @ height, np.cos(phase) @ (w * height), -np.sin(phase) @ (w**2 * height)
    return log_of(q, dq, ddq, 10 * q + 3 * dq)


def test_the_signals_that_come_out(part: Filter) -> None:
    log = swing()
    found = part.apply(log)
    assert found.joints == log.joints and len(found.source.steps) == len(log.source.steps) + 1
    for name in ("q", "dq", "ddq", "torque", "raw_torque"):
        values = getattr(found, name)
        assert values is not None and values.shape == (found.samples, 2) and np.all(np.isfinite(values)), name
    np.testing.assert_allclose(np.diff(found.time), 1 / RATE)


def test_a_slow_motion_passes_with_its_derivatives(part: Filter) -> None:
    """Slow against every pass band: positions to 1e-4, velocities 1e-3, accelerations 1e-2, away from the ends."""
    log = swing()
    found = part.apply(log)
    inside = slice(40, found.samples - 40)
    for name, tolerance in (("q", 1e-4), ("dq", 1e-3), ("ddq", 1e-2), ("torque", 1e-3)):
        true, values = getattr(log, name)[: found.samples], getattr(found, name)
        size = np.abs(true).max()
        np.testing.assert_allclose(values[inside] / size, true[inside] / size, atol=tolerance, err_msg=name)


def test_constant_signals_stay_constant(part: Filter) -> None:
    ones = np.ones_like(TIME)
    found = part.apply(log_of(0.7 * ones, 0 * ones, 0 * ones, 12.0 * ones))
    np.testing.assert_allclose(found.q, np.outer(np.ones(found.samples), [0.7, -0.35]), atol=1e-10)
    np.testing.assert_allclose(np.asarray(found.dq), 0, atol=1e-8)
    np.testing.assert_allclose(np.asarray(found.ddq), 0, atol=1e-6)
    np.testing.assert_allclose(np.asarray(found.torque), np.outer(np.ones(found.samples), [12, -6]), atol=1e-9)


def test_a_straight_motion_stays_straight(part: Filter) -> None:
    if FILTERS.name_of(part) in PERIODIC:
        pytest.skip("a straight line is not periodic")
    ones = np.ones_like(TIME)
    found = part.apply(log_of(0.3 + 0.02 * TIME, 0.02 * ones, 0 * ones, 5 * TIME))
    inside = slice(40, -40)
    np.testing.assert_allclose(found.q[inside, 0], (0.3 + 0.02 * TIME)[inside], atol=1e-9)
    np.testing.assert_allclose(np.asarray(found.dq)[inside, 0], 0.02, atol=1e-6)
    np.testing.assert_allclose(np.asarray(found.ddq)[inside], 0, atol=1e-5)
    np.testing.assert_allclose(np.asarray(found.torque)[inside, 0], 5 * TIME[inside], atol=1e-6)


def test_both_sides_pass_the_same_filter(part: Filter) -> None:
    """What ``smooth`` does to a signal is what ``apply`` did to the torque, or nothing at all."""
    generator = np.random.default_rng(0)
    log = replace(swing(), torque=generator.normal(size=(1000, 2)))
    found = part.apply(log)
    assert found.raw_torque is not None
    if part.reach(RATE):
        smooth = part.smooth(found.raw_torque.T, found.rate).T
        np.testing.assert_allclose(np.asarray(found.torque), smooth, atol=1e-12)
        np.testing.assert_array_equal(found.raw_torque, np.asarray(log.torque))
    else:
        signals = generator.normal(size=(3, 50))
        np.testing.assert_array_equal(part.smooth(signals, RATE), signals)


def test_smooth_is_linear_and_looks_no_further_than_it_says(part: Filter) -> None:
    generator = np.random.default_rng(1)
    one, other = generator.normal(size=(2, 2, 1000))
    both = part.smooth(2 * one - 3 * other, RATE)
    np.testing.assert_allclose(both, 2 * part.smooth(one, RATE) - 3 * part.smooth(other, RATE), atol=1e-10)
    np.testing.assert_allclose(part.smooth(np.ones((1, 1000)), RATE), 1.0, atol=1e-10)
    reach = part.reach(RATE)
    impulse = np.zeros((1, 1000))
    impulse[0, 500] = 1.0
    answer = part.smooth(impulse, RATE)[0]
    assert np.abs(answer[: 500 - reach]).max() < 1e-8 and np.abs(answer[501 + reach :]).max() < 1e-8


def test_the_statement_says_what_stands_beside_every_figure(part: Filter) -> None:
    statement = part.statement()
    assert {"kind", "cutoff_hz", "order", "torque"} <= set(statement)
    assert statement["kind"] == FILTERS.name_of(part)
    assert json.loads(json.dumps(statement, allow_nan=False)) == statement
    assert statement["cutoff_hz"] is None or float(str(statement["cutoff_hz"])) > 0


def test_apply_is_a_pure_function(part: Filter) -> None:
    log = swing()
    before = {name: np.array(values) for name, values in log.signals().items()}
    one, again = part.apply(log), part.apply(log)
    for name, values in before.items():
        np.testing.assert_array_equal(getattr(log, name), values)
    for name, values in one.signals().items():
        np.testing.assert_array_equal(values, getattr(again, name))
    assert one.source == again.source


def test_torques_may_be_missing(part: Filter) -> None:
    found = part.apply(replace(swing(), torque=None))
    assert found.torque is None and found.raw_torque is None and found.dq is not None


def test_a_log_that_is_too_short_is_refused_or_whole(part: Filter) -> None:
    log = swing()
    short = log.rows(slice(0, 4), "short")
    if FILTERS.name_of(part) == "as_given":
        assert part.apply(short).samples == 4
        return
    with pytest.raises(LogMismatch, match="simulated log: "):
        part.apply(short)


def test_a_window_with_the_stated_span_to_either_side_is_filtered_as_the_whole(part: Filter) -> None:
    time = np.arange(6000) / RATE
    noise = np.random.default_rng(0).normal(size=(2, 6000, 2))
    log = Log(("a", "b"), time, np.sin(np.outer(time, [1.0, 1.7])) + 1e-3 * noise[0], torque=noise[1])
    log = replace(log.with_step("derivatives"), dq=np.gradient(log.q, axis=0) * RATE, ddq=0.0 * log.q)
    span = part.span(RATE)
    if span is None:
        pytest.skip("it needs the whole log")
    start, stop = 2500, 3000
    window = log.rows(slice(start - span, stop + span), "window")
    whole, found = part.apply(log), part.apply(replace(window, time=np.arange(window.samples) / RATE))
    for name in ("q", "dq", "ddq", "torque"):
        wanted, got = getattr(whole, name)[start:stop], getattr(found, name)[span : span + stop - start]
        assert np.abs(got - wanted).max() <= 1e-9 * np.abs(wanted).max()
