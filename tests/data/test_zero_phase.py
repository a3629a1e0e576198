"""The filter that runs many signals side by side: SciPy's answer, whatever the number of signals and samples."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import scipy.signal

from dynident.data.preprocessing import _zero_phase
from dynident.data.preprocessing._low_pass import butterworth
from dynident.data.preprocessing._zero_phase import zero_phase


def _always(monkeypatch: pytest.MonkeyPatch, small: int) -> None:
    """Take the recursion from so many numbers on, however short and few the signals are."""
    for name, value in {"SMALL": small, "SHORT": 1, "FEW": 1}.items():
        monkeypatch.setattr(_zero_phase, name, value)


@pytest.mark.parametrize("small", [0, 1 << 30], ids=["recursion", "products"])
@pytest.mark.parametrize(
    ("count", "samples", "order", "pad"), [(5, 900, 4, 60), (17, 513, 3, 0), (33, 256, 1, 255), (2, 40, 8, 39)]
)
def test_it_is_the_filter_of_scipy(
    monkeypatch: pytest.MonkeyPatch, small: int, count: int, samples: int, order: int, pad: int
) -> None:
    _always(monkeypatch, small)
    signals = np.random.default_rng(count).normal(size=(samples, count)).cumsum(axis=0).T  # not contiguous
    sections = scipy.signal.butter(order, 0.05, output="sos")
    wanted = scipy.signal.sosfiltfilt(sections, signals, axis=-1, padlen=pad)
    found = zero_phase(signals, butterworth(order, 0.05, 2.0), pad)
    assert np.abs(found - wanted).max() < 1e-11 * np.abs(wanted).max()


@pytest.mark.parametrize("order", [1, 2, 5, 8, 20])
def test_sections_are_those_of_scipy(order: int) -> None:
    wanted: Any = scipy.signal.butter(order, 3.0, fs=50.0, output="zpk")
    ours = butterworth(order, 3.0, 50.0)
    assert np.abs(ours.poles[:, None] - wanted[1]).min(axis=0).max() < 1e-14
    hertz = np.linspace(0.1, 20.0, 7)
    response: Any = scipy.signal.freqz_sos
    expected: Any = scipy.signal.freqz_zpk
    found = response(ours.sections, hertz, fs=50.0)[1]
    np.testing.assert_allclose(found, expected(*wanted, hertz, fs=50.0)[1], rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(ours.settled, scipy.signal.sosfilt_zi(ours.sections), rtol=1e-9, atol=1e-12)


def test_products_keep_the_digits_at_a_low_cut_off(monkeypatch: pytest.MonkeyPatch) -> None:
    """Powers of a direct form lose three digits here: both answers are next to that of extended precision."""
    signals = np.random.default_rng(0).normal(size=(1, 20000)).cumsum(axis=1)
    filter, found = butterworth(4, 0.5, 1000.0), []
    for small in (0, 1 << 30):
        _always(monkeypatch, small)
        found.append(zero_phase(signals, filter, 6000))
    assert np.abs(found[0] - found[1]).max() < 3e-10 * np.abs(found[0]).max()


@pytest.mark.parametrize("small", [0, 1 << 30])
def test_what_is_not_finite_stays_in_its_own_signal(monkeypatch: pytest.MonkeyPatch, small: int) -> None:
    _always(monkeypatch, small)
    signals = np.random.default_rng(0).normal(size=(20, 300))
    clean = zero_phase(signals, butterworth(4, 0.1, 2.0), 30)
    signals[3, 100] = np.nan
    found = zero_phase(signals, butterworth(4, 0.1, 2.0), 30)
    assert np.isnan(found[3]).any()
    np.testing.assert_array_equal(np.delete(found, 3, axis=0), np.delete(clean, 3, axis=0))
