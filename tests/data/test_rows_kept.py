"""How many rows are kept: as stated, or so many a period of the cut-off."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dynident.data.log import Log
from dynident.data.preprocessing import ROWS_PER_PERIOD, Preprocessing, preprocess
from dynident.data.preprocessing.as_given import AsGiven
from dynident.data.preprocessing.butterworth import Butterworth
from dynident.errors import BadOption

AUTO = Preprocessing(Butterworth(5.0), rows_per_period=ROWS_PER_PERIOD)


def test_a_stated_rate_comes_before_the_cut_off() -> None:
    assert AUTO.rows_hz(1000.0) == 40.0
    assert replace(AUTO, rate_hz=100.0).rows_hz(1000.0) == 100.0
    assert replace(AUTO, rows_per_period=None).rows_hz(1000.0) is None
    for without in (AsGiven(), Butterworth(5.0, torque="none")):
        assert replace(AUTO, filter=without).rows_hz(1000.0) == 200.0
    with pytest.raises(BadOption, match="rows_per_period"):
        replace(AUTO, rows_per_period=2.0)


def test_eight_rows_a_period_fold_nothing_back() -> None:
    """What the filter passes at half the rate of the rows, and what its rows say of white noise."""
    response = Butterworth(5.0).smooth(np.sin(2 * np.pi * 20.0 * np.arange(4000) / 1000.0)[None], 1000.0)
    assert np.abs(response[0, 1000:-1000]).max() < 2e-5
    noise = np.random.default_rng(0).normal(size=(20000, 1))
    log = Log(("a",), np.arange(20000) / 1000.0, np.zeros((20000, 1)), torque=noise)
    found = preprocess(log, AUTO)
    assert found.every == 25 and found.statement()["rate_hz"] == pytest.approx(40.0)
    kept, every = np.asarray(found.kept.torque), np.asarray(found.log.torque)
    assert np.mean(kept[8:-8] ** 2) == pytest.approx(np.mean(every[200:-200] ** 2), rel=1e-3)
