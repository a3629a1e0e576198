"""What a page can zoom into: the values come back, long signals keep their extremes, stretches stay apart."""

from __future__ import annotations

import base64
import html
import json
import re
from typing import Any

import numpy as np
import pytest
from synthetic import arm, subject_of

from dynident.arrays import Array
from dynident.results.figures import TorqueBands, TorqueSignals, torque_chart
from dynident.results.figures.zoom import MISSING, Live, LivePlot, zoom_text
from dynident.results.report import Subject
from dynident.results.report.builder import render


def unpacked(text: str) -> Array:
    numbers = np.frombuffer(base64.b64decode(text), dtype="<u2").astype(float)
    return np.where(numbers == MISSING, np.nan, numbers / (MISSING - 1))


def values(mark: dict[str, Any], row: int = 0) -> Array:
    return mark["low"] + mark["span"] * unpacked(mark["v"][row])


def data_of(figure: str) -> dict[str, Any]:
    found = re.search(r'data-zoom="([^"]*)"', figure)
    assert found is not None
    return json.loads(html.unescape(found[1]))


def test_a_short_log_comes_back_to_sixteen_bits() -> None:
    time = np.arange(300) / 100.0
    measured, predicted = 30 * np.sin(time), 29 * np.sin(time + 0.02)
    measured[40:43] = np.nan
    bands = TorqueBands(0.1 + 0 * time, 1.0 + 0 * time)
    data = data_of(torque_chart("joint", "N m", TorqueSignals(time, measured, predicted, bands=bands), detail=1000))
    above, below = data["plots"]
    assert np.allclose(values(above["marks"][0]), measured, atol=60 / MISSING, equal_nan=True)
    assert np.allclose(values(below["marks"][2]), measured - predicted, atol=60 / MISSING, equal_nan=True)
    assert [(len(mark["v"]), mark.get("e", 0)) for mark in below["marks"]] == [(1, 1), (1, 1), (1, 0)]
    assert np.allclose(values(below["marks"][0]), 1.0, atol=1e-4)
    ((start, end, first, last),) = data["pieces"]
    assert np.allclose(first + unpacked(data["x"]) * (last - first), time, atol=3 / MISSING * 2)
    assert data["left"] == pytest.approx(start, abs=0.06) and data["right"] == pytest.approx(end, abs=0.06)


def test_a_long_signal_keeps_the_extremes_of_each_stretch_in_their_order() -> None:
    generator = np.random.default_rng(1)
    line = generator.normal(size=10_000)
    line[5000], line[7003] = 40.0, -50.0
    band = np.stack([line - 1.0, line + 1.0])
    plot = LivePlot(20.0, 100.0, (Live(1, line[None, :]), Live(0, band)))
    places = np.linspace(50.0, 450.0, 10_000)
    data = json.loads(zoom_text([plot], places, (0, 6001), [(50.0, 289.0, 0.0, 6.0), (290.0, 450.0, 0.0, 4.0)], 1000))
    kept, wide = (mark for mark in data["plots"][0]["marks"])
    found = values(kept)
    assert 1000 <= len(found) <= 1010 and len(unpacked(data["x"])) == len(found)
    assert found.max() == pytest.approx(40.0, abs=0.01) and found.min() == pytest.approx(-50.0, abs=0.01)
    pairs = found.reshape(-1, 2)
    for k in range(0, 300, 20):
        group = line[20 * k : 20 * k + 20]
        expected = sorted([int(np.argmin(group)), int(np.argmax(group))])
        assert np.allclose(pairs[k], group[expected], atol=0.01)
    assert data["cuts"] == [0, 2 * 301]
    assert np.all(values(wide, 0) <= found.reshape(-1, 2).min(axis=1).repeat(2) - 0.98)


def test_the_numbers_of_a_page_stay_within_their_budget() -> None:
    estimate, test = subject_of(arm([f"joint{k}" for k in range(1, 6)]), samples=4000, rate=1000.0)
    page = render(Subject(estimate, (test, test)), ["torques"])
    assert sum(map(len, re.findall(r'data-zoom="([^"]*)"', page))) < 1_100_000
