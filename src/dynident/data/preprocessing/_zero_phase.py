"""A low-pass run forwards and backwards over signals: the answer of ``scipy.signal.sosfiltfilt``.

Ends are extended, turned about the end point (Gustafsson 1996 names the alternatives). The recursion is machine code of
our own: SciPy's filters take longer to load than most logs to filter.
"""

from __future__ import annotations

import numpy as np

from dynident.arrays import Array
from dynident.data.preprocessing._low_pass import LowPass, butterworth
from dynident.model.kernels.recurrence import Recurrence

#: Samples filtered at a time: they stay in the cache.
_BLOCK = 2048


def zero_phase(signals: Array, low_pass: LowPass, pad: int) -> Array:
    """Return signals, shape (k, N), filtered forwards and backwards.

    Args:
        signals: Shape (k, N), N > ``pad``.
        low_pass: The one-way filter.
        pad: Samples by which both ends are extended, turned about the end point.
    """
    recurrence = Recurrence(low_pass.sections, low_pass.settled)
    width, samples = recurrence.width, signals.shape[1]
    out = np.empty(signals.shape)
    block, ends = np.zeros((min(_BLOCK, samples), width)), np.zeros((pad, width))
    starts = range(0, samples, _BLOCK)
    for group in range(0, len(signals), width):
        own, found = signals[group : group + width].T, out[group : group + width].T
        many, first, part = own.shape[1], np.zeros(width), block
        first[:many] = own[0]
        ends[:, :many], ends[:, many:], block[:, many:] = 2.0 * own[:1] - own[pad:0:-1], 0.0, 0.0
        state = recurrence.state_of(ends[0] if pad else first)
        recurrence.run(ends, state)
        for start in starts:
            part = block[: min(_BLOCK, samples - start)]
            part[:, :many] = own[start : start + _BLOCK]
            recurrence.run(part, state)
            found[start : start + _BLOCK] = part[:, :many]
        ends[:, :many] = 2.0 * own[-1:] - own[-2 : -2 - pad : -1]
        recurrence.run(ends, state)
        state = recurrence.state_of(ends[-1] if pad else part[-1])
        recurrence.run(ends, state, backwards=True)
        for start in reversed(starts):
            part = block[: min(_BLOCK, samples - start)]
            part[:, :many] = found[start : start + _BLOCK]
            recurrence.run(part, state, backwards=True)
            found[start : start + _BLOCK] = part[:, :many]
    return out


def low_passed(columns: Array, order: int, cutoff: float, rate: float) -> Array:
    """Return columns (N, k) behind a zero-phase Butterworth, ends extended by three times its length."""
    pad = min(3 * (order + 1), len(columns) - 1)
    return zero_phase(columns.T, butterworth(order, cutoff, rate), pad).T
