"""Rules over neighbouring samples: central differences, five-point smoothing, shifts by parts of a sample."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from dynident.arrays import Array, IntArray
from dynident.data.log import Log


def central_differences(signal: Array, rate: float) -> Array:
    """Return the derivative of a uniform signal, shape (N, n), by central differences, one-sided at the ends."""
    return np.gradient(signal, 1.0 / rate, axis=0, edge_order=2)


def five_point_smoothing(signal: Array, repeats: int = 1) -> Array:
    """Return (17) applied ``repeats`` times to each column: the local cubic least-squares fit over five samples.

    Args:
        signal: Shape (N,) or (N, n) with N >= 5.
        repeats: How often.
    """
    y = np.asarray(signal, dtype=float)
    for _ in range(repeats):
        out = np.empty_like(y)
        out[0] = (69 * y[0] + 4 * (y[1] + y[3]) - 6 * y[2] - y[4]) / 70
        out[1] = (2 * (y[0] + y[4]) + 27 * y[1] + 12 * y[2] - 8 * y[3]) / 35
        out[2:-2] = (-3 * (y[:-4] + y[4:]) + 12 * (y[1:-3] + y[3:-1]) + 17 * y[2:-2]) / 35
        out[-2] = (2 * (y[-5] + y[-1]) - 8 * y[-4] + 12 * y[-3] + 27 * y[-2]) / 35
        out[-1] = (-y[-5] + 4 * (y[-4] + y[-2]) - 6 * y[-3] + 69 * y[-1]) / 70
        y = out
    return y


#: Points of the polynomial through the samples around each new one; it is exact for polynomials of one degree less.
POINTS = 8


def shifted(log: Log, delay_s: float) -> Log:
    """Return the log with q, dq and ddq of the time ``delay_s`` earlier; torques and time stay as they are.

    The motion is smooth where the torque is not, so it is the motion that is moved. Beyond the ends the first and last
    sample stand in.
    """
    moved = {
        name: fractional_shift(values, delay_s * log.rate)
        for name, values in log.signals().items()
        if name in ("q", "dq", "ddq")
    }
    return replace(log.with_step(f"motion shifted by {delay_s * 1e3:.4g} ms to align it with the torque"), **moved)


def fractional_shift(signal: Array, samples: float, rows: IntArray | None = None) -> Array:
    """Return a signal (N, k) as it was ``samples`` steps earlier, by local polynomials (Lagrange 1795).

    Where ``rows`` (m,) are given, only there.
    """
    whole = int(np.floor(samples))
    nodes = np.arange(POINTS) - POINTS // 2 + 1
    place = whole - samples  # where the new sample is among the nodes, in (-1, 0]
    index = (np.arange(len(signal)) if rows is None else rows) - whole
    found = np.zeros((len(index), signal.shape[1]))
    for node in nodes:
        others = nodes[nodes != node]
        weight = float(np.prod((place - others) / (node - others)))
        if weight:
            found += weight * np.take(signal, index + node, axis=0, mode="clip")
    return found
