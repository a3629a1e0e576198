"""Figures of merit in closed form, figures that do not exist, and what several logs make of them."""

from __future__ import annotations

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from dynident.arrays import Array, BoolArray
from dynident.data.log import Log
from dynident.identification.estimate.validation import Validation, compare_torques, correlation

SIGNAL = arrays(float, 30, elements=st.floats(-100, 100))


def log_of(torque: Array, raw: Array | None = None) -> Log:
    count, joints = torque.shape
    names = tuple(f"joint{i + 1}" for i in range(joints))
    zero = np.zeros((count, joints))
    return Log(names, np.arange(count) / 100, zero, zero, zero, torque, raw_torque=raw)


def compared(
    measured: Array,
    predicted: Array,
    moving: BoolArray | None = None,
    raw: Array | None = None,
    units: tuple[str, ...] = (),
) -> Validation:
    keep = np.ones_like(measured, dtype=np.bool_) if moving is None else moving
    words = units or ("N m",) * measured.shape[1]
    return compare_torques([log_of(measured, raw)], [predicted], [keep], words, 0.02, {"kind": "as_given"})


def test_figures_by_hand() -> None:
    measured = np.array([[1.0], [2.0], [3.0], [4.0]])
    predicted = np.array([[1.5], [1.5], [3.5], [4.5]])
    raw = np.array([[1.0], [2.5], [3.0], [5.0]])
    (fit,) = compared(measured, predicted, raw=raw).joints
    assert (fit.name, fit.unit, fit.samples) == ("joint1", "N m", 4)
    assert fit.rmse == pytest.approx(0.5)
    assert fit.rmse_unfiltered == pytest.approx(np.sqrt((0.25 + 1.0 + 0.25 + 0.25) / 4))
    assert fit.relative_error == pytest.approx(1.0 / np.sqrt(30))
    assert fit.deviation == pytest.approx(np.sqrt(1.25))
    assert fit.r2 == pytest.approx(1 - 0.25 / 1.25)
    assert fit.correlation == pytest.approx(np.corrcoef(measured[:, 0], predicted[:, 0])[0, 1])


def test_the_total_is_over_all_joints_and_rows_and_not_centred() -> None:
    measured = np.array([[3.0, 10.0], [4.0, -10.0]])
    predicted = np.array([[3.0, 11.0], [4.0, -10.0]])
    assert compared(measured, predicted).total_relative_error == pytest.approx(1 / 15)


def test_the_total_in_motion_is_over_the_rows_that_move() -> None:
    measured = np.array([[3.0, 10.0], [4.0, -10.0], [9.0, 5.0]])
    predicted = np.array([[3.5, 11.0], [4.0, -10.0], [0.0, 4.0]])
    moving = np.array([[True, True], [True, False], [False, True]])
    found = compared(measured, predicted, moving)
    error, torque = (measured - predicted)[moving], measured[moving]
    assert found.moving_relative_error == pytest.approx(np.linalg.norm(error) / np.linalg.norm(torque))
    assert found.figures()["moving"]["total_relative_error"] == pytest.approx(found.moving_relative_error)
    assert np.isnan(compared(measured, predicted, np.zeros_like(moving)).moving_relative_error)


@given(SIGNAL, SIGNAL, st.floats(0.1, 10), st.floats(-50, 50))
def test_correlation_is_that_of_numpy_whatever_scale_and_offset(
    one: Array, other: Array, scale: float, offset: float
) -> None:
    if np.std(one) < 1e-3 or np.std(other) < 1e-3:
        return
    expected = np.corrcoef(one, other)[0, 1]
    assert correlation(one, other) == pytest.approx(expected, abs=1e-9)
    assert correlation(scale * one + offset, other) == pytest.approx(expected, abs=1e-6)
    assert correlation(-one, other) == pytest.approx(-expected, abs=1e-9)


@given(arrays(float, (20, 2), elements=st.floats(-100, 100)))
def test_a_perfect_prediction(torque: Array) -> None:
    found = compared(torque, torque)
    for fit, column in zip(found.joints, torque.T, strict=True):
        assert fit.rmse == 0
        if np.ptp(column) > 1e-6:
            assert fit.r2 == 1 and fit.correlation == pytest.approx(1) and fit.relative_error == 0


@pytest.mark.parametrize("level", [0.0, 0.1, 1 / 3, 1e-9, -7.7e5])
def test_figures_of_a_torque_that_never_changes_do_not_exist(level: float) -> None:
    """However the mean of equal numbers is rounded: no correlation, no R2, and no relative error of zero torque."""
    measured = np.full((1001, 1), level)
    predicted = measured + np.random.default_rng(0).normal(size=measured.shape)
    validation = compared(measured, predicted)
    (fit,) = validation.joints
    assert np.isnan(fit.correlation) and np.isnan(fit.r2)
    assert np.isnan(fit.relative_error) == (level == 0)
    figures = validation.figures()
    assert figures["joints"][0]["correlation"] is None and figures["joints"][0]["r2"] is None
    json.dumps(figures, allow_nan=False)


def test_moving_rows_are_counted_apart() -> None:
    measured = np.array([[1.0, 1.0], [2.0, 2.0], [9.0, 3.0]])
    predicted = np.array([[1.0, 1.0], [2.0, 2.0], [0.0, 3.0]])
    moving = np.array([[True, False], [True, False], [False, False]])
    found = compared(measured, predicted, moving)
    assert [fit.samples for fit in found.joints] == [3, 3] and [fit.samples for fit in found.moving] == [2, 0]
    assert found.moving[0].rmse == 0 and found.joints[0].rmse > 5
    assert np.isnan(found.moving[1].rmse)  # nobody moved: no figure
    data = found.figures()
    assert data["moving"]["standstill"] == 0.02 and data["moving"]["joints"][1]["rmse"] is None


def test_several_logs_are_put_end_to_end() -> None:
    first, second = np.array([[1.0], [2.0]]), np.array([[3.0], [4.0], [5.0]])
    masks = [np.ones((2, 1), bool), np.ones((3, 1), bool)]
    logs = [log_of(first), log_of(second, raw=second + 1)]
    found = compare_torques(logs, [first, second + 0.5], masks, ["N"], 0.0, {"kind": "none"})
    assert (found.samples, found.starts, found.logs) == (5, (0, 2), ("simulated log", "simulated log"))
    np.testing.assert_array_equal(found.measured[:, 0], [1, 2, 3, 4, 5])
    np.testing.assert_array_equal(found.unfiltered[:, 0], [1, 2, 4, 5, 6])  # a log without a filter is its own
    np.testing.assert_allclose(found.residual[:, 0], [0, 0, -0.5, -0.5, -0.5])
    np.testing.assert_allclose(found.time, [0, 0.01, 0, 0.01, 0.02])
    assert found.joints[0].unit == "N" and found.filter == {"kind": "none"}


def test_figures_are_plain_data() -> None:
    torque = np.random.default_rng(0).normal(size=(50, 2))
    data = compared(torque, torque * 0.9, units=("N m", "N")).figures()
    assert set(data) == {"total_relative_error", "samples", "logs", "joints", "moving", "bands"}
    assert set(data["joints"][0]) == {
        "name", "unit", "samples", "rmse", "rmse_unfiltered", "correlation", "r2", "relative_error",
    }  # fmt: skip
    assert data["total_relative_error"] == pytest.approx(0.1)
    assert json.loads(json.dumps(data, allow_nan=False)) == data
