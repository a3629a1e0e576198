"""How often a signal rises above a level: peaks over a threshold, beyond what the log itself has seen.

Peaks of |s| over a high level are nearly independent and follow a generalised Pareto distribution (Pickands 1975), here
by probability-weighted moments (Hosking and Wallis 1987, (14)). Rising above u happens rate * (1 + k (u - level) /
scale)^(-1 / k) times a second.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dynident.arrays import Array
from dynident.errors import LogMismatch

#: Share of the samples below the level.
QUANTILE = 0.95

#: Peaks that a fit needs at least.
FEWEST = 20

#: Peaks above a level that the log must have seen for its own shape to hold there. Beyond it the shape is at least that
#: of normal noise and the scale a share of the log's: a few peaks may look as if they ended.
SEEN, LIGHTEST, LEAST = 3.0, -0.1, 0.25

#: Largest shape of the tail: beyond it levels of rare events mean nothing.
HEAVIEST = 0.5


@dataclass(frozen=True)
class Tail:
    """The peaks of a signal.

    Attributes:
        level: Above which they are peaks.
        rate: Peaks a second.
        scale: Of the generalised Pareto distribution.
        shape: k; 0 an exponential tail, below 0 one that ends.
        seconds: Length of what they were found in.
    """

    level: float
    rate: float
    scale: float
    shape: float
    seconds: float

    def threshold(self, rate: float) -> float:
        """Return the level that is risen above ``rate`` times a second.

        Beyond what the log has seen a few times the tail goes on like that of normal noise, or heavier.
        """
        seen = SEEN / self.seconds
        if rate >= seen or self.shape >= LIGHTEST or seen >= self.rate:
            return self.level + self.scale * _stretched(self.rate / rate, self.shape)
        reached = self.level + self.scale * _stretched(self.rate / seen, self.shape)
        scale = max(self.scale + self.shape * (reached - self.level), LEAST * self.scale)
        return reached + scale * _stretched(seen / rate, LIGHTEST)


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
    level = float(np.quantile(np.concatenate(signals), QUANTILE))
    peaks = [peak for one, step in zip(signals, steps, strict=True) for peak in _peaks(one, level, apart / step)]
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
