"""The filter that runs many signals side by side: SciPy's answer, whatever the number of signals and samples."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import scipy.signal

from dynident.data.preprocessing._zero_phase import butterworth, zero_phase
from dynident.model.kernels.recurrence import Recurrence


@pytest.mark.parametrize(
    ("count", "samples", "order", "pad"), [(5, 900, 4, 60), (17, 513, 3, 0), (33, 256, 1, 255), (2, 40, 8, 39)]
)
def test_it_is_the_filter_of_scipy(count: int, samples: int, order: int, pad: int) -> None:
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


def test_a_low_cut_off_keeps_the_digits() -> None:
    """The answer is next to that of extended precision."""
    signals = np.random.default_rng(0).normal(size=(1, 20000)).cumsum(axis=1)
    filter = butterworth(4, 0.5, 1000.0)
    exact = np.pad(signals[0].astype(np.longdouble), 6000, mode="reflect", reflect_type="odd")
    for _ in range(2):
        for (b0, b1, b2, _, a1, a2), settled in zip(filter.sections, filter.settled, strict=True):
            early, late = settled * exact[0]
            for t, x in enumerate(exact):
                y = b0 * x + early
                early, late = b1 * x - a1 * y + late, b2 * x - a2 * y
                exact[t] = y
        exact = exact[::-1]
    found = zero_phase(signals, filter, 6000)[0]
    assert np.abs(found - exact[6000:-6000]).max() < 3e-10 * np.abs(found).max()


def test_what_is_not_finite_stays_in_its_own_signal() -> None:
    signals = np.random.default_rng(0).normal(size=(20, 300))
    clean = zero_phase(signals, butterworth(4, 0.1, 2.0), 30)
    signals[3, 100] = np.nan
    found = zero_phase(signals, butterworth(4, 0.1, 2.0), 30)
    assert np.isnan(found[3]).any()
    np.testing.assert_array_equal(np.delete(found, 3, axis=0), np.delete(clean, 3, axis=0))


def test_long_signals_are_filtered_in_blocks_as_short_ones_are() -> None:
    signals = np.random.default_rng(1).normal(size=(3, 5000)).cumsum(axis=1)
    sections = scipy.signal.butter(4, 0.02, output="sos")
    wanted = scipy.signal.sosfiltfilt(sections, signals, axis=-1, padlen=200)
    assert np.abs(zero_phase(signals, butterworth(4, 0.02, 2.0), 200) - wanted).max() < 1e-10 * np.abs(wanted).max()


def test_signals_of_another_shape_are_refused() -> None:
    filter = butterworth(4, 0.1, 2.0)
    recurrence = Recurrence(filter.sections, filter.settled)
    width = recurrence.width
    state = recurrence.state_of(np.zeros(width))
    for signals in (np.zeros((3, width + 1)), np.zeros((width, 3)).T):
        with pytest.raises(ValueError, match="C order"):
            recurrence.run(signals, state)
    with pytest.raises(ValueError, match="C order"):
        recurrence.run(np.zeros((3, width)), state[:1])
