"""Presliding: the stop operator against its own update, its loss in closed form, and what no history tells."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from dynident.data.log import Log
from dynident.data.preprocessing import Preprocessing, preprocess
from dynident.data.preprocessing.as_given import AsGiven
from dynident.errors import BadOption
from dynident.identification.problem.problem import counting_rows
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import Friction, Motion
from dynident.model.friction.coulomb import Coulomb
from dynident.model.friction.presliding import Presliding
from dynident.model.robot import Robot

GIVEN = Preprocessing(AsGiven(), rest="keep")


def turning(size: float, samples: int = 4001) -> Motion:
    time = np.linspace(0.0, 4.0, samples)[:, None]
    turn = np.pi * time
    return Motion(size * np.sin(turn), size * np.pi * np.cos(turn), -size * np.pi**2 * np.sin(turn))


@pytest.mark.parametrize("shape", [1.0, 0.4, 0.01])
def test_its_states_are_those_of_its_own_update(exact_motion: Callable[..., Motion], shape: float) -> None:
    part, motion = Presliding(0.02, shape), exact_motion(3, np.arange(400) / 50.0)
    np.testing.assert_allclose(part.states_along(motion, 0.02), Friction.states_along(part, motion, 0.02), atol=1e-14)


@pytest.mark.parametrize("shape", [0.5, 0.01])
def test_its_curve_is_that_of_its_differential_equation(shape: float) -> None:
    """Steps of a ten-thousandth of the length; towards shape 0 it is the exponential of Dahl within 1 %."""
    part, z, step = Presliding(0.02, shape), -0.02, 2e-6
    q = np.concatenate([np.linspace(0.03, 0.0, 2), np.linspace(0.0, 0.03, 301)[1:]])[:, None]
    found = part.states_along(Motion(q, q, q), 1e-3, first=np.array([[-0.02]]))[1:, 0, 0]
    along = [z := z + step * (1.0 - z / 0.02) ** (1.0 - shape) for _ in range(15000)]
    np.testing.assert_allclose(found[50::50], along[2499::2500], atol=2e-5)
    if shape == 0.01:
        np.testing.assert_allclose(found, 0.02 * (1.0 - 2.0 * np.exp(-np.linspace(0.0, 0.03, 301) / 0.02)), atol=2e-4)


def test_its_damping_is_of_the_rate_of_the_deflection_of_bristles() -> None:
    part, motion = Presliding(0.02, 0.01, damping=True), turning(0.05, 40001)
    state = part.states_along(motion, 1e-4)
    columns = part.columns(replace(motion, state=state))
    np.testing.assert_allclose(columns[..., 0], state[..., 0] / 0.02, rtol=1e-12)
    rate = np.gradient(state[:, 0, 0], 1e-4)
    np.testing.assert_allclose(columns[:, 0, 1], rate, atol=0.02 * np.abs(rate).max())
    assert (columns[:, 0, 1] * motion.dq[:, 0] >= 0).all() and not part.columns(motion)[..., 1].any()


@pytest.mark.parametrize("size", [0.01, 0.05, 0.5])
def test_a_cycle_loses_what_the_closed_form_says(size: float) -> None:
    """An elastic, perfectly plastic element that turns between +-size loses 4 Fp (size - length) a cycle, if any."""
    part, motion = Presliding(0.02), turning(size)
    force = part.columns(replace(motion, state=part.states_along(motion, 1e-3)))[2000:, 0, 0]
    lost = float(np.sum(0.5 * (force[1:] + force[:-1]) * np.diff(motion.q[2000:, 0])))
    assert lost == pytest.approx(4.0 * max(size - 0.02, 0.0), rel=2e-3, abs=1e-6)


def test_its_start_counts_until_it_has_slipped() -> None:
    part, motion = Presliding(0.02), turning(0.05)
    unsettled = part.is_unsettled(motion)[:, 0]
    moved = np.maximum.accumulate(motion.q[:, 0]) - np.minimum.accumulate(motion.q[:, 0])
    np.testing.assert_array_equal(unsettled, moved < 0.04 - 0.01 * 0.02)
    exponential = Presliding(0.02, 0.05).is_unsettled(motion)[:, 0]  # a start is forgotten along the way, not the range
    assert np.argmin(exponential) == pytest.approx(np.argmax(np.abs(np.diff(motion.q[:, 0])).cumsum() > 0.104), rel=0.1)
    assert not part.is_unsettled(turning(0.01)).any()  # never settles: all rows stay


def test_rows_before_it_has_slipped_do_not_count(planar_2r: Robot, exact_log: Callable[..., Log]) -> None:
    log = preprocess(exact_log(DynamicModel(planar_2r), planar_2r.nominal, samples=200), GIVEN)
    counts = counting_rows(DynamicModel(planar_2r, (Coulomb(), Presliding(0.05))), log)
    assert not counts[0].any() and counts[-1].all() and counting_rows(DynamicModel(planar_2r), log).all()


def test_without_history_it_is_coulomb_friction(exact_motion: Callable[..., Motion]) -> None:
    motion = exact_motion(2, np.arange(100) / 50.0)
    part = Presliding(0.003)
    np.testing.assert_array_equal(part.columns(motion), Coulomb(0.01).columns(motion))
    np.testing.assert_array_equal(part.derivatives(motion)[1], Coulomb(0.01).derivatives(motion)[1])


@pytest.mark.parametrize("length", [0.0, -1e-3, np.inf, np.nan])
def test_lengths_that_are_none(length: float) -> None:
    with pytest.raises(BadOption, match="give a distance in rad, at least the resolution of the encoder"):
        Presliding(length)
