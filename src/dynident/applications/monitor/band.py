"""The torque band of a monitor: how large the observer's residual is at a state, without any contact.

The variance of a joint's residual is a sum of known shapes with weights >= 0 that clean runs determine: constant noise;
the variance of the model's torque by the covariance of its parameters; noise of each velocity, which enters by the
momentum M dq; a share of the model's own torque (gains); of the speed; and what friction does near standstill. The
weights are those of largest likelihood for normal residuals of that variance, by Fisher scoring: least squares of the
squared residual over its variance, non-negative (McCullagh and Nelder 1989, section 10.5).

The residual is a first-order lag with a = exp(-K dt), so its variance follows that of the moment with a^2.

How often a signal rises above a level, beyond what the log itself has seen: peaks over a threshold.
Peaks of |s| over a high level are nearly independent; x = s^2 / 2 of them follows a generalised Pareto distribution
(Pickands 1975), here by probability-weighted moments (Hosking and Wallis 1987, (14)). Normal noise has shape 0 and
scale 1 in x (Rice 1945). Rising above u happens rate * (1 + k (u^2 / 2 - level) / scale)^(-1 / k) times a second.
Rises are one peak where less than the correlation time lies between them: the largest of several independent rises
grows slower than the tail, so that a longer time feigns one that ends (shape -0.3 for normal noise at five times it).

Shape and scale are known no better than the peaks tell: the rate at a threshold is the mean over what both may be (the
predictive distribution, Geisser 1993), and a threshold is where that mean is the chosen rate.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.optimize
import scipy.signal
import scipy.special

from dynident.applications.monitor.momentum_observer import Terms
from dynident.arrays import Array, frozen
from dynident.errors import LogMismatch

#: Speeds near standstill, as shares of the root mean square speed of the clean runs.
NEAR = (0.02, 0.2)

#: Rounds of the scoring; weights change by less than a thousandth after them.
ROUNDS = 12

#: Squared residuals count up to this many times their variance: what is rarer is the business of the tail.
OUTLYING = 9.0

#: Most samples of the clean runs that the weights are found from.
ROWS = 20_000

#: Least share of a joint's mean square residual that is constant noise: no state is without any.
LEAST = 1e-3


@dataclass(frozen=True)
class BandWeights:
    """Weights of the variances that make up each joint's band.

    Attributes:
        weights: Shape (n, f), in the order of :func:`shapes`.
        speeds: Root mean square speed of each joint in the clean runs, shape (n,), in rad/s or m/s.
    """

    weights: Array
    speeds: Array

    def __post_init__(self) -> None:
        joints = len(self.speeds)
        object.__setattr__(self, "weights", frozen(self.weights, (joints, joints + 5 + len(NEAR)), "weights"))
        object.__setattr__(self, "speeds", frozen(self.speeds, (joints,), "speeds"))

    def variances(self, terms: Terms, deviations: Array, dq: Array) -> Array:
        """Return the variance of each joint's residual if it stayed at a state, shape (N, n), in (N m)^2 or N^2."""
        return np.einsum("sjf,jf->sj", shapes(terms, deviations, dq, np.asarray(self.speeds)), self.weights)


def shapes(terms: Terms, deviations: Array, dq: Array, speeds: Array) -> Array:
    """Return the shapes of the variance of each joint, (N, n, f).

    Args:
        terms: Of the equations.
        deviations: Standard deviation of the torque by the parameters' covariance, shape (N, n).
        dq: Velocities, shape (N, n).
        speeds: Their size in the clean runs, shape (n,).
    """
    count, joints = dq.shape
    found = np.empty((count, joints, joints + 5 + len(NEAR)))
    found[..., 0] = 1.0
    found[..., 1] = deviations**2
    found[..., 2] = terms.drift**2
    found[..., 3] = dq**2
    found[..., 4] = terms.momentum**2
    for k, share in enumerate(NEAR, start=5):
        found[..., k] = 1.0 / (1.0 + (dq / (share * speeds)) ** 2)
    found[..., 5 + len(NEAR) :] = terms.mass**2
    return found


def lagged(values: Array, keep: float) -> Array:
    """Return the values of a moment (N, ...) as a residual's variance follows them, from the first on."""
    fresh = 1.0 - keep**2
    start = values[:1] * keep**2
    return np.asarray(scipy.signal.lfilter([fresh], [1.0, -(keep**2)], values, axis=0, zi=start)[0])


def fitted_band(
    residuals: Sequence[Array], moments: Sequence[Array], keeps: Sequence[float], speeds: Array
) -> BandWeights:
    """Return the band of clean runs.

    Args:
        residuals: The observer's, by run, shape (N, n) each.
        moments: Shapes of the variance by run, shape (N, n, f) each.
        keeps: exp(-K dt) of each run.
        speeds: Size of each joint's speed, shape (n,).
    """
    stride = max(1, sum(map(len, residuals)) // ROWS)
    rows = np.concatenate([lagged(one, keep)[::stride] for one, keep in zip(moments, keeps, strict=True)])
    squares = np.concatenate([one[::stride] for one in residuals]) ** 2
    return BandWeights(np.array([_weights(squares[:, j], rows[:, j]) for j in range(squares.shape[1])]), speeds)


def _weights(squares: Array, rows: Array) -> Array:
    """Return the weights of one joint, shape (f,)."""
    mean = max(float(squares.mean()), 1e-24)
    sizes = rows.mean(axis=0)
    used = sizes > 0
    scaled = rows[:, used] / sizes[used] * mean
    variance = np.full(len(squares), mean)
    found = np.zeros(int(used.sum()))
    for _ in range(ROUNDS):
        capped = np.minimum(squares, OUTLYING * variance) / variance
        triangle = np.asarray(np.linalg.qr(np.column_stack([scaled / variance[:, None], capped]), mode="r"))
        found = scipy.optimize.nnls(triangle[:, :-1], triangle[:, -1])[0]
        found[0] = max(found[0], LEAST)
        variance = scaled @ found
    weights = np.zeros(rows.shape[1])
    weights[used] = found * mean / sizes[used]
    return weights


#: Share of the samples below the level.
QUANTILE = 0.95

#: Peaks that a fit needs at least.
FEWEST = 20

#: Shapes of the tail that are believed. Below 0, that of normal noise, it would end: that peaks of a few motions do is
#: no evidence of those of others. Above 0.5 levels of rare events mean nothing.
LIGHTEST, HEAVIEST = 1e-6, 0.5

#: Variance of a shape near 0, times the number of peaks (Hosking and Wallis 1987, table 2).
SCATTER = 4.0 / 3.0

#: Equally likely values of the shape, and of the scale for each, over which rates are averaged.
NODES = 40


@dataclass(frozen=True)
class Tail:
    """The peaks of a signal s, in x = s^2 / 2.

    Attributes:
        level: Above which they are peaks.
        rate: Peaks a second.
        scale: Of the generalised Pareto distribution.
        shape: k; 0 as normal noise has, below 0 one that ends.
        seconds: Length of what they were found in.
        shape_std: Standard deviation of the shape.
    """

    level: float
    rate: float
    scale: float
    shape: float
    seconds: float
    shape_std: float = 0.0

    def threshold(self, rate: float) -> float:
        """Return the size of the signal that is risen above ``rate`` times a second, in the mean of what is likely."""
        high = self.level + self.scale
        while self.rates(_size(high)).mean() > rate:
            high += high - self.level

        def excess(half_square: float) -> float:
            return float(np.log(max(self.rates(_size(half_square)).mean(), 1e-300) / rate))

        found = scipy.optimize.root_scalar(excess, bracket=(self.level, high), xtol=1e-9 * high)
        return _size(float(found.root))

    def rates(self, size: float) -> Array:
        """Return equally likely values of how often a second the signal rises above a size, shape (NODES^2,).

        The shape is normal; the scale for a shape is known as that of as many exponential peaks, by a gamma
        distribution, from their mean.
        """
        over = max(0.5 * size**2 - self.level, 0.0)
        chances = (np.arange(NODES) + 0.5) / NODES
        shapes = np.clip(self.shape + self.shape_std * scipy.special.ndtri(chances), LIGHTEST, HEAVIEST)
        scales = self.scale / (1.0 - self.shape) * (1.0 - shapes)
        exponents = np.log1p(shapes * over / scales) / shapes
        precision = scipy.special.gammaincinv(self.count, chances) / self.count
        return np.asarray(self.rate * np.exp(-np.outer(exponents, precision)).ravel())

    @property
    def count(self) -> float:
        """Number of the peaks."""
        return self.rate * self.seconds


def shrunk(tails: Sequence[Tail]) -> tuple[Tail, ...]:
    """Return tails whose shapes are drawn to that of normal noise as far as their scatter explains the difference.

    The shapes are taken for normal about 0, their variance by the joints together (Efron and Morris 1975): a few peaks
    do not make a tail heavy, and many do. What stays open of each is its standard deviation. The variance of the joints
    is taken for no less than its own standard error: few joints whose shapes agree do not make it none.
    """
    scatter = np.array([SCATTER / tail.count for tail in tails])
    shapes = np.array([tail.shape for tail in tails])
    spread = max(float(np.mean(shapes**2 - scatter)), float(np.mean(scatter)) * np.sqrt(2.0 / len(tails)))
    share = spread / (spread + scatter)
    return tuple(
        replace(tail, shape=shape, scale=tail.scale * (1.0 - shape) / (1.0 - tail.shape), shape_std=std)
        for tail, shape, std in zip(tails, (share * shapes).tolist(), np.sqrt(share * scatter).tolist(), strict=True)
    )


def _size(half_square: float) -> float:
    return float(np.sqrt(2.0 * half_square))


def tail_of(signals: Sequence[Array], steps: Sequence[float], apart: float, name: str) -> Tail:
    """Return the tail of a signal.

    Args:
        signals: Its size by log, shape (N,) each.
        steps: Seconds a sample of each log.
        apart: Seconds below the level after which a rise is a new one: the correlation time.
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
