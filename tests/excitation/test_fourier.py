"""Trajectories: equation (14) as written, derivatives against each other, and the run-in from rest."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from dynident.errors import BadOption
from dynident.excitation.trajectories.fourier import FourierSeries
from dynident.excitation.trajectories.quintic import Quintic
from dynident.studies.er16_article import BETA_1, BETA_2, PERIOD

SMALL = st.floats(-2.0, 2.0)


def random_series(seed=0, joints=3, harmonics=4, period=7.0):
    generator = np.random.default_rng(seed)
    sine, cosine = generator.normal(size=(2, joints, harmonics))
    return FourierSeries(generator.normal(size=joints), sine, cosine, period)


def test_positions_are_equation_14_term_by_term():
    series = random_series()
    for t in (0.0, 0.3, 5.1, -2.0, 40.0):
        for i in range(3):
            w = 2 * np.pi / 7.0
            q = series.offset[i]
            for k in range(1, 5):
                q += series.sine[i, k - 1] * np.sin(k * w * t) + series.cosine[i, k - 1] * np.cos(k * w * t)
            assert series.evaluate(t)[0][0, i] == pytest.approx(q, abs=1e-13)


@given(arrays(float, (3, 11), elements=SMALL), st.floats(0.5, 50.0))
def test_rows_go_in_and_come_out(rows, period):
    series = FourierSeries.from_table(list(rows), period)
    assert (series.joints, series.harmonics, series.duration, series.periodic) == (3, 5, period, True)
    np.testing.assert_array_equal(series.table, rows)
    np.testing.assert_array_equal(series.sine[:, 0], rows[:, 1])  # offset, a_1.., then b_1..
    np.testing.assert_array_equal(series.cosine[:, 0], rows[:, 6])


def test_the_articles_excitation_stays_where_its_reading_says_and_starts_moving():
    """Facts of the reading offset, a_1..a_5, b_1..b_5 of (A.1): range of the joints, and speeds at the start."""
    series = FourierSeries.from_table(BETA_1, PERIOD)
    q, dq, _ = series.evaluate(np.arange(25_000) / 1000)
    assert np.degrees(q.min()) == pytest.approx(-95, abs=1)
    assert np.degrees(q.max()) == pytest.approx(121, abs=1)
    np.testing.assert_allclose(dq[0], [-1.33, 0.66, 0.33], atol=0.005)
    assert FourierSeries.from_table(BETA_2, PERIOD).harmonics == 3


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ([], "row 1 = [] is not possible; give an odd number of values: offset, a_1..a_H, b_1..b_H"),
        ([[1.0, 2.0]], "row 1 = [2] is not possible; give an odd number of values: offset, a_1..a_H, b_1..b_H"),
        ([[1.0] * 11, [1.0] * 11, [1.0] * 10], "row 3 = '10 values' is not possible; give 11 as in row 1"),
        ([[1.0, np.nan, 0.0]], "sine = nan is not possible; give finite numbers"),
    ],
)
def test_tables_that_are_none(rows, message):
    with pytest.raises(BadOption) as caught:
        FourierSeries.from_table(rows, 25.0)
    assert str(caught.value) == message


def test_a_series_is_frozen_and_checks_its_shapes():
    series = random_series()
    with pytest.raises(ValueError, match="read-only"):
        series.sine[0, 0] = 1.0
    with pytest.raises(ValueError, match=r"cosine has shape \(2, 3\), expected \(2, 4\)"):
        FourierSeries(np.zeros(2), np.zeros((2, 4)), np.zeros((2, 3)), 1.0)
    with pytest.raises(ValueError, match="time has shape"):
        series.evaluate([[0.0]])


@given(arrays(float, (3, 2), elements=SMALL), arrays(float, (3, 2), elements=SMALL), st.floats(0.2, 20.0))
def test_a_quintic_joins_both_ends(start, end, length):
    found = np.array(Quintic(start, end, length).evaluate([0.0, length]))
    scale = 1 + max(1.0, 1 / length) ** 2
    np.testing.assert_allclose(found[:, 0], start, atol=1e-10 * scale)
    np.testing.assert_allclose(found[:, 1], end, atol=1e-10 * scale)


@given(st.floats(-2, 2), st.floats(-2, 2), st.floats(0.2, 10.0))
def test_a_run_in_from_rest_joins_the_motion_without_a_swing_back(speed, acceleration, length):
    """It gains speed monotonically where the acceleration at its end is the mean one to three times over."""
    run_in = Quintic.from_rest([[0.5], [speed], [acceleration]], length)
    ends = np.array(run_in.evaluate([0.0, length]))[:, :, 0]
    np.testing.assert_allclose(ends[1:, 0], 0, atol=1e-9)
    np.testing.assert_allclose(ends[:, 1], [0.5, speed, acceleration], atol=1e-9)
    if 0 <= acceleration * length <= 3 * speed:
        assert np.all(run_in.evaluate(np.linspace(0, length, 101))[1] >= -1e-12)
    assert not run_in.periodic


def test_a_quintic_takes_time():
    with pytest.raises(BadOption, match="give seconds, above 0"):
        Quintic(np.zeros((3, 1)), np.ones((3, 1)), 0.0)
