"""A zero-phase filter at one sample in so many, without the samples between: a finite window, then a slow recursion.

A pole p of the filter is a pole p^M of every M-th sample: 1 / (1 - p/z) = (1 + p/z + ... + (p/z)^(M-1)) /
(1 - (p/z)^M). The sums of all poles and the zeros of the filter, forwards and backwards, make one symmetric window of
2 M P + 1 samples for P poles, evaluated at the wanted samples alone; what is left is a recursion over those (Martinez
and Parks 1979; Crochiere and Rabiner 1983, section 3.4).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from dynident.arrays import Array
from dynident.experiment.preprocessing._zero_phase import zero_phase
from dynident.model.kernels.jit import compiled

#: Taps of a phase that one pass over the outputs takes in.
_TAPS = 4


@dataclass(frozen=True)
class Thinning:
    """A Butterworth run forwards and backwards, at one sample in ``every``.

    Attributes:
        window: Weights about a wanted sample, shape (2 h + 1,), of sum one.
        sections: Second-order sections of the recursion over the wanted samples, shape (S, 6).
        every: Samples from one wanted sample to the next.
    """

    window: Array
    sections: Array
    every: int

    @property
    def half(self) -> int:
        """Samples to either side of a wanted one that the window takes, h."""
        return len(self.window) // 2

    def fold(self, signals: Array, out: Array, first: int, count: int) -> None:
        """Write the windowed samples h, h + every, ... of signals into columns first to first + count of ``out``.

        Args:
            signals: Shape (k, (count - 1) every + 2 h + 1).
            out: Shape (k, m).
            first: Column of the first.
            count: Number of them.
        """
        _fold(signals, self.window, self.every, out, first, count)

    def settle(self, folded: Array) -> Array:
        """Return the filter of windowed samples, shape (k, m); wrong near both ends, where the past is not known."""
        return zero_phase(folded, self.sections, 0)


def thinning(cutoff: float, order: int, rate: float, every: int) -> Thinning:
    """Return the filter of a cut-off in Hz and an order at one sample in ``every`` of ``rate`` samples a second."""
    import scipy.signal  # half a second, which designs and their worker processes spare

    design: Any = scipy.signal.butter(order, cutoff, fs=rate, output="zpk")
    zeros, poles = design[0], np.asarray(design[1])
    window = np.poly(zeros)
    for pole in poles:
        window = np.convolve(window, pole ** np.arange(every))
    window = np.real(window)
    window = np.convolve(window, window[::-1])
    return Thinning(window / window.sum(), _sections(poles**every), every)


def _sections(poles: Array) -> Array:
    """Return sections without zeros, each of gain one at rest; poles come in pairs or are real."""
    rounding = 1e-12
    pairs = [pole for pole in poles if pole.imag > rounding]
    single = [pole.real for pole in poles if abs(pole.imag) <= rounding]
    lower = [(-2.0 * pole.real, abs(pole) ** 2) for pole in pairs] + [(-pole, 0.0) for pole in single]
    return np.array([[1.0 + a1 + a2, 0.0, 0.0, 1.0, a1, a2] for a1, a2 in lower])


@compiled
def _fold(signals: Array, window: Array, every: int, out: Array, first: int, count: int) -> None:
    size, length = len(window), signals.shape[1]
    passes = (size // every + _TAPS) // _TAPS
    weights = np.zeros((every, _TAPS * passes))
    for k in range(size):
        weights[k % every, k // every] = window[k]
    # Samples whose number leaves the same remainder stand side by side, so that outputs fill vector registers.
    phases = np.zeros((every, count + _TAPS * passes + length // every))
    total = np.zeros(count)
    for c in range(len(signals)):
        row = signals[c]
        for m in range(every):
            for n in range((length - m + every - 1) // every):
                phases[m, n] = row[n * every + m]
        for n in range(count):
            total[n] = 0.0
        for m in range(every):
            for s in range(0, _TAPS * passes, _TAPS):
                w0, w1, w2, w3 = weights[m, s], weights[m, s + 1], weights[m, s + 2], weights[m, s + 3]
                own = phases[m, s : s + count + _TAPS]
                for n in range(count):
                    total[n] += w0 * own[n] + w1 * own[n + 1] + w2 * own[n + 2] + w3 * own[n + 3]
        for n in range(count):
            out[c, first + n] = total[n]
