"""How often a signal rises above a level: peaks over a threshold, beyond what the log itself has seen.

Peaks of |s| over a high level are nearly independent; x = s^2 / 2 of them follows a generalised Pareto distribution
(Pickands 1975), here by probability-weighted moments (Hosking and Wallis 1987, (14)). Normal noise has shape 0 and
scale 1 in x (Rice 1945). Rising above u happens rate * (1 + k (u^2 / 2 - level) / scale)^(-1 / k) times a second.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dynident.arrays import Array
from dynident.errors import LogMismatch

#: Share of the samples below the level.
QUANTILE = 0.95

#: Peaks that a fit needs at least.
FEWEST = 20

#: Peaks above a level that the log must have seen for its own shape to hold there. Beyond it the shape is at least that
#: of normal noise and the scale a share of the log's: a few peaks may look as if they ended.
SEEN, LIGHTEST, LEAST = 3.0, 0.0, 0.25

#: Largest shape of the tail: beyond it levels of rare events mean nothing.
HEAVIEST = 0.5

#: Variance of a shape near 0, times the number of peaks (Hosking and Wallis 1987, table 2).
SCATTER = 4.0 / 3.0


@dataclass(frozen=True)
class Tail:
    """The peaks of a signal s, in x = s^2 / 2.

    Attributes:
        level: Above which they are peaks.
        rate: Peaks a second.
        scale: Of the generalised Pareto distribution.
        shape: k; 0 as normal noise has, below 0 one that ends.
        seconds: Length of what they were found in.
    """

    level: float
    rate: float
    scale: float
    shape: float
    seconds: float

    def threshold(self, rate: float) -> float:
        """Return the size of the signal that is risen above ``rate`` times a second.

        Beyond what the log has seen a few times the tail goes on like that of normal noise, or heavier.
        """
        seen = SEEN / self.seconds
        if rate >= seen or self.shape >= LIGHTEST or seen >= self.rate:
            return _size(self.level + self.scale * _stretched(self.rate / rate, self.shape))
        reached = self.level + self.scale * _stretched(self.rate / seen, self.shape)
        scale = max(self.scale + self.shape * (reached - self.level), LEAST * self.scale)
        return _size(reached + scale * _stretched(seen / rate, LIGHTEST))

    @property
    def count(self) -> float:
        """Number of the peaks."""
        return self.rate * self.seconds


def shrunk(tails: Sequence[Tail]) -> tuple[Tail, ...]:
    """Return tails whose shapes are drawn to that of normal noise as far as their scatter explains the difference.

    The shapes are taken for normal about 0, their variance by the joints together (Efron and Morris 1975): a few peaks
    do not make a tail heavy or light, and many do.
    """
    scatter = np.array([SCATTER / tail.count for tail in tails])
    shapes = np.array([tail.shape for tail in tails])
    spread = max(float(np.mean(shapes**2 - scatter)), 0.0)
    kept = shapes * spread / (spread + scatter)
    return tuple(
        replace(tail, shape=float(shape), scale=tail.scale * (1.0 - float(shape)) / (1.0 - tail.shape))
        for tail, shape in zip(tails, kept, strict=True)
    )


def _size(half_square: float) -> float:
    return float(np.sqrt(2.0 * half_square))


def _stretched(ratio: float, shape: float) -> float:
    """Return (ratio^shape - 1) / shape."""
    return float(np.log(ratio)) if abs(shape) < 1e-6 else (ratio**shape - 1.0) / shape


def tail_of(signals: Sequence[Array], steps: Sequence[float], apart: float, name: str) -> Tail:
    """Return the tail of a signal.

    Args:
        signals: Its size by log, shape (N,) each.
        steps: Seconds a sample of each log.
        apart: Seconds below the level after which a rise is a new one.
        name: Whose signal it is, for messages.

    Raises:
        LogMismatch: Too few peaks.
    """
    halves = [0.5 * one**2 for one in signals]
    level = float(np.quantile(np.concatenate(halves), QUANTILE))
    peaks = [peak for one, step in zip(halves, steps, strict=True) for peak in _peaks(one, level, apart / step)]
    seconds = float(sum(len(one) * step for one, step in zip(signals, steps, strict=True)))
    if len(peaks) < FEWEST:
        evidence = (
            f"{len(peaks)} peaks of the residual of {name} in {seconds:.3g} s, too few to know how often it rises"
        )
        raise LogMismatch("clean logs", evidence, "give longer logs of clean runs")
    over = np.sort(np.array(peaks) - level)
    count = len(over)
    first = float(over.mean())
    second = float(np.mean(over * (count - 1 - np.arange(count)) / (count - 1)))
    shape = float(np.clip(2.0 - first / max(first - 2.0 * second, 1e-12 * first), -HEAVIEST, HEAVIEST))
    return Tail(level, count / seconds, first * (1.0 - shape), shape, seconds)


def _peaks(signal: Array, level: float, apart: float) -> list[float]:
    """Return the highest value of each rise above a level; rises less than ``apart`` samples apart are one."""
    above = np.flatnonzero(signal > level)
    if not len(above):
        return []
    parts = np.split(above, np.flatnonzero(np.diff(above) > max(apart, 1.0)) + 1)
    return [float(signal[part].max()) for part in parts]
