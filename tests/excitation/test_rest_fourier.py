"""Fourier series that start and end at rest."""

from __future__ import annotations

import numpy as np
import pytest

from dynident.arrays import Array
from dynident.errors import BadOption
from dynident.excitation.trajectories.fourier import FourierSeries
from dynident.excitation.trajectories.rest_fourier import RestFourier, rest_map


def free(seed: int, harmonics: int = 4, joints: int = 2) -> Array:
    return np.random.default_rng(seed).normal(size=(joints, 2 * harmonics - 1))


@pytest.mark.parametrize("harmonics", [2, 3, 5, 9])
def test_the_map_is_orthonormal_and_reaches_every_series_at_rest(harmonics: int) -> None:
    found = rest_map(harmonics)
    assert found.shape == (2 * harmonics + 1, 2 * harmonics - 1)
    np.testing.assert_allclose(found.T @ found, np.eye(2 * harmonics - 1), atol=1e-12)
    order = np.arange(1, harmonics + 1)
    # sin(k w t) - k sin(w t) and cos(k w t) - k^2 cos(w t) are at rest by inspection, and span all such series
    rows = [np.r_[1.0, np.zeros(2 * harmonics)]]
    for k in order[1:]:
        for start, first in ((1, -k), (1 + harmonics, -(k**2))):
            row = np.zeros(2 * harmonics + 1)
            row[start], row[start + k - 1] = first, 1.0
            rows.append(row)
    span = np.array(rows)
    np.testing.assert_allclose(found @ (found.T @ span.T), span.T, atol=1e-10)


def test_it_is_the_plain_series_of_the_same_numbers() -> None:
    motion = RestFourier.from_free(free(2), 5.0)
    plain = FourierSeries(motion.offset, motion.sine, motion.cosine, 5.0)
    time = np.linspace(0, 7, 30)
    np.testing.assert_array_equal(motion.evaluate(time), plain.evaluate(time))
    np.testing.assert_array_equal(motion.jerk(time), plain.jerk(time))
    assert (motion.joints, motion.harmonics, motion.duration, motion.periodic) == (2, 4, 5.0, True)


@pytest.mark.parametrize(
    ("sine", "cosine", "what"), [([1.0, 0.0], [0.0, 0.0], "velocity"), ([0.0, 0.0], [4.0, 1.0], "acceleration")]
)
def test_a_series_that_does_not_start_at_rest_is_refused(sine: list[float], cosine: list[float], what: str) -> None:
    with pytest.raises(BadOption, match=f"joint 2.*the {what} at the start is not zero"):
        RestFourier(np.zeros(2), np.array([[-2.0, 1.0], sine]), np.array([[-4.0, 1.0], cosine]), 4.0)


def test_arguments_that_cannot_be() -> None:
    with pytest.raises(BadOption, match="2 H - 1 numbers per joint"):
        RestFourier.from_free(np.zeros((2, 4)), 4.0)
    with pytest.raises(BadOption, match="2 or more to start and end at rest"):
        rest_map(1)
    with pytest.raises(BadOption, match=r"period = 0\.0"):
        RestFourier.from_free(free(0), 0.0)
    with pytest.raises(BadOption, match="offset = nan"):
        RestFourier(np.array([np.nan]), np.zeros((1, 2)), np.zeros((1, 2)), 1.0)
