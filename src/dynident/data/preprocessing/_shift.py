"""Motion and torque of a log brought together where one lags behind the other by a fraction of a sample or many."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from dynident.arrays import Array, IntArray
from dynident.data.log import Log

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
            found += weight * signal[np.clip(index + node, 0, len(signal) - 1)]
    return found
