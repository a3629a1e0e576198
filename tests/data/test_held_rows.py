"""Readings that stand in several rows of a log, and those that only look so."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dynident.arrays import Array, IntArray
from dynident.data.log import Log
from dynident.data.preprocessing import resample

RATE, ROWS, JOINTS = 1000.0, 12000, tuple("abcdef")


def run(generator: np.random.Generator, samples: int = ROWS, rate: float = RATE) -> Log:
    time = np.arange(samples) / rate
    hertz, phase = generator.uniform(0.2, 0.6, 6), generator.uniform(0, 6, 6)
    q = np.sin(2 * np.pi * hertz * time[:, None] + phase) + 1e-5 * generator.normal(size=(samples, 6))
    return Log(JOINTS, time, q, torque=20.0 * np.cos(q) + generator.normal(size=q.shape))


def held(log: Log, rows: IntArray, *names: str) -> Log:
    return replace(log, **{name: getattr(log, name)[rows] for name in names})


@pytest.fixture
def generator() -> np.random.Generator:
    return np.random.default_rng(7)


def last_of(starts: Array) -> IntArray:
    """Return the row of the reading that each row holds, where readings come at some rows."""
    return np.asarray(starts)[np.searchsorted(starts, np.arange(ROWS), side="right") - 1]


@pytest.mark.parametrize("count", [2, 10])
def test_one_row_of_each_reading_is_kept(generator: np.random.Generator, count: int) -> None:
    log = run(generator)
    even = resample(held(log, np.arange(ROWS) // count * count, "q", "torque"))
    assert even.rate == pytest.approx(RATE / count) and f"stands in {count} rows" in even.source.steps[-1]
    for name in ("q", "torque"):
        np.testing.assert_array_equal(getattr(even, name), getattr(log, name)[::count])


def test_readings_at_uneven_rows(generator: np.random.Generator) -> None:
    log, starts = run(generator), np.concatenate([[0], np.cumsum(generator.integers(5, 26, ROWS // 10))])
    even = resample(held(log, last_of(starts[starts < ROWS]), "q", "torque"))
    smooth = np.column_stack([np.interp(even.time, log.time, column) for column in log.q.T])
    assert np.abs(even.q - smooth)[20:-20].max() < 2e-3 < np.abs(log.q - held(log, last_of(starts), "q").q).max()


def test_positions_alone_are_joined_by_lines(generator: np.random.Generator) -> None:
    log = run(generator)
    even = resample(held(log, np.arange(ROWS) // 10 * 10, "q"))
    assert even.rate == pytest.approx(RATE) and "of q stands in 10 rows" in even.source.steps[-1]
    assert np.abs(even.q - log.q)[:-10].max() < 3e-4
    np.testing.assert_array_equal(even.torque, log.torque)


def test_positions_that_stand_in_more_rows_than_torques(generator: np.random.Generator) -> None:
    """Positions at 50 Hz and torques at 250 Hz had kept their steps: a test error of 9.2 % for 0.4 %."""
    log = run(generator)
    even = resample(held(held(log, np.arange(ROWS) // 20 * 20, "q"), np.arange(ROWS) // 4 * 4, "torque"))
    assert even.rate == pytest.approx(RATE / 4) and [step.split(" stands")[0] for step in even.source.steps[-2:]] == [
        "each reading",
        "each reading of q",
    ]
    assert np.abs(even.q - log.q[::4])[:-5].max() < 1e-3
    np.testing.assert_array_equal(even.torque, log.torque[::4])


def test_a_rest_without_noise_keeps_its_time(generator: np.random.Generator) -> None:
    """Rows of a reading are dropped, but not those of a joint at rest, which would be a gap."""
    log, rows = run(generator), np.arange(ROWS) // 10 * 10
    rows[5000:8000] = 5000
    even = resample(held(log, rows, "q", "torque"))
    assert even.rate == pytest.approx(RATE / 10) and even.duration == pytest.approx(log.duration, abs=0.02)
    assert np.ptp(even.q[510:790], axis=0).max() == 0.0


@pytest.mark.parametrize("kind", ["fresh", "coarse", "at rest", "torque alone", "lost messages"])
def test_other_logs_stay_as_they_are(generator: np.random.Generator, kind: str) -> None:
    log = run(generator)
    if kind == "coarse":  # encoders with steps of 2 mrad: joints change one by one
        log = replace(log, q=np.round(log.q / 2e-3) * 2e-3)
    elif kind == "at rest":  # half of the log repeats, as one value
        log = held(log, np.minimum(np.arange(ROWS), ROWS // 2), "q", "torque")
    elif kind == "torque alone":
        log = held(log, np.arange(ROWS) // 10 * 10, "torque")
    elif kind == "lost messages":  # one in twenty rows
        log = held(
            log, last_of(np.flatnonzero(generator.uniform(size=ROWS) > 0.05 * (np.arange(ROWS) > 0))), "q", "torque"
        )
    assert resample(log) is log
