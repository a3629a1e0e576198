"""Kalman smoother: a motion of white jerk or white snap seen through white noise.

State x = (q, q' h, q'' h^2, ...) with h the unit of time; the m-th derivative of q is white noise. Steps may differ.
The filter is Kalman's (1960) in the form of Joseph, which keeps covariances positive; the smoother that of Rauch, Tung
and Striebel (1965).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import factorial
from typing import Any

import numpy as np

from dynident.arrays import Array
from dynident.data.log import Log
from dynident.data.preprocessing._spectra import noise_floor
from dynident.data.preprocessing._torque_side import PositionSmoother
from dynident.errors import BadOption, LogMismatch
from dynident.model.kernels.jit import compiled, inlined
from dynident.plugins import bounded

#: Samples in a row that the likelihood looks at, at most, from the middle of the log.
LONGEST = 8192

#: Decades of the intensity that are searched below that of the raw differences, and points of the first grid.
DECADES, POINTS = 16.0, 17

#: Share of the range of a signal that its noise has at least: positions made by a formula have none.
LEAST = 1e-8

#: Derivative that is white, by model.
ORDERS = {"jerk": 3, "snap": 4}


@dataclass(frozen=True)
class KalmanSmoother(PositionSmoother):
    """Positions as integrated white jerk (or snap) under white noise, smoothed with their derivatives over the log.

    The smoother of Rauch, Tung and Striebel (1965). Intensity of the jerk and noise of the positions are found joint by
    joint by maximum likelihood of the innovations (Schweppe 1965). Torque and regressor pass a zero-phase Butterworth,
    the same on both sides, which the smoother of the positions is not part of.

    Attributes:
        model: ``jerk`` (white jerk) or ``snap`` (white derivative of the jerk).
        position_noise: Standard deviation of a position sample in rad or m; None: by likelihood.
        cutoff_hz: Frequency of half amplitude of torque and regressor, in Hz.
        torque: ``same`` filters both sides, ``none`` leaves torque and regressor as they are.
    """

    model: str = "jerk"
    position_noise: float | None = bounded(None, least=1e-15, most=1e6)
    cutoff_hz: float = 5.0
    torque: str = "same"

    def __post_init__(self) -> None:
        if self.model not in ORDERS:
            raise BadOption("model", self.model, "choose 'jerk' or 'snap'")
        if self.position_noise is not None and not 0 < self.position_noise < np.inf:
            raise BadOption("position_noise", self.position_noise, "give a standard deviation above 0")
        self.check_sides()

    def apply(self, log: Log) -> Log:
        q, deviations, noises = self._states(log)
        step = (
            f"Kalman smoother of white {self.model}, noise of positions "
            f"{', '.join(f'{noise:.2g}' for noise in noises)}, of accelerations "
            f"{', '.join(f'{float(np.median(each)):.2g}' for each in deviations[2].T)} (stated), {self.sides_text()}"
        )
        return replace(log.with_step(step), q=q[0], dq=q[1], ddq=q[2], torque=self.measured(log), raw_torque=log.torque)

    def deviations(self, log: Log) -> tuple[Array, Array, Array]:
        """Return the standard deviations of q, dq and ddq that the model states, each (N, n)."""
        found = self._states(log)[1]
        return found[0], found[1], found[2]

    def statement(self) -> dict[str, object]:
        return {
            "kind": "kalman_smoother",
            "cutoff_hz": self.cutoff_hz if self.torque == "same" else None,
            "order": ORDERS[self.model],
            "torque": self.torque,
            "model": self.model,
            "position_noise": "by likelihood" if self.position_noise is None else self.position_noise,
        }

    def _states(self, log: Log) -> tuple[tuple[Array, ...], tuple[Array, ...], list[float]]:
        """Return q, dq, ddq, their deviations, (N, n) each, and the noise of each joint's positions."""
        if log.samples < 10:
            raise LogMismatch(log.name, f"{log.samples} samples", "a Kalman smoother takes at least 10 samples")
        self.check_length(log)
        order = ORDERS[self.model]
        unit = 1.0 / log.rate
        steps = np.diff(log.time) / unit
        means, deviations, noises = [], [], []
        for column in log.q.T:
            size = float(np.ptp(column))
            scale = unit ** -np.arange(order)
            if size == 0.0:
                means.append(np.outer(np.ones(len(column)), [column[0], *[0.0] * (order - 1)]))
                deviations.append(np.zeros((len(column), order)))
                noises.append(0.0)
                continue
            ratio, noise = self._noises(column, steps, order, log.rate)
            mean, deviation = smoothed((column - column[0]) / noise, steps, ratio, order)
            means.append(mean * noise * scale + np.array([column[0], *[0.0] * (order - 1)]))
            deviations.append(deviation * noise * scale)
            noises.append(noise)
        signals, spreads = (tuple(np.stack(each, axis=2).transpose(1, 0, 2)) for each in (means, deviations))
        return signals, spreads, noises

    def _noises(self, column: Array, steps: Array, order: int, rate: float) -> tuple[float, float]:
        """Return the intensity of the white derivative over the noise's variance, and the noise, of highest likelihood.

        The likelihood depends on their ratio alone once the noise is taken at its own maximum.
        """
        first = max(0, (len(column) - LONGEST) // 2)
        part, between = column[first : first + LONGEST], steps[first : first + LONGEST - 1]
        size = max(float(np.ptp(part)), 1e-300)
        floor = float(np.sqrt(noise_floor(part[:, None], rate)[0] * rate / 2))
        scale = self.position_noise or max(floor, LEAST * size)
        signal = (part - part[0]) / scale
        stated = self.position_noise is not None

        def cost(logarithm: float) -> float:
            found = likelihood(signal, between, float(np.exp(logarithm)), order)
            size = found.squares if stated else found.count * np.log(max(found.squares, 1e-300))
            return 0.5 * (size + found.log_variance)

        highest = float(np.log(max(float(np.mean(np.diff(signal, order) ** 2)), 1e-12))) + 4.0
        best = float(np.exp(_least(cost, highest - DECADES * np.log(10.0), highest)))
        if stated:
            return best, scale
        found = likelihood(signal, between, best, order)
        noise = scale * float(np.sqrt(found.squares / found.count))
        return best, max(noise, LEAST * size)


def _least(cost: Callable[[float], float], low: float, high: float) -> float:
    """Return where a function of one number is least: a coarse grid, then a search about its best point."""
    import scipy.optimize

    grid = np.linspace(low, high, POINTS)
    best = int(np.argmin([cost(float(point)) for point in grid]))
    bounds = (float(grid[max(best - 1, 0)]), float(grid[min(best + 1, POINTS - 1)]))
    found: Any = scipy.optimize.minimize_scalar(cost, bounds=bounds, method="bounded", options={"xatol": 0.02})
    return float(found.x)


#: k! for k below 8.
FACTORIALS = np.array([float(factorial(k)) for k in range(8)])


@dataclass(frozen=True)
class Likelihood:
    """What the filter says of its two intensities, at noise of deviation one.

    Attributes:
        squares: Sum of the squared innovations over their variances.
        log_variance: Sum of the logarithms of those variances.
        count: Number of innovations.
    """

    squares: float
    log_variance: float
    count: int


def likelihood(signal: Array, steps: Array, ratio: float, order: int) -> Likelihood:
    """Return the likelihood of a signal (N,).

    Args:
        signal: In units of its noise.
        steps: Times between the samples in units of time, shape (N - 1,).
        ratio: Intensity of the white derivative over the variance of the noise, per unit of time.
        order: Which derivative is white.
    """
    squares, total = _forward(signal, steps, ratio, order, *_start(signal, order))
    return Likelihood(float(squares), float(total), len(signal) - order)


def smoothed(signal: Array, steps: Array, ratio: float, order: int) -> tuple[Array, Array]:
    """Return the smoothed states of a signal and their deviations, (N, order) each; arguments as of likelihood."""
    mean, variance = _both_ways(signal, steps, ratio, order, *_start(signal, order))
    return mean, np.sqrt(np.maximum(variance, 0.0))


def _start(signal: Array, order: int) -> tuple[Array, Array]:
    """Return states at the start and deviations of them that are wide: differences, and ten times what they miss."""
    mean = np.array([float(np.diff(signal, k)[0]) for k in range(order)])
    missed = [float(np.abs(np.diff(signal, k + 1)).max()) + 2.0**k for k in range(order)]
    return mean, 10.0 * np.array(missed)


@inlined
def _advance(step: float, ratio: float, order: int, move: Array, noise: Array) -> None:
    """Write the transition over a step and the covariance of what comes in (Bar-Shalom et al. 2001, 6.2)."""
    for i in range(order):
        for j in range(order):
            move[i, j] = step ** (j - i) / FACTORIALS[j - i] if j >= i else 0.0
            power = 2 * order - 1 - i - j
            below = FACTORIALS[order - 1 - i] * FACTORIALS[order - 1 - j] * power
            noise[i, j] = ratio * step**power / below


@inlined
def _carry(move: Array, noise: Array, mean: Array, spread: Array, order: int, work: Array) -> None:
    """Carry a state and its covariance over a step, in place; products are written out, as they compile far faster."""
    for i in range(order):
        total = 0.0
        for k in range(i, order):
            total += move[i, k] * mean[k]
        mean[i] = total  # move is an upper triangle: later entries are those before the step
        for j in range(order):
            work[i, j] = 0.0
            for k in range(i, order):
                work[i, j] += move[i, k] * spread[k, j]
    for i in range(order):
        for j in range(order):
            total = noise[i, j]
            for k in range(j, order):
                total += work[i, k] * move[j, k]
            spread[i, j] = total


@inlined
def _keep(mean: Array, spread: Array, mean_out: Array, spread_out: Array) -> None:
    for i in range(len(mean)):
        mean_out[i] = mean[i]
        for j in range(len(mean)):
            spread_out[i, j] = spread[i, j]


@inlined
def _divide(matrix: Array, right: Array, order: int) -> None:
    """Overwrite ``right`` with the solution of matrix X = right, by Cholesky's factors of a positive one."""
    for j in range(order):
        for i in range(j, order):
            total = matrix[i, j]
            for k in range(j):
                total -= matrix[i, k] * matrix[j, k]
            matrix[i, j] = np.sqrt(total) if i == j else total / matrix[j, j]
    for c in range(order):
        for i in range(order):
            for k in range(i):
                right[i, c] -= matrix[i, k] * right[k, c]
            right[i, c] /= matrix[i, i]
        for i in range(order - 1, -1, -1):
            for k in range(i + 1, order):
                right[i, c] -= matrix[k, i] * right[k, c]
            right[i, c] /= matrix[i, i]


@inlined
def _look_back(
    move: Array, mean: Array, spread: Array, foreseen: tuple[Array, Array], later: tuple[Array, Array], work: Array
) -> None:
    """Take what later samples say into a state, in place; ``foreseen``, ``later``: mean and covariance after it."""
    order = len(mean)
    gain, factor, rest = work[0], work[1], work[2]
    for i in range(order):
        for j in range(order):
            gain[i, j] = 0.0
            factor[i, j] = foreseen[1][i, j]
            rest[i, j] = later[1][i, j] - foreseen[1][i, j]
            for k in range(i, order):
                gain[i, j] += move[i, k] * spread[k, j]
    _divide(factor, gain, order)  # the transpose of the smoother's gain
    for i in range(order):
        for k in range(order):
            mean[i] += gain[k, i] * (later[0][k] - foreseen[0][k])
        for j in range(order):
            factor[i, j] = 0.0
            for k in range(order):
                factor[i, j] += gain[k, i] * rest[k, j]
    for i in range(order):
        for j in range(order):
            for k in range(order):
                spread[i, j] += factor[i, k] * gain[k, j]


@compiled
def _correct(value: float, mean: Array, spread: Array, order: int) -> tuple[float, float]:
    """Take in a sample of variance one; return the innovation and its variance."""
    variance = spread[0, 0] + 1.0
    innovation = value - mean[0]
    gain, row = np.empty(order), np.empty(order)
    for i in range(order):
        gain[i], row[i] = spread[i, 0] / variance, spread[0, i]
        mean[i] += gain[i] * innovation
    # Joseph's form: (I - g h) P (I - g h)' + g g'
    for i in range(order):
        for j in range(order):
            spread[i, j] -= gain[i] * row[j]
    for i in range(order):
        first = spread[i, 0]
        for j in range(order):
            spread[i, j] += gain[i] * gain[j] - first * gain[j]
    return innovation, variance


@compiled
def _forward(signal: Array, steps: Array, ratio: float, order: int, start: Array, reach: Array) -> tuple[float, float]:
    mean, spread, work = start.copy(), np.zeros((order, order)), np.zeros((order, order))
    move, noise = np.zeros((order, order)), np.zeros((order, order))
    for i in range(order):
        spread[i, i] = reach[i] ** 2
    squares, total = 0.0, 0.0
    for t in range(len(signal)):
        if t > 0:
            _advance(steps[t - 1], ratio, order, move, noise)
            _carry(move, noise, mean, spread, order, work)
        innovation, variance = _correct(signal[t], mean, spread, order)
        if variance <= 0.0:  # rounding has used up a covariance that is next to nothing
            return np.inf, np.inf
        if t >= order:  # the first samples only set the state
            squares += innovation**2 / variance
            total += np.log(variance)
    return squares, total


@compiled
def _both_ways(
    signal: Array, steps: Array, ratio: float, order: int, start: Array, reach: Array
) -> tuple[Array, Array]:
    count = len(signal)
    means, spreads = np.zeros((count, order)), np.zeros((count, order, order))
    before, foreseen = np.zeros((count, order)), np.zeros((count, order, order))
    moves = np.zeros((count, order, order))
    noise, work = np.zeros((order, order)), np.zeros((3, order, order))
    mean, spread = start.copy(), np.zeros((order, order))
    for i in range(order):
        spread[i, i] = reach[i] ** 2
    for t in range(count):
        if t > 0:
            _advance(steps[t - 1], ratio, order, moves[t], noise)
            _carry(moves[t], noise, mean, spread, order, work[0])
        _keep(mean, spread, before[t], foreseen[t])
        _correct(signal[t], mean, spread, order)
        for i in range(order):
            for j in range(i):
                spread[i, j] = spread[j, i] = 0.5 * (spread[i, j] + spread[j, i])
        _keep(mean, spread, means[t], spreads[t])
    variances = np.zeros((count, order))
    for t in range(count - 1, -1, -1):
        if t < count - 1:
            foresight, later = (before[t + 1], foreseen[t + 1]), (means[t + 1], spreads[t + 1])
            _look_back(moves[t + 1], means[t], spreads[t], foresight, later, work)
        for i in range(order):
            variances[t, i] = spreads[t, i, i]
    return means, variances
