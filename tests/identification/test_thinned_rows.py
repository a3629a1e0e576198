"""The filter at one sample in so many: the rows that SciPy's filter over all samples has there."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import scipy.signal

from arm_models import theta_of
from dynident.data.log import Log
from dynident.data.preprocessing import FILTERS, Preprocessing, preprocess
from dynident.data.preprocessing._thinning import thinning
from dynident.identification.problem import thinned_rows
from dynident.identification.problem.regressor_stream import RegressorStream
from dynident.model.base_parameters import base_parameters
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import FRICTION
from dynident.model.robot import Robot

MakeLog = Callable[..., Log]


@pytest.mark.parametrize(
    ("cutoff", "order", "rate", "every"),
    [(5.0, 4, 1000.0, 5), (5.0, 4, 1000.0, 25), (60.0, 5, 500.0, 7), (2.0, 1, 100.0, 2)],
)
def test_kept_samples_are_those_of_the_filter_of_scipy(cutoff: float, order: int, rate: float, every: int) -> None:
    samples = int(60 * rate / cutoff)
    signals = np.random.default_rng(order).normal(size=(7, samples)).cumsum(axis=1)
    sections = scipy.signal.butter(order, cutoff, fs=rate, output="sos")
    wanted = scipy.signal.sosfiltfilt(sections, signals, axis=-1)
    thin = thinning(cutoff, order, rate, every)
    count = (samples - 2 * thin.half - 1) // every + 1
    folded = np.zeros((7, count))
    for first in range(0, count, 100):  # in parts, as the rows of a log come
        many = min(100, count - first)
        thin.fold(signals[:, first * every :][:, : (many - 1) * every + 2 * thin.half + 1], folded, first, many)
    places = thin.half + every * np.arange(count)
    inside = (places > samples / 3) & (places < samples * 2 / 3)
    error = np.abs(thin.settle(folded) - wanted[:, places])[:, inside]
    assert np.count_nonzero(inside) > 5
    assert error.max() < 1e-9 * np.abs(wanted).max()


@pytest.mark.parametrize("filter", ["butterworth", "smoothing_spline"])
def test_rows_are_those_without_it_also_beside_the_ends(
    filter: str, spatial_3r: Robot, exact_log: MakeLog, monkeypatch: pytest.MonkeyPatch
) -> None:
    model = DynamicModel(spatial_3r, tuple(FRICTION.make(name) for name in ("coulomb", "viscous", "offset")))
    log = exact_log(model, theta_of(model), noise=0.1, samples=3000)
    how = Preprocessing(FILTERS.make(filter, {"cutoff_hz": 8.0}), rate_hz=log.rate / 4)
    regressor, prepared = RegressorStream(model, base_parameters(model)), preprocess(log, how)
    assert prepared.thinning is not None and prepared.every == 4
    monkeypatch.setattr(thinned_rows, "SEGMENT", 700)
    found = regressor.rows(prepared)
    plain = replace(prepared)
    plain.__dict__["thinning"] = None
    for ours, wanted in zip(found, regressor.rows(plain), strict=True):
        assert ours.shape == wanted.shape
        assert np.abs(ours - wanted).max() < 1e-10 * np.abs(wanted).max()


def test_rows_that_stand_unevenly_are_filtered_in_full(spatial_3r: Robot, exact_log: MakeLog) -> None:
    model = DynamicModel(spatial_3r, (FRICTION.make("viscous"),))
    log = exact_log(model, theta_of(model), samples=3000)
    prepared = preprocess(log, Preprocessing(FILTERS.make("butterworth", {"cutoff_hz": 8.0}), rate_hz=log.rate / 4))
    moved = replace(prepared, keep=np.concatenate([prepared.keep[:5], prepared.keep[5:] + 1]))
    assert moved.thinning is None
    assert replace(prepared, keep=np.delete(prepared.keep, [7, 8, 30])).thinning is not None  # a gap in time
