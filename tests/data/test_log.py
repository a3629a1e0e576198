"""Log: frozen, checked, matched by name; rows and splits lose nothing and say what they did."""

from __future__ import annotations

from contextlib import closing

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dynident.data.formats import ColumnMap, read_log, stream_log
from dynident.data.log import Log, Source, torque_from_current
from dynident.errors import BadOption, LogMismatch

SIGNALS = ("q", "dq", "ddq", "torque", "current", "raw_torque", "temperature", "q_ref", "dq_ref")


def full_log(samples=40, joints=("a", "b", "c"), path="run.csv"):
    """Return a log with every signal, each cell with a value of its own."""
    cells = samples * len(joints)
    values = {name: 1000.0 * k + np.arange(cells, dtype=float).reshape(samples, -1) for k, name in enumerate(SIGNALS)}
    return Log(joints, 5.0 + np.arange(samples) / 200, source=Source(path, "00", samples, ("read",)), **values)


def test_a_log_is_frozen_and_a_copy():
    given_time = np.arange(4.0)
    log = Log(("a",), given_time, [[0.0], [1.0], [2.0], [3.0]])
    given_time[0] = 9.0
    assert log.time[0] == 0.0
    for array in (log.time, log.q):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0
    with pytest.raises(AttributeError):
        log.q = log.time  # type: ignore[misc]


@pytest.mark.parametrize("name", SIGNALS)
def test_shapes_are_checked_signal_by_signal(name):
    values = {"q": np.zeros((4, 2)), name: np.zeros((4, 3))}
    with pytest.raises(ValueError, match=rf"{name} has shape \(4, 3\), expected \(4, 2\)"):
        Log(("a", "b"), np.arange(4.0), **values)
    with pytest.raises(ValueError, match="time has shape"):
        Log(("a", "b"), np.zeros((4, 1)), np.zeros((4, 2)))


def test_size_duration_and_rate():
    log = full_log()
    assert log.samples == 40
    assert log.duration == pytest.approx(39 / 200)
    assert log.rate == pytest.approx(200.0)
    jittered = Log(("a",), [0.0, 0.01, 0.02, 0.03, 0.9], np.zeros((5, 1)))
    assert jittered.rate == pytest.approx(100.0)  # the median step
    assert Log(("a",), [3.0], [[0.0]]).duration == 0.0


def test_names_and_signals():
    assert full_log().name == "run.csv"
    assert full_log(path="").name == "simulated log"
    assert list(full_log().signals()) == list(SIGNALS)
    assert list(Log(("a",), [0.0], [[1.0]], torque=[[2.0]]).signals()) == ["q", "torque"]


def test_rows_take_the_same_rows_of_every_signal_and_say_so():
    log = full_log()
    for keep in (slice(3, 30, 4), np.arange(40) % 3 == 1, np.array([7, 8, 20])):
        part = log.rows(keep, "some rows")
        np.testing.assert_array_equal(part.time, log.time[keep])
        for name, values in log.signals().items():
            np.testing.assert_array_equal(part.signals()[name], values[keep])
        assert part.source == Source("run.csv", "00", 40, ("read", "some rows"))
    assert log.source.steps == ("read",)


def test_joints_are_matched_by_name():
    log = full_log()
    turned = log.ordered(["c", "a", "b"])
    assert turned.joints == ("c", "a", "b")
    for name, values in log.signals().items():
        np.testing.assert_array_equal(turned.signals()[name], values[:, [2, 0, 1]])
    assert log.ordered(("a", "b", "c")) is log
    np.testing.assert_array_equal(log.ordered(["b"]).q, log.q[:, 1:2])
    with pytest.raises(LogMismatch) as caught:
        log.ordered(["a", "elbow"])
    assert str(caught.value) == (
        "run.csv: no joint called 'elbow'; the log has a, b, c; "
        "name the joints in the order of the columns (joints: [...])"
    )


@given(st.floats(0.001, 0.999), st.integers(2, 60))
def test_a_split_loses_no_row_and_keeps_the_order(first, samples):
    log = full_log(samples)
    head, tail = log.split(first)
    np.testing.assert_array_equal(np.concatenate([head.time, tail.time]), log.time)
    np.testing.assert_array_equal(np.concatenate([head.torque, tail.torque]), log.torque)
    assert head.samples >= 1
    assert tail.samples >= 1
    assert np.all(head.time - log.time[0] < first * log.duration)
    assert f"first {first:g} of the duration" in head.source.steps[-1]


@pytest.mark.parametrize("first", [0.0, 1.0, -0.5, np.nan])
def test_a_split_needs_two_parts(first):
    with pytest.raises(BadOption) as caught:
        full_log().split(first)
    assert (
        str(caught.value) == f"split = {first!r} is not possible; give the share of the first part, such as first:0.67"
    )


def test_torques_are_gains_times_currents():
    log = full_log()
    gains = {"a": 2.0, "c": -0.5, "b": 10.0, "spare": 1.0}
    made = torque_from_current(log, gains)
    np.testing.assert_array_equal(made.torque, log.current * [2.0, 10.0, -0.5])
    np.testing.assert_array_equal(made.current, log.current)
    assert made.source.steps[-1] == "torque = gain x current"


def test_currents_of_coupled_motors_do_the_same_work_as_the_joint_torques():
    """Power is power: (K I)' (C dq) = tau' dq at any speed."""
    log = full_log()
    gains, coupling = {"a": 2.0, "b": 10.0, "c": -0.5}, np.array([[1.0, 0, 0], [0.3, 1, 0], [0, -0.7, 1.2]])
    made = torque_from_current(log, gains, coupling)
    motor_power = np.sum(log.current * [2.0, 10.0, -0.5] * (log.dq @ coupling.T), axis=1)
    np.testing.assert_allclose(np.sum(made.torque * log.dq, axis=1), motor_power, rtol=1e-12)
    assert made.source.steps[-1] == "torque = coupling' x gain x current"


def test_currents_without_gains_and_gains_without_currents():
    with pytest.raises(LogMismatch) as caught:
        torque_from_current(full_log(), {"a": 1.0})
    assert str(caught.value) == (
        "run.csv: currents but no drive gain for b, c; state 'gain' (N m at the joint per A, or per percent "
        "of the current) under drives in the case file"
    )
    with pytest.raises(LogMismatch) as caught:
        torque_from_current(Log(("a",), [0.0], [[0.0]]), {"a": 1.0})
    assert str(caught.value) == "simulated log: no motor currents; map them with 'current' in the case file"


def test_torques_of_another_clock_are_put_at_the_times_of_the_positions(tmp_path):
    """A clock 1.02 times as fast shows 1.02 s where that of the positions shows 1 s; the end has no torque then."""
    time = np.arange(200) * 0.01
    table = np.column_stack([time, np.sin(time), np.cos(time / 1.02)])
    np.savetxt(tmp_path / "run.csv", table, delimiter=",", header="t,q1,tau1", comments="")
    log = read_log(tmp_path / "run.csv", ColumnMap(torque_clock=1.02))
    assert log.samples == 196
    np.testing.assert_allclose(log.q[:, 0], np.sin(log.time))
    np.testing.assert_allclose(np.asarray(log.torque)[:, 0], np.cos(log.time), atol=2e-5)
    with closing(stream_log(tmp_path / "run.csv", ColumnMap(torque_clock=1.02))) as stream:
        with pytest.raises(BadOption, match=r"torque_clock = 1\.02 is not possible; a log that is read row by row"):
            next(iter(stream.blocks()))
    with pytest.raises(BadOption, match=r"a ratio between 0\.9 and 1\.1"):
        ColumnMap(torque_clock=2.0)
