"""Scales and ticks: round numbers, inside the range, evenly spaced, and written as what they are."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dynident.results.figures.scales import Linear, LogScale, finite_range, round_step, upright, upright_log, write_tick

sizes = st.floats(1e-7, 1e7)
centres = st.floats(-1e3, 1e3)


@given(st.floats(1e-12, 1e12))
def test_a_step_is_1_2_2_5_or_5_times_a_power_of_ten(least: float) -> None:
    step = round_step(least)
    assert least * (1 - 1e-9) <= step <= 2.5 * least
    mantissa = float(f"{step:.6e}".split("e")[0])
    assert mantissa in (1.0, 2.0, 2.5, 5.0)


@given(centres, sizes)
def test_linear_ticks(share: float, size: float) -> None:
    low = share * size
    scale = Linear(low, low + size, 300.0, 0.0)
    ticks = scale.ticks(30.0)
    values = np.array([tick.value for tick in ticks])
    assert 2 <= len(ticks) <= 11
    assert np.all((values >= low - 1e-6 * size) & (values <= low + size * (1 + 1e-6)))
    assert np.ptp(np.diff(values)) <= 1e-6 * size
    texts = [float(tick.text) for tick in ticks]
    assert np.allclose(texts, values, atol=1e-6 * size, rtol=1e-9)
    assert len({tick.text for tick in ticks}) == len(ticks)


@given(centres, sizes)
def test_an_upright_scale_ends_at_ticks_and_holds_the_data(share: float, size: float) -> None:
    low = share * size
    scale = upright(low, low + size, 150.0, 0.0)
    ticks = scale.ticks(30.0)
    assert scale.low <= low + 1e-5 * size
    assert scale.high >= low + size * (1 - 1e-5)
    assert ticks[0].value == pytest.approx(scale.low, abs=1e-6 * size)
    assert ticks[-1].value == pytest.approx(scale.high, abs=1e-6 * size)
    assert scale.high - scale.low <= 2.5 * size
    gaps = np.abs(np.diff(scale.at(np.array([tick.value for tick in ticks]))))
    assert gaps.min() > 15.0


@given(st.floats(1e-9, 1e9), st.floats(1.01, 1e9))
def test_log_scales_hold_the_data_and_have_round_ticks(low: float, ratio: float) -> None:
    scale = upright_log(low, low * ratio, 150.0, 0.0)
    assert scale.low <= low * (1 + 1e-6)
    assert scale.high >= low * ratio * (1 - 1e-6)
    ticks = scale.ticks(30.0)
    assert len(ticks) >= 1
    for tick in ticks:
        assert float(tick.text) == pytest.approx(tick.value)
        assert float(f"{tick.value:.6e}".split("e")[0]) in (1.0, 2.0, 5.0)


@pytest.mark.parametrize("ends", [(0.6, 19.4), (0.0, 10.0), (0.62, 5.1), (2.1, 2.9), (-0.7, 0.8)])
def test_a_short_axis_has_two_ticks(ends: tuple[float, float]) -> None:
    assert 2 <= len(Linear(*ends, 0.0, 90.0).ticks(64.0)) <= 4
    assert 5 <= len(Linear(*ends, 0.0, 640.0).ticks(64.0)) <= 11


def test_places() -> None:
    assert Linear(0.0, 10.0, 100.0, 0.0).at(np.array([0.0, 2.5, 10.0])).tolist() == [100.0, 75.0, 0.0]
    places = LogScale(1.0, 100.0, 0.0, 10.0).at(np.array([1.0, 10.0, 100.0, 0.0, -3.0]))
    assert places[:3] == pytest.approx([0.0, 5.0, 10.0])
    assert np.isnan(places[3:]).all()


def test_how_ticks_are_written() -> None:
    written = [
        write_tick(v, s) for v, s in ((0.0, 5.0), (2.5, 2.5), (5.0, 2.5), (75.0, 25.0), (0.3, 0.1), (-0.05, 0.05))
    ]
    assert written == ["0", "2.5", "5.0", "75", "0.3", "-0.05"]
    assert [write_tick(v, s) for v, s in ((250000.0, 50000.0), (1e-5, 1e-5), (3e7, 1e7))] == ["2.5e5", "1e-5", "3e7"]


def test_ranges_without_an_extent() -> None:
    assert finite_range() == (0.0, 1.0)
    assert finite_range(np.array([np.nan, np.inf])) == (0.0, 1.0)
    assert finite_range(np.zeros(3)) == (-0.5, 0.5)
    assert finite_range(np.array([4.0, np.nan])) == (2.0, 6.0)
    assert finite_range(np.array([1.0, np.nan]), np.array([-2.0])) == (-2.0, 1.0)
