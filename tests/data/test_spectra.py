"""Spectra of positions: floors and bands of signals whose spectra are known."""

from __future__ import annotations

import numpy as np
import pytest

from dynident.data.log import Log
from dynident.data.preprocessing._spectra import in_bands, noise_floor, power_spectrum, spectra_of

RATE = 500.0
TIME = np.arange(10000) / RATE


def swing(*tones: tuple[float, float]) -> np.ndarray:
    return sum((height * np.sin(2 * np.pi * hertz * TIME) for hertz, height in tones), np.zeros(len(TIME)))


@pytest.mark.parametrize("deviation", [1e-6, 1e-4])
def test_the_floor_is_that_of_the_noise_under_a_large_slow_motion(deviation: float) -> None:
    noise = deviation * np.random.default_rng(0).normal(size=(len(TIME), 2))
    q = swing((0.3, 1.0), (1.1, 0.3))[:, None] + noise
    found = np.sqrt(noise_floor(q, RATE) * RATE / 2)
    np.testing.assert_allclose(found, deviation, rtol=0.05)


def test_rounding_is_noise_of_a_step_over_the_root_of_twelve() -> None:
    q = np.round(swing((0.3, 1.0), (1.1, 0.3)) / 1e-3)[:, None] * 1e-3
    assert np.sqrt(noise_floor(q, RATE)[0] * RATE / 2) == pytest.approx(1e-3 / 12**0.5, rel=0.15)


def test_the_power_of_white_noise_adds_up_to_its_variance() -> None:
    noise = np.random.default_rng(1).normal(size=(len(TIME), 1))
    hertz, power = power_spectrum(noise, RATE)
    assert np.mean(power[len(power) // 4 :]) * RATE / 2 == pytest.approx(1.0, rel=0.05)
    middles, banded = in_bands(hertz, power)
    assert np.all(np.diff(middles) > 0)
    np.testing.assert_allclose(banded[-3:, 0] * RATE / 2, 1.0, rtol=0.1)  # thousands of frequencies in each


def test_bands_of_motion_and_noise() -> None:
    noise = 1e-5 * np.random.default_rng(2).normal(size=len(TIME))
    q = (swing((0.4, 0.5), (2.0, 0.1)) + noise)[:, None]
    found = spectra_of(Log(("a",), TIME, q, torque=100 * q))
    assert 1.8 <= found.excited_hz[0] <= 2.6
    assert found.excited_hz[0] < found.valley_hz[0] < 10.0
    assert found.deviation[0] == pytest.approx(1e-5, rel=0.1)
    assert found.torque is not None
    np.testing.assert_allclose(found.torque, 1e4 * found.position, rtol=1e-9)
