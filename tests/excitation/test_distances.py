"""Clearances between the samples: certain, no more careful than they must be, and found in the check."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from motion_problems import TipWalls, model_of, problem_of

from dynident.arrays import Array
from dynident.excitation.design.distances import least_distances
from dynident.excitation.design.feasibility import feasible_start, shrunk
from dynident.excitation.design.limits import MotionLimits, check_limits
from dynident.excitation.design.rest_to_rest import RestToRest
from dynident.excitation.trajectories.fourier import FourierSeries
from dynident.model.robot import Robot

NONE = np.full(2, np.inf)
FREE = MotionLimits(("a", "b"), (True, True), -NONE, NONE, NONE, NONE, NONE, NONE)


def series(seed: int, size: float = 0.3) -> FourierSeries:
    generator = np.random.default_rng(seed)
    return FourierSeries(generator.uniform(-1.5, 1.5, 2), *(size * generator.normal(size=(2, 2, 4))), 5.0)


def least(motion: FourierSeries, samples: int, spare: float = 0.0) -> Array:
    time = np.linspace(0.0, 5.0, samples)
    most = np.abs(FourierSeries.extremes(motion.table, 5.0, 500)[:, 2]).max(axis=0)
    return least_distances(TipWalls(), lambda t: motion.evaluate(t)[:2], time, most, spare)[0]


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 10**6), samples=st.integers(5, 400))
def test_what_is_certain_is_never_passed(seed: int, samples: int) -> None:
    motion = series(seed)
    true = TipWalls().distances(motion.evaluate(np.linspace(0.0, 5.0, 4001))[0]).min(axis=0)
    certain = least(motion, samples)
    assert np.all(certain <= true + 1e-9)


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 10**6))
def test_a_pair_that_keeps_its_distance_by_a_little_is_known_to(seed: int) -> None:
    """0.2 mm to spare are enough to be certain, from 60 samples a second on."""
    motion, walls = series(seed), TipWalls()
    true = walls.distances(motion.evaluate(np.linspace(0.0, 5.0, 4001))[0]).min(axis=0)
    tight = TipWalls(required=true - 2e-4)
    time = np.linspace(0.0, 5.0, 301)
    most = np.abs(FourierSeries.extremes(motion.table, 5.0, 500)[:, 2]).max(axis=0)
    certain, when = least_distances(tight, lambda t: motion.evaluate(t)[:2], time, most)
    assert np.all(certain >= tight.required)
    assert np.all(np.isin(when, time))


def test_a_dip_between_two_samples_is_seen() -> None:
    """The tip touches the wall half way between the only samples."""
    swing = FourierSeries(np.array([0.6, 0.0]), np.zeros((2, 1)), np.array([[0.6], [0.0]]), 2.0)
    np.testing.assert_allclose(swing.evaluate([0.0, 1.0, 2.0])[0][:, 0], [1.2, 0.0, 1.2])
    time = np.array([0.0, 2.0])
    most = np.abs(FourierSeries.extremes(swing.table, 2.0, 100)[:, 2]).max(axis=0)
    ends = TipWalls().distances(swing.evaluate(time)[0]).min(axis=0)
    certain, _ = least_distances(TipWalls(), lambda t: swing.evaluate(t)[:2], time, most)
    assert ends[0] > 0.4 and certain[0] <= 0.8 - 0.9


def test_a_slide_without_ends_is_certain_only_at_rest() -> None:
    class Endless(TipWalls):
        def speed_bound(self) -> Array:
            return np.tile([np.inf, 0.4], (3, 1))

    walls = Endless(required=np.full(3, -9.0))
    time = np.linspace(0.0, 1.0, 11)

    def moving(t: Array) -> tuple[Array, Array]:
        return np.stack([t, 0 * t], axis=1), np.stack([1 + 0 * t, 0 * t], axis=1)

    assert least_distances(walls, moving, time, np.zeros(2))[0].max() < -1e3
    q = np.zeros((11, 2))
    found = least_distances(walls, lambda t: (q[: len(t)], q[: len(t)]), time, np.zeros(2))[0]
    np.testing.assert_allclose(found, walls.distances(q[:1])[0])


def test_the_check_has_a_row_for_each_pair() -> None:
    motion, walls = series(4), TipWalls()
    rows = [row for row in check_limits(motion, FREE, 1001, distances=walls) if row.quantity == "clearance"]
    assert [row.joint for row in rows] == list(walls.names)
    fine = walls.distances(motion.evaluate(np.linspace(0.0, 5.0, 50_001))[0]).min(axis=0)
    for row, true, required in zip(rows, fine, walls.required, strict=True):
        assert (row.unit, row.limit) == ("m", required)
        assert true - 0.02 <= row.value <= true + 1e-9
        assert row.used == pytest.approx(max(0.0, 1.0 + (required - row.value) / 0.1))
        assert row.kept == (row.value >= required - 1e-9)
        near = walls.distances(motion.evaluate(row.time)[0])[0, walls.names.index(row.joint)]
        assert near == pytest.approx(true, abs=2e-3)
    without = check_limits(motion, FREE, 101)
    assert not [row for row in without if row.quantity == "clearance"]


@pytest.mark.parametrize("kind", ["rest_fourier", "fourier", "bspline"])
@pytest.mark.parametrize("seed", range(3))
def test_a_shrunk_motion_keeps_its_distance_at_every_time(planar_2r: Robot, kind: str, seed: int) -> None:
    problem = problem_of(model_of(planar_2r), kind, 180, clearance=TipWalls())
    kept = shrunk(problem, 1.05 * feasible_start(problem, np.random.default_rng(seed)))
    assert kept is not None
    motion = RestToRest(problem.parametrisation.trajectory(problem.free(kept)), 0.0)
    fine = TipWalls().distances(motion.evaluate(np.linspace(0.0, 6.0, 20 * 180 * 5))[0]).min(axis=0)
    assert np.all(fine >= TipWalls().required)
    rows = check_limits(motion, problem.limits, 181, distances=problem.clearance)
    assert all(row.kept for row in rows)
