"""Low-pass filters by their poles, run forwards and backwards over signals: the answer of ``scipy.signal.sosfiltfilt``.

Ends are extended, turned about the end point (Gustafsson 1996 names the alternatives). The recursion is machine code of
our own: SciPy's filters take longer to load than most logs to filter.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from dynident.arrays import Array, ComplexArray
from dynident.model.kernels.recurrence import Recurrence

#: Samples filtered at a time: they stay in the cache.
_BLOCK = 2048

#: An imaginary part below this is none.
_ROUNDING = 1e-12


@dataclass(frozen=True)
class LowPass:
    """A digital low-pass of gain one at rest.

    Attributes:
        poles: In pairs of conjugates, or real, all within the unit circle, shape (P,).
        zeros: Whether each pole has a zero at half the sampling rate beside it; else the filter has none.
    """

    poles: ComplexArray
    zeros: bool = True

    @cached_property
    def sections(self) -> Array:
        """Second-order sections b0, b1, b2, 1, a1, a2, each of gain one at rest, shape (S, 6)."""
        pairs = [pole for pole in self.poles if pole.imag > _ROUNDING]
        single = [pole.real for pole in self.poles if abs(pole.imag) <= _ROUNDING]
        lower = [(-2.0 * pole.real, abs(pole) ** 2, 2) for pole in pairs] + [(-pole, 0.0, 1) for pole in single]
        found = np.zeros((len(lower), 6))
        for row, (a1, a2, order) in zip(found, lower, strict=True):
            gain = 1.0 + a1 + a2
            upper = ((1.0,), (0.5, 0.5), (0.25, 0.5, 0.25))[order if self.zeros else 0]
            row[: len(upper)] = gain * np.array(upper)
            row[3:] = 1.0, a1, a2
        return found

    @cached_property
    def settled(self) -> Array:
        """State of the sections (transposed direct form II) after a constant of one, shape (S, 2)."""
        b, a = self.sections[:, :3], self.sections[:, 3:]
        second = b[:, 2] - a[:, 2]
        return np.column_stack([b[:, 1] - a[:, 1] + second, second])


@lru_cache(maxsize=32)
def butterworth(order: int, cutoff: float, rate: float) -> LowPass:
    """Return the Butterworth low-pass of a cut-off in Hz at ``rate`` samples a second, by the bilinear transform.

    The frequency of half power is kept by warping it (Oppenheim and Schafer 2010, section 7.2).
    """
    turns = np.exp(0.5j * np.pi * (1.0 + (2.0 * np.arange(order) + 1.0) / order))
    if order % 2:
        turns[order // 2] = -1.0  # the real one, without rounding
    analogue = np.tan(np.pi * cutoff / rate) * turns
    return LowPass((1.0 + analogue) / (1.0 - analogue))


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
