"""Figures: what is drawn where, labels that do not touch, text alternatives, and names that are only text."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
import scipy.signal
from drawings import check_labels, labels, lines, named, parsed, points
from hypothesis import given, settings
from hypothesis import strategies as st

from dynident.arrays import Array
from dynident.results.figures import (
    Intervals,
    TorqueBands,
    TorqueSignals,
    convergence_chart,
    error_chart,
    friction_chart,
    interval_chart,
    line_chart,
    residual_chart,
    small_torque_chart,
    torque_chart,
    trajectory_chart,
)
from dynident.results.figures.chart import Level
from dynident.results.figures.residuals import running_median, spectrum, speed_grid, thinned
from dynident.results.figures.signals import run_time

GENERATOR = np.random.default_rng(5)
TIME = np.arange(3000) / 100
SIGNAL = 30 * np.sin(0.7 * TIME) + GENERATOR.normal(0, 2, len(TIME))
MODEL = 30 * np.sin(0.7 * TIME)
SPEED = 0.8 * np.cos(0.7 * TIME)


@cache
def figures(size: float = 1.0) -> dict[str, Callable[[], str]]:
    """Return every figure of the package with data of a given size, by name."""
    name, *_ = names = [f"joint{k}" for k in range(1, 9)]
    many = size * np.column_stack([np.sin((k + 1) * TIME / 5) for k in range(8)])
    starts = (0, 1000, 2200)
    parts = (("training", False), ("training", False), ("test", True))
    grid = speed_grid(SPEED)
    fractions = np.array([np.nan, 40.0, 2.0, 0.5, 0.09, 1e-3, 1e-6, 0.0])
    values = np.array([5.0, -4.0, 3.0, 2.0, -1.0, 0.1, 1e-7, 0.0])
    spread = np.array([0.1, 0.5, 50.0, np.inf, np.nan, 1e-9, 0.2, 0.1])
    kinds = ["revolute"] * 7 + ["prismatic"]
    return {
        "torque": lambda: torque_chart(name, "N m", TorqueSignals(TIME, size * SIGNAL, size * MODEL)),
        "torque, three logs": lambda: torque_chart(
            name, "N", TorqueSignals(TIME, size * SIGNAL, size * MODEL, starts, None, parts)
        ),
        "trajectory": lambda: trajectory_chart(name, names, kinds, TIME, many, many, starts),
        "positions": lambda: trajectory_chart(name, names[:1], ["prismatic"], TIME, many[:, :1]),
        "lines": lambda: line_chart(name, [(n, TIME, many[:, 0]) for n in names], "time [s]", "force [N]"),
        "residual": lambda: residual_chart(name, "N m", "rad/s", size * SPEED, size * (SIGNAL - MODEL)),
        "friction": lambda: friction_chart(name, "N", "m/s", SPEED, size * SIGNAL, (grid, size * np.tanh(grid / 0.02))),
        "convergence": lambda: convergence_chart(
            {name: list(size * (1 + 99 * np.exp(-TIME))), "b": [9 * size] * 5}, size
        ),
        "narrow convergence": lambda: convergence_chart(
            {name: [size * 1.2, size * 1.1]}, size, f"objective of {name}"[:30]
        ),
        "small torque": lambda: small_torque_chart(name, "N m", TIME, size * SIGNAL, size * MODEL, starts),
        "errors": lambda: error_chart("errors", names, [("robot model", 3.0 * fractions), ("identified", fractions)]),
        "intervals": lambda: interval_chart("In kg", "kg", Intervals(tuple(names), size * values, size * spread)),
    }


@pytest.mark.parametrize("which", figures())
@pytest.mark.parametrize("size", [1.0, 3.7e-6, 4.4e7])
def test_labels_do_not_touch_and_stay_inside(which: str, size: float) -> None:
    check_labels(figures(size=size)[which]())


@settings(max_examples=25, deadline=None)
@given(st.floats(-1e4, 1e4), st.floats(1e-3, 1e4), st.integers(1, 12), st.sampled_from([0.0, 16.7, 1.7e9]))
def test_any_range_of_torque_and_time_gives_labels_that_do_not_touch(
    middle: float, size: float, logs: int, start: float
) -> None:
    starts = tuple(np.linspace(0, len(TIME), logs, endpoint=False).astype(int).tolist())
    parts = tuple((("training", False), ("test 1", True))[k > logs // 2] for k in range(logs))
    signals = TorqueSignals(TIME + start, middle + size * SIGNAL, middle + size * MODEL, starts, None, parts)
    check_labels(torque_chart("joint1", "N m", signals))


def test_measured_and_predicted_share_a_scale_and_the_residual_stands_below() -> None:
    root = parsed(torque_chart("j", "N m", TorqueSignals(TIME, SIGNAL, MODEL)))
    (measured,), (predicted,), (residual,) = (lines(root, name) for name in ("c1", "c2", "c3"))
    (first,), (second,), (third,) = points(measured), points(predicted), points(residual)
    assert first[[0, -1], 0] == pytest.approx(second[[0, -1], 0])
    assert first[[0, -1], 0] == pytest.approx(third[[0, -1], 0])
    ticks = {box.text: (box.top + box.bottom) / 2 for box in labels(root)}
    unit = (ticks["-40"] - ticks["40"]) / 80
    extent = (first[:, 1].max() - first[:, 1].min()) / unit
    assert extent == pytest.approx(np.ptp(SIGNAL), rel=0.02)
    assert (second[:, 1].max() - second[:, 1].min()) / unit == pytest.approx(60.0, rel=0.02)
    assert third[:, 1].min() > first[:, 1].max()


def test_bands_lie_about_the_zero_of_the_residual() -> None:
    half = np.full(len(TIME), 3.0)
    wide, narrow = 2 * half, half
    root = parsed(torque_chart("j", "N m", TorqueSignals(TIME, SIGNAL, MODEL, (0, 1000), TorqueBands(narrow, wide))))
    residual = np.concatenate([points(data)[0] for data in lines(root, "c3")])
    spans = []
    for name in ("d0", "d1"):
        found = [node.get("d", "") for node in root.iter() if node.get("class") == name]
        areas = [points(data.rstrip("z"))[0] for data in found if "h" not in data]  # the sign of the legend has one
        assert len(areas) == 2
        spans.append([np.ptp(area[:, 1]) for area in areas])
    assert spans[0] == pytest.approx(2 * np.array(spans[1]), abs=0.3)
    assert np.ptp(residual[:, 1]) / spans[1][0] == pytest.approx(np.ptp(SIGNAL - MODEL) / 6.0, rel=0.05)


def test_what_static_friction_can_hold_is_shaded_and_no_residual() -> None:
    rests = TIME > TIME[len(TIME) // 2]
    held = tuple(np.where(rests, side, MODEL) for side in (SIGNAL - 2.0, SIGNAL + 2.0))
    signals = TorqueSignals(TIME, SIGNAL, MODEL, held=(held[0], held[1]))
    np.testing.assert_array_equal(signals.residual, np.where(rests, 0.0, SIGNAL - MODEL))
    drawing = torque_chart("j", "N m", signals)
    assert "static friction" in drawing and "at rest beyond static friction" in drawing
    areas = [node.get("d", "") for node in parsed(drawing).iter() if node.get("class") == "d2"]
    (area,) = [points(data.rstrip("z"))[0] for data in areas if "h" not in data]  # the sign of the legend has one
    assert len(area) > 2 and np.ptp(area[:, 1]) > 0
    assert "static friction" not in torque_chart("j", "N m", TorqueSignals(TIME, SIGNAL, MODEL))


def test_a_gap_stands_between_logs() -> None:
    root = parsed(torque_chart("j", "N m", TorqueSignals(TIME, SIGNAL, MODEL, (0, 1000, 2200))))
    stretches = [points(data)[0] for data in lines(root, "c2")]
    assert len(stretches) == 3
    assert all(9 < b[0, 0] - a[-1, 0] < 11 for a, b in pairwise(stretches))
    widths = [np.ptp(stretch[:, 0]) for stretch in stretches]
    assert widths[1] / widths[0] == pytest.approx(1.2, rel=0.01)


def test_many_logs_share_a_step_and_have_two_ticks_each() -> None:
    starts = tuple(range(0, 3000, 430))
    signals = TorqueSignals(np.tile(np.arange(430) / 10, 7)[:3000], SIGNAL, MODEL, starts)
    root = parsed(torque_chart("j", "N m", signals))
    below = [box.text for box in labels(root) if box.top > 300 and "[" not in box.text]
    assert below.count("0") == 7
    assert below.count("20") >= 5


def test_the_time_of_a_clock_is_counted_from_the_start_of_each_log() -> None:
    clock = np.concatenate([1.7e9 + TIME[:100], 1.8e9 + TIME[:50]])
    assert run_time(clock, (0, 100))[[0, 99, 100, 149]] == pytest.approx([0.0, 0.99, 0.0, 0.49], abs=1e-6)
    assert run_time(TIME + 16.7, (0,))[0] == pytest.approx(16.7)


def test_sliding_joints_have_a_plot_of_their_own() -> None:
    root = parsed(
        trajectory_chart("t", ["a", "b"], ["revolute", "prismatic"], TIME, np.zeros((3000, 2)), np.zeros((3000, 2)))
    )
    headings = [box.text for box in labels(root) if "[" in box.text]
    assert headings == ["position [rad]", "position [m]", "speed [rad/s]", "speed [m/s]", "time [s]"]


def test_every_line_has_its_own_look() -> None:
    many = [(f"line {k}", TIME, np.full(len(TIME), float(k))) for k in range(14)]
    root = parsed(line_chart("t", many, "x", "y"))
    looks = [
        (path.attrib["class"], path.get("stroke-dasharray"))
        for path in named(root, "path")
        if max(np.ptp(part[:, 0]) for part in points(path.attrib["d"])) > 19
    ]
    assert len(looks) == 14
    assert len(set(looks)) == 14


def test_a_line_that_is_not_there_is_no_line() -> None:
    nothing = np.full(len(TIME), np.nan)
    check_labels(torque_chart("j", "N m", TorqueSignals(TIME, nothing, nothing)))
    check_labels(line_chart("t", [("a", np.zeros(0), np.zeros(0))], "x", "y", levels=[Level(3.0, "three")]))


def test_the_optimum_is_a_line_of_its_own_height() -> None:
    root = parsed(convergence_chart({"abc": [10.0, 8.0, 6.0, 5.0]}, 4.0, "objective [N m]"))
    assert "optimum 4.000" in [box.text for box in labels(root)]
    (line,) = [path for path in named(root, "path") if path.get("stroke-dasharray")]
    ((start, end),) = points(line.attrib["d"])
    assert start[1] == end[1] > max(part[:, 1].max() for data in lines(root, "c1") for part in points(data))


def test_bars_of_errors_start_at_zero_and_grow_with_the_error() -> None:
    root = parsed(error_chart("e", ["a", "b"], [("nominal", np.array([0.2, 0.1])), ("fit", np.array([0.05, np.nan]))]))
    ends = {
        name: [
            float(data.split("H")[1].split("v")[0]) - float(data[1:].split(" ")[0])
            for path in named(root, "path")
            if path.get("class") == name and "H" in (data := path.attrib["d"])
        ]
        for name in ("d0", "d2")
    }
    assert ends["d0"][0] == pytest.approx(2 * ends["d0"][1], abs=0.3)
    assert ends["d2"] == [pytest.approx(0.5 * ends["d0"][1], abs=0.3), 0.0]


def test_an_interval_that_holds_zero_is_a_ring_and_one_beyond_the_axis_an_arrow() -> None:
    found = Intervals(("sure", "unsure", "vast"), np.array([4.0, 2.0, 1.0]), np.array([0.5, 2.5, 1e3]))
    assert found.clear.tolist() == [True, False, False]
    root = parsed(interval_chart("t", "kg", found))
    paths = [(path.get("class"), path.attrib["d"]) for path in named(root, "path")]
    dots = [name for name, data in paths if "a3.5" in data]
    assert dots == ["d1", "c0", "c0"]
    spans = [part[0] for name, data in paths if "a3.5" not in data for part in [points(data)] if len(part[0]) == 2]
    lengths = [float(np.ptp(span[:, 0])) for span in spans]
    assert lengths[1] == pytest.approx(5 * lengths[0], rel=0.02)
    tips = [points(data)[0] for _, data in paths if "a3.5" not in data and len(points(data)[0]) == 3]
    assert [bool(np.ptp(tip[:, 0])) for tip in tips] == [False, False, False, False, True, True]


def test_a_test_is_shaded_and_named_and_alike_stretches_share_a_name() -> None:
    parts = (("training", False), ("training", False), ("test", True))
    root = parsed(torque_chart("j", "N m", TorqueSignals(TIME, SIGNAL, MODEL, (0, 1000, 2200), None, parts)))
    texts = [box.text for box in labels(root)]
    assert texts.count("training") == texts.count("test") == 1
    shades = [path.attrib["d"] for path in named(root, "path") if path.get("fill-opacity") == "0.06"]
    predicted = [points(data)[0] for data in lines(root, "c2")]
    assert len(shades) == 2  # the torque and the residual
    assert float(shades[0][1:].split(" ")[0]) == pytest.approx(predicted[2][0, 0], abs=0.1)


def test_the_spectrum_is_that_of_welch() -> None:
    signal = GENERATOR.normal(size=(5000, 2)) + np.sin(2 * np.pi * 7 * np.arange(5000) / 100)[:, None]
    frequency, density = spectrum(signal, np.arange(5000) / 100, (0,), longest=512)
    window: Any = np.hanning(512)
    known, power = scipy.signal.welch(
        signal, 100.0, window=window, nperseg=512, noverlap=256, detrend="constant", axis=0
    )
    assert frequency == pytest.approx(known[1:-1])
    assert density**2 == pytest.approx(power[1:-1])
    middle, banded = thinned(frequency, density)
    assert len(middle) < 165
    assert np.all(np.diff(middle) > 0)
    assert frequency[np.argmax(density[:, 0])] == pytest.approx(7.0, abs=0.2)
    assert middle[np.argmax(banded[:, 0])] == pytest.approx(7.0, abs=0.3)


def test_the_spectrum_of_several_logs_knows_where_they_end() -> None:
    time = np.concatenate([np.arange(2048) / 100, np.arange(2048) / 100])
    steps = np.concatenate([np.full(2048, -5.0), np.full(2048, 5.0)])[:, None]
    assert spectrum(steps, time, (0, 2048))[1].max() < 1e-12
    assert spectrum(steps, time, (0, 4090))[0].size == 0


def median_by_hand(x: Array, y: Array, bins: int) -> list[float]:
    """Return the medians of equal stretches, one by one."""
    edges = np.linspace(x.min(), x.max(), bins + 1)
    found = []
    for k in range(bins):
        inside = (x >= edges[k]) & ((x < edges[k + 1]) | (k == bins - 1))
        found.append(float(np.median(y[inside])) if inside.sum() >= 20 else np.nan)
    return found


def test_running_median() -> None:
    x, y = GENERATOR.normal(size=2000), GENERATOR.normal(size=2000)
    middle, medians = running_median(x, np.where(x > 3, np.nan, y), bins=9)
    assert len(middle) == 9
    keep = x <= 3
    assert medians == pytest.approx(median_by_hand(x[keep], y[keep], 9), nan_ok=True)
    assert running_median(np.ones(5), y[:5])[0].size == 0


def test_speeds_of_a_friction_curve_are_dense_around_zero() -> None:
    grid = speed_grid(np.array([-2.0, 1.0]))
    assert (grid[0], grid[-1]) == (-2.0, 1.0)
    assert np.diff(grid)[np.abs(grid[:-1]) < 0.01].max() < 1e-3
    assert speed_grid(np.zeros(0)).size == 0
