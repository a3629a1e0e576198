"""What every trajectory must do, and what those that can be designed must do beside it, whatever their basis."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dynident.arrays import Array
from dynident.errors import BadOption
from dynident.excitation.design.parametrisation import Parametrisation, designable, kind_of, kinds, parametrise
from dynident.excitation.trajectories import TRAJECTORIES, Trajectory
from dynident.excitation.trajectories.base import Designable
from dynident.excitation.trajectories.quintic import Quintic

KINDS = kinds()

#: Trajectories of three joints that cannot be designed, each by its name.
OTHERS: dict[str, Trajectory] = {"quintic": Quintic(*np.random.default_rng(3).normal(size=(2, 3, 3)), length=2.5)}


def motion_of(shape: Parametrisation, seed: int, joints: int = 2) -> tuple[Array, Designable]:
    free = np.random.default_rng(seed).normal(size=(joints, shape.count))
    return free, shape.trajectory(free)


def signals(motion: Trajectory, time: Array) -> Array:
    return np.stack([*motion.evaluate(time), motion.jerk(time)])


@pytest.fixture(params=KINDS)
def kind(request: pytest.FixtureRequest) -> str:
    return request.param


@pytest.mark.parametrize("name", TRAJECTORIES.names())
def test_any_trajectory_is_a_smooth_function_of_time(name: str) -> None:
    """Finite at every time, in any order of times, each derivative that of the one before."""
    motion = OTHERS.get(name) or motion_of(parametrise(name, 2.5, 3), 3, joints=3)[1]
    assert motion.joints == 3 and 0 < motion.duration < np.inf and isinstance(motion.periodic, bool)
    time, step = np.linspace(0.011, motion.duration - 0.011, 60), 1e-5
    found = signals(motion, time)
    assert found.shape == (4, 60, 3) and np.all(np.isfinite(found)) and signals(motion, time[:0]).shape == (4, 0, 3)
    np.testing.assert_array_equal(signals(motion, time[::-1]), found[:, ::-1])
    slopes = (signals(motion, time + step) - signals(motion, time - step)) / (2 * step)
    assert all(np.abs(time - seam).min() > step for seam in motion.seams)
    np.testing.assert_allclose(slopes[:3], found[1:], rtol=1e-5, atol=1e-4 * np.abs(found).max())


def test_the_basis_is_the_motion_and_its_first_function_is_constant(kind: str) -> None:
    shape = parametrise(kind, 6.0, 4)
    free, motion = motion_of(shape, 0)
    time = np.linspace(0.0, 6.0, 71)
    basis = shape.basis(time)
    np.testing.assert_allclose(basis @ free.T, signals(motion, time), atol=1e-10)
    np.testing.assert_allclose(basis[0, :, 0], 1.0, atol=1e-13)
    np.testing.assert_allclose(basis[1:, :, 0], 0.0, atol=1e-9)
    assert np.linalg.matrix_rank(basis[0]) == shape.count


@pytest.mark.parametrize("name", KINDS)
@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 10**6), harmonics=st.integers(2, 7), period=st.floats(0.5, 40.0))
def test_it_repeats_itself_and_is_at_rest_where_it_says_so(name: str, seed: int, harmonics: int, period: float) -> None:
    _, motion = motion_of(parametrise(name, period, harmonics), seed)
    assert motion.periodic and motion.duration == motion.period == period
    time = np.linspace(0.1, 0.9, 7) * period
    powers = (2 * np.pi * harmonics / period) ** np.arange(4)[:, None, None]
    np.testing.assert_allclose(signals(motion, time + 2 * period) / powers, signals(motion, time) / powers, atol=1e-9)
    ends = signals(motion, np.array([0.0, period, 3 * period])) / powers
    np.testing.assert_allclose(ends[0], np.broadcast_to(ends[0, 0], ends[0].shape), atol=1e-10)
    assert motion.at_rest == bool(np.abs(ends[1:3]).max() < 1e-10)


@pytest.mark.parametrize("name", KINDS)
@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 10**6), harmonics=st.integers(2, 6), samples=st.integers(25, 120))
def test_the_extremes_hold_at_every_time_and_are_no_wider_than_they_must(
    name: str, seed: int, harmonics: int, samples: int
) -> None:
    shape = parametrise(name, 5.0, harmonics)
    free, motion = motion_of(shape, seed)
    low, high = shape.extremes(free, samples)
    fine = signals(motion, np.linspace(0.0, 5.0, 20 * samples + 1))
    size = np.abs(fine).max(axis=1)
    assert np.all(fine.max(axis=1) <= high + 1e-9 * size) and np.all(fine.min(axis=1) >= low - 1e-9 * size)
    wide = 1.0 / np.cos(np.pi * harmonics / samples) - 1.0 + 1e-2
    assert np.all(high - fine.max(axis=1) <= wide * size) and np.all(fine.min(axis=1) - low <= wide * size)


def test_the_extremes_shrink_with_the_amplitudes_about_the_posture(kind: str) -> None:
    shape = parametrise(kind, 5.0, 3)
    free, _ = motion_of(shape, 4)
    small = free.copy()
    small[:, 1:] *= 0.3
    posture = np.zeros((1, 4, 2))
    posture[0, 0] = free[:, 0]
    whole, part = shape.extremes(free, 100) - posture, shape.extremes(small, 100) - posture
    np.testing.assert_allclose(part, 0.3 * whole, atol=1e-9 * np.abs(whole).max())


def test_plain_data_goes_out_and_comes_in(kind: str) -> None:
    _, motion = motion_of(parametrise(kind, 7.0, 3), 2)
    data = json.loads(json.dumps(motion.data(), allow_nan=False))
    for again in (designable(kind).from_data(data), designable(kind).from_table(list(motion.table), 7.0)):
        assert type(again) is type(motion) and kind_of(again) == kind and again.detail == motion.detail
        time = np.linspace(0.0, 9.0, 40)
        np.testing.assert_array_equal(signals(again, time), signals(motion, time))


@pytest.mark.parametrize("period", [0.0, -2.0, np.inf, np.nan])
def test_a_period_is_positive(kind: str, period: float) -> None:
    _, motion = motion_of(parametrise(kind, 7.0, 3), 2)
    with pytest.raises(BadOption, match="give the period in s, above 0"):
        designable(kind).from_table(list(motion.table), period)
    with pytest.raises(BadOption, match="give the period in s, above 0"):
        parametrise(kind, period, 3)


@pytest.mark.parametrize("harmonics", [0, -1])
def test_a_motion_has_something_to_move(kind: str, harmonics: int) -> None:
    with pytest.raises(BadOption, match=f"harmonics = {harmonics}"):
        parametrise(kind, 7.0, harmonics)


def test_numbers_are_finite(kind: str) -> None:
    _, motion = motion_of(parametrise(kind, 7.0, 3), 2)
    rows: Any = np.where(np.arange(motion.table.shape[1]) == 4, np.nan, motion.table)
    with pytest.raises(BadOption, match=r"give finite numbers|equal"):
        designable(kind).from_table(list(rows), 7.0)
