"""The commanded motion of a log, with its derivatives: states that no measurement noise is in."""

from __future__ import annotations

from typing import Any

import numpy as np

from dynident.arrays import Array
from dynident.data.log import Log
from dynident.errors import LogMismatch


def commanded_motion(log: Log) -> Array:
    """Return the commanded q, dq and ddq of a preprocessed log, shape (3, N, n).

    Raises:
        LogMismatch: The log has no commanded positions.
    """
    if log.q_ref is None:
        advice = "map q_ref in the case file, or choose reference: measured"
        raise LogMismatch(log.name, "no commanded positions", advice)
    motion = spline_derivatives(log.q_ref, (log.samples - 1) / log.duration)
    if log.dq_ref is not None:
        motion[1] = log.dq_ref
    return motion


def spline_derivatives(rows: Array, rate: float) -> Array:
    """Return a signal (N, n) and its first two derivatives by the quintic spline through it, shape (3, N, n)."""
    time = np.arange(len(rows)) / rate
    import scipy.interpolate  # loads slowly

    spline: Any = scipy.interpolate.make_interp_spline(time, rows, k=5)
    return np.stack([rows, spline.derivative(1)(time), spline.derivative(2)(time)])
