"""Figures of what the model leaves: residual over speed, its spectrum, and friction."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dynident.arrays import Array
from dynident.results.figures.chart import Across, Cloud, Line, Plot, chart
from dynident.results.text import label, pretty_unit

#: Rows that a stretch of speeds needs before its median says anything.
_ENOUGH = 20


def residual_chart(joint: str, unit: str, speed_unit: str, speed: Array, residual: Array) -> str:
    """Return the residual of a joint over its speed; a median that leaves zero is friction the model does not have.

    Args:
        joint: Name of the joint.
        unit: Of the residual, N m or N.
        speed_unit: rad/s or m/s.
        speed: Shape (N,).
        residual: Shape (N,).
    """
    middle, medians = running_median(speed, residual)
    marks = (Cloud("rows", speed, residual, 1), Line("median", middle, medians, 2, 2.0))
    plot = Plot(f"residual [{pretty_unit(unit)}]", marks, 170.0)
    said = f"Residual of {label(joint)} over its speed, {len(speed)} rows as density, and its median by speed."
    return chart(label(joint), said, Across(f"speed [{speed_unit}]", pad=0.02), [plot])


def running_median(x: Array, y: Array, bins: int = 31) -> tuple[Array, Array]:
    """Return the median of y in equal stretches of x and the middles of the stretches; those with few rows are NaN."""
    good = np.isfinite(x) & np.isfinite(y)
    x, y = x[good], y[good]
    if not len(x) or np.ptp(x) == 0:
        return np.zeros(0), np.zeros(0)
    edges = np.linspace(x.min(), x.max(), bins + 1)
    order = np.argsort(x)
    parts = np.split(y[order], np.searchsorted(x[order], edges[1:-1], side="right"))
    medians = np.array([np.median(part) if len(part) >= _ENOUGH else np.nan for part in parts])
    return (edges[:-1] + edges[1:]) / 2, medians


def spectrum(signal: Array, time: Array, starts: Sequence[int], longest: int = 4096) -> tuple[Array, Array]:
    """Return frequencies (K,), in Hz, and the amplitude density of each column (K, n), in its unit / sqrt(Hz).

    Mean over half-overlapping stretches under a Hann window (Welch 1967), a quarter of the shortest log long; sampled
    at the median rate of the first log. The constant part and the half of the rate are left out.

    Args:
        signal: Shape (N, n).
        time: Shape (N,), in s.
        starts: First sample of each log.
        longest: Rows of a stretch at most.
    """
    stops = [*starts[1:], len(signal)]
    shortest = min(stop - start for start, stop in zip(starts, stops, strict=True))
    size = min(longest, shortest // 4)
    if size < 16:
        return np.zeros(0), np.zeros((0, signal.shape[1]))
    rate = 1.0 / float(np.median(np.diff(time[starts[0] : stops[0]])))
    window = np.hanning(size)[:, None]
    power = np.zeros((size // 2 + 1, signal.shape[1]))
    count = 0
    for start, stop in zip(starts, stops, strict=True):
        for first in range(start, stop - size + 1, max(size // 2, 1)):
            part = signal[first : first + size]
            power += np.abs(np.fft.rfft((part - part.mean(axis=0)) * window, axis=0)) ** 2
            count += 1
    power *= 2.0 / (rate * float(np.sum(window**2)) * count)
    return np.fft.rfftfreq(size, 1.0 / rate)[1:-1], np.sqrt(power[1:-1])


def thinned(frequency: Array, density: Array, bands: int = 160) -> tuple[Array, Array]:
    """Return a spectrum averaged in bands of equal ratio, so that high frequencies do not fill the figure.

    Args:
        frequency: Shape (K,), rising, above zero.
        density: Amplitude densities, shape (K, n); averaged as power.
        bands: At most so many.
    """
    if len(frequency) < 2:
        return frequency, density
    band = np.floor(np.log(frequency / frequency[0]) / np.log(frequency[-1] / frequency[0]) * bands)
    starts = np.flatnonzero(np.concatenate([[True], np.diff(band) > 0]))
    counts = np.diff(np.append(starts, len(frequency)))
    middle = np.exp(np.add.reduceat(np.log(frequency), starts) / counts)
    return middle, np.sqrt(np.add.reduceat(density**2, starts, axis=0) / counts[:, None])


#: Even speeds of a curve, and as many near zero.
POINTS = 241


def friction_chart(
    drive: str, unit: str, speed_unit: str, speed: Array, torque: Array, curve: tuple[Array, Array]
) -> str:
    """Return the friction curve of a drive over the measured torque less the rigid-body part.

    Args:
        drive: Name of the joint.
        unit: N m or N.
        speed_unit: rad/s or m/s.
        speed: Speed of the drive in each row, shape (N,).
        torque: Measured torque less the rigid-body part, shape (N,).
        curve: Speeds (K,) and friction (K,) of the model.
    """
    marks = (Cloud("measured less rigid body", speed, torque, 1), Line("friction model", *curve, 2, 2.0))
    plot = Plot(f"friction [{pretty_unit(unit)}]", marks, 170.0)
    reach = float(np.max(np.abs(curve[1]), initial=0.0))
    said = f"Friction of {label(drive)} over speed: the model reaches {reach:.3g} {pretty_unit(unit)}."
    return chart(label(drive), said, Across(f"speed [{speed_unit}]", pad=0.02), [plot])


def speed_grid(speed: Array) -> Array:
    """Return speeds over the range of ``speed`` (N,), denser around zero where friction turns, shape (K,)."""
    if not len(speed):
        return np.zeros(0)
    low, high = float(np.min(speed)), float(np.max(speed))
    even = np.linspace(low, high, POINTS)
    near = 0.1 * max(abs(low), abs(high)) * np.linspace(-1, 1, POINTS) ** 3
    return np.unique(np.concatenate([even, near[(near >= low) & (near <= high)]]))
