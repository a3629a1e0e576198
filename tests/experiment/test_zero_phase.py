"""The filter that runs many signals side by side: SciPy's answer, whatever the number of signals and samples."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.signal

from dynident.experiment.preprocessing import _zero_phase
from dynident.experiment.preprocessing._zero_phase import zero_phase


@pytest.mark.parametrize(("count", "samples", "order", "pad"), [(5, 900, 4, 60), (17, 513, 3, 0), (33, 256, 1, 255)])
def test_it_is_the_filter_of_scipy(
    monkeypatch: pytest.MonkeyPatch, count: int, samples: int, order: int, pad: int
) -> None:
    monkeypatch.setattr(_zero_phase, "SMALL", 0)
    signals = np.random.default_rng(count).normal(size=(samples, count)).cumsum(axis=0).T  # not contiguous
    sections = scipy.signal.butter(order, 0.05, output="sos")
    wanted = scipy.signal.sosfiltfilt(sections, signals, axis=-1, padlen=pad)
    found = zero_phase(signals, sections, pad)
    assert np.abs(found - wanted).max() < 1e-11 * np.abs(wanted).max()
    assert np.abs(zero_phase(signals[:1], sections, pad) - wanted[:1]).max() < 1e-11 * np.abs(wanted).max()


def test_what_is_not_finite_stays_in_its_own_signal(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(_zero_phase, "SMALL", 0)
    signals = np.random.default_rng(0).normal(size=(20, 300))
    sections = scipy.signal.butter(4, 0.1, output="sos")
    clean = zero_phase(signals, sections, 30)
    signals[3, 100] = np.nan
    found = zero_phase(signals, sections, 30)
    assert np.isnan(found[3]).any()
    np.testing.assert_array_equal(np.delete(found, 3, axis=0), np.delete(clean, 3, axis=0))
