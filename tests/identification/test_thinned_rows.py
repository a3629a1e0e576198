"""The filter at one sample in so many: the rows that SciPy's filter over all samples has there."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest
import scipy.signal

from arm_models import theta_of
from dynident.arrays import Array
from dynident.data.log import Log
from dynident.data.preprocessing import FILTERS, Preprocessing, preprocess
from dynident.identification.problem import thinned_rows
from dynident.identification.problem.regressor_stream import RegressorStream
from dynident.model.base_parameters import base_parameters
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import FRICTION
from dynident.model.robot import Robot

MakeLog = Callable[..., Log]


@pytest.mark.parametrize(
    ("cutoff", "order", "rate", "every", "periods"),
    [
        (5.0, 4, 1000.0, 5, 60),
        (5.0, 4, 1000.0, 25, 60),
        (60.0, 5, 500.0, 7, 60),
        (2.0, 1, 100.0, 2, 60),
        (5.0, 4, 1000.0, 7, 3.5),  # shorter than what the filter remembers
        (20.0, 8, 1000.0, 3, 12),
        (190.0, 7, 1000.0, 2, 200),
    ],
)
@pytest.mark.parametrize("part", [(0.0, 1.0), (0.07, 0.4), (0.35, 0.65), (0.6, 0.97)])
def test_kept_samples_are_those_of_the_filter_of_scipy(
    cutoff: float, order: int, rate: float, every: int, periods: float, part: tuple[float, float]
) -> None:
    samples = int(periods * rate / cutoff)
    signals = np.random.default_rng(order).normal(size=(7, samples)).cumsum(axis=1) + 30.0
    sections = scipy.signal.butter(order, cutoff, fs=rate, output="sos")
    wanted = scipy.signal.sosfiltfilt(sections, signals, axis=-1, padlen=int(3 * rate / cutoff))
    thin = FILTERS.make("butterworth", {"cutoff_hz": cutoff, "order": order}).thinning(rate, every)
    assert thin is not None
    keep = np.arange(int(part[0] * samples), int(part[1] * samples), every)
    keep = np.delete(keep, slice(len(keep) // 3, len(keep) // 3 + 2))

    def make(rows: slice, blocks: Sequence[Array]) -> None:
        for block, own in zip(blocks, (signals[:4], signals[4:]), strict=True):
            block[:-1], block[-1] = own[:, rows], 0.0

    found = np.concatenate(thinned_rows.thinned_rows(make, (4, 3), samples, keep, thin))
    assert np.abs(found - wanted[:, keep]).max() < 1e-10 * np.abs(wanted).max()


def test_filters_of_nearby_poles_are_not_thinned() -> None:
    for cutoff, order in ((5.0, 9), (210.0, 4)):
        assert FILTERS.make("butterworth", {"cutoff_hz": cutoff, "order": order}).thinning(1000.0, 3) is None


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
