"""Quintic B-splines at rest at both ends: against scipy's own curves, one-way motions, and bad numbers."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.interpolate import BSpline as Curve

from dynident.errors import BadOption, UnknownChoice
from dynident.excitation.design.parametrisation import designable, kinds, parametrise
from dynident.excitation.design.rest_to_rest import RestToRest
from dynident.excitation.trajectories.bspline import BSpline


def spline(seed: int = 0, closed: bool = True, joints: int = 2, period: float = 4.0) -> BSpline:
    control = np.random.default_rng(seed).normal(size=(joints, 11))
    control[:, :3] = control[:, :1]
    control[:, -3:] = control[:, :1] if closed else control[:, -1:]
    return BSpline(control, period)


def test_it_is_the_curve_of_its_knots_and_control_points() -> None:
    motion = spline()
    assert motion.knots(4.0, 11).tolist() == [0.0] * 6 + [2 / 3 * k for k in range(1, 6)] + [4.0] * 6
    curve = Curve(motion.knots(4.0, 11), motion.control.T, 5)
    time = np.linspace(0.0, 4.0, 33)[:-1]
    for order, signal in enumerate([*motion.evaluate(time), motion.jerk(time)]):
        np.testing.assert_allclose(signal, curve(time, nu=order), atol=1e-11)
    assert (motion.joints, motion.duration, motion.detail) == (2, 4.0, "6 quintic pieces")


def test_as_many_free_numbers_as_a_fourier_series_at_rest() -> None:
    for harmonics in (2, 5, 8):
        own, other = parametrise("bspline", 3.0, harmonics), parametrise("rest_fourier", 3.0, harmonics)
        assert own.count == other.count == 2 * harmonics - 1
        assert own.trajectory(np.ones((1, own.count))).detail == f"{2 * harmonics - 1} quintic pieces"


def test_the_first_free_number_is_the_mean_over_time() -> None:
    shape = parametrise("bspline", 5.0, 4)
    free = np.random.default_rng(5).normal(size=(2, shape.count))
    motion = shape.trajectory(free)
    time = (np.arange(20_000) + 0.5) / 20_000 * 5.0
    np.testing.assert_allclose(motion.evaluate(time)[0].mean(axis=0), free[:, 0], atol=1e-7)


def test_ends_that_differ_by_rounding_are_made_equal() -> None:
    row = np.array([0.1, 0.1, 0.1, 2.0, 1.0, 0.1, 0.1, 0.1])
    rounded = row + 1e-16 * np.arange(8)
    motion = BSpline.from_table([rounded], 2.0)
    assert motion.periodic and np.all(motion.control[0, [0, 1, 2, 5, 6, 7]] == motion.control[0, 0])
    one_way = BSpline.from_table([np.r_[rounded[:5], rounded[5:] + 0.3]], 2.0)
    assert not one_way.periodic
    with pytest.raises(BadOption, match="the first three must be equal"):
        BSpline.from_table([row + 1e-9 * np.arange(8)], 2.0)


def test_repeats_are_continuous_up_to_the_acceleration() -> None:
    motion = RestToRest(spline(3), 0.0, repeats=3)
    assert motion.duration == 12.0
    near = np.array([4.0 - 1e-9, 4.0, 4.0 + 1e-9, 8.0 - 1e-9, 8.0 + 1e-9])
    for signal in motion.evaluate(near):
        np.testing.assert_allclose(signal, np.broadcast_to(signal[1], signal.shape), atol=1e-6)
    for signal in motion.evaluate([0.0, 12.0])[1:]:
        np.testing.assert_allclose(signal, 0.0, atol=1e-11)


def test_a_motion_that_ends_elsewhere_does_not_repeat_and_stays_at_its_ends() -> None:
    motion = spline(1, closed=False)
    assert not motion.periodic and motion.at_rest
    q, dq, ddq = motion.evaluate([-1.0, 0.0, 4.0, 9.0])
    np.testing.assert_allclose(q, motion.control[:, [0, 0, -1, -1]].T, atol=1e-12)
    np.testing.assert_allclose([dq, ddq], 0.0, atol=1e-11)
    with pytest.raises(BadOption, match="give a periodic motion"):
        RestToRest(motion, 0.0)


def test_extremes_are_those_of_the_pieces() -> None:
    """A single bump of three pieces: its top is in the middle by symmetry."""
    control = np.zeros((1, 8))
    control[0, 3:5] = 1.0
    motion = BSpline(control, 3.0)
    low, high = BSpline.extremes(motion.control, 3.0, 10)
    assert high[0, 0] == pytest.approx(float(motion.evaluate(1.5)[0][0, 0]), rel=1e-14)
    assert low[0, 0] == pytest.approx(0.0, abs=1e-14)
    assert low[1, 0] == pytest.approx(-high[1, 0], rel=1e-12)
    jerk = motion.jerk(np.linspace(0.0, 3.0, 30_001)[:-1])
    assert high[3, 0] == pytest.approx(float(jerk.max()), rel=1e-6)


@pytest.mark.parametrize(
    ("control", "message"),
    [
        (np.zeros((1, 5)), r"control = 'of shape \(1, 5\)'.*give 6 or more points a joint"),
        ([[0.0, 0.0, 1.0, 2.0, 0.0, 0.0, 0.0]], "control of joint 1 = .*the first three must be equal"),
        ([[0.0] * 7, [0.0, 0.0, 0.0, 2.0, 1.0, 0.0, 0.0]], "control of joint 2 = .*and the last three"),
        ([[0.0] * 3 + [np.nan] + [0.0] * 3], "control = nan"),
    ],
)
def test_control_points_that_are_none(control: Any, message: str) -> None:
    with pytest.raises(BadOption, match=message):
        BSpline(np.array(control), 1.0)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"degree": 3}, "degree = 3 is not possible; give 5"),
        ({"knots": [0.0, 1.0]}, "give even knots from 0 to the period"),
        ({"period": 5.0}, "give even knots from 0 to the period"),
    ],
)
def test_plain_data_of_other_splines(change: dict[str, Any], message: str) -> None:
    with pytest.raises(BadOption, match=message):
        BSpline.from_data({**spline().data(), **change})


def test_rows_of_unequal_length() -> None:
    with pytest.raises(BadOption, match="row 2 = '7 values' is not possible; give 8 as in row 1"):
        BSpline.from_table([np.zeros(8), np.zeros(7)], 1.0)


def test_what_can_be_designed() -> None:
    assert kinds() == ("bspline", "fourier", "rest_fourier")
    for name in ("quintic", "b-spline"):
        with pytest.raises(UnknownChoice, match=r"no trajectory to design called .*bspline, fourier, rest_fourier"):
            designable(name)
