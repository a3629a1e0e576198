"""A zero-phase filter at one sample in so many, without the samples between: a finite window, then a slow recursion.

A pole p of the filter is a pole p^M of every M-th sample: 1 / (1 - p/z) = (1 + p/z + ... + (p/z)^(M-1)) /
(1 - (p/z)^M). The sums of all poles and the zeros of the filter, forwards and backwards, make one symmetric window of
2 M P + 1 samples for P poles, evaluated at the wanted samples alone; what is left is a recursion over those (Martinez
and Parks 1979; Crochiere and Rabiner 1983, section 3.4).

Beyond the ends a filter forwards and backwards sees the signal turned about its end point and then a constant; only the
way back begins at rest at the last output, which takes off what the way there had still left: one amplitude a pole.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from dynident.arrays import Array, IntArray
from dynident.data.preprocessing._zero_phase import LowPass, butterworth, zero_phase

#: Order at most, and cut-off at most as a share of the sampling rate: beyond them residues of the poles lose digits.
HIGHEST_ORDER, HIGHEST_CUTOFF = 8, 0.2


@dataclass(frozen=True)
class Thinning:
    """A Butterworth run forwards and backwards, at one sample in ``every``.

    Attributes:
        window: Weights about a wanted sample, shape (2 h + 1,), of sum one.
        recursion: What is left of the filter, over the wanted samples.
        every: Samples from one wanted sample to the next.
        filter: The filter one way, over all samples.
        reach: Samples after which it has forgotten.
        pad: Samples by which both ends are turned about the end point at most.
    """

    window: Array
    recursion: LowPass
    every: int
    filter: LowPass
    reach: int
    pad: int

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
        early, late = self._products
        blocks, (span, outputs) = -(-count // early.shape[1]), early.shape
        padded = np.zeros((len(signals), (blocks + 1) * span))
        padded[:, : signals.shape[1]] = signals[:, : padded.shape[1]]
        parts = padded.reshape(len(signals), blocks + 1, span)
        found = parts[:, :-1] @ early
        found += parts[:, 1:] @ late
        out[:, first : first + count] = found.reshape(len(signals), blocks * outputs)[:, :count]

    @cached_property
    def _products(self) -> tuple[Array, Array]:
        """From the samples of a block, and those of the next, to its outputs: as many as two blocks hold the window."""
        size, every = len(self.window), self.every
        outputs = max(1, -(-(size - 1) // every))
        found = np.zeros((2 * outputs * every, outputs))
        for k in range(outputs):
            found[k * every : k * every + size, k] = self.window
        return np.ascontiguousarray(found[: outputs * every]), np.ascontiguousarray(found[outputs * every :])

    def settle(self, folded: Array) -> Array:
        """Return the filter of windowed samples, shape (k, m); wrong near both ends, where the past is not known."""
        return zero_phase(folded, self.recursion, 0)

    @cached_property
    def powers(self) -> Array:
        """Powers 0 to ``reach`` of the poles, real parts and then imaginary ones, shape (reach + 1, 2 P).

        The signal, latest sample first, times these from 1 on is what the way there has left after its last sample.
        """
        powers = self.filter.poles ** np.arange(self.reach + 1)[:, None]
        return np.concatenate([powers.real, powers.imag], axis=1)

    def last_outputs(self, left: Array, to_end: IntArray) -> Array:
        """Return what the way back takes off because it begins at rest, shape (k, m).

        Args:
            left: The signals less their last value, times :attr:`powers` from 1 on, shape (k, 2 P).
            to_end: Samples from each wanted sample to the last one of the signal and its extension, shape (m,).
        """
        poles = self.filter.poles
        count = len(poles)
        apart = 1.0 - poles / poles[:, None] + np.eye(count)
        residues = np.prod((1.0 - poles) / 2.0) * (1.0 + 1.0 / poles) ** count / np.prod(apart, axis=1)
        both = poles[:, None] * poles
        after = residues[:, None] * (both / (1.0 - both) - poles[:, None] / (1.0 - poles[:, None]))
        amplitudes = ((left[:, :count] + 1j * left[:, count:]) * residues) @ after.T
        return np.concatenate([amplitudes.real, -amplitudes.imag], axis=1) @ self.powers[to_end].T


def thinning(cutoff: float, order: int, rate: float, every: int, reach: int, pad: int) -> Thinning | None:
    """Return the filter of a cut-off in Hz and an order at one sample in ``every`` of ``rate`` samples a second.

    None where its poles are too near to each other, or to zero, to be taken one by one.

    Args:
        cutoff: In Hz.
        order: Of the filter one way.
        rate: Samples a second.
        every: Samples from one wanted sample to the next.
        reach: Samples after which the filter has forgotten.
        pad: Samples by which both ends are turned about the end point at most.
    """
    if order > HIGHEST_ORDER or cutoff > HIGHEST_CUTOFF * rate:
        return None
    filter = butterworth(order, cutoff, rate)
    window = np.poly(-np.ones(order))
    for pole in filter.poles:
        window = np.convolve(window, pole ** np.arange(every))
    window = np.real(window)
    window = np.convolve(window, window[::-1])
    recursion = LowPass(filter.poles**every, zeros=False)
    return Thinning(window / window.sum(), recursion, every, filter, reach, pad)
