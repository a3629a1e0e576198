"""Rules over neighbouring samples: central differences and the article's five-point smoothing."""

from __future__ import annotations

import numpy as np

from dynident.arrays import Array


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
