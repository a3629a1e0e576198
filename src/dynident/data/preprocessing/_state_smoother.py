"""A signal as the integral of white noise, seen through white noise: filter, smoother and likelihood.

State x = (q, q' h, q'' h^2, ...) with h the unit of time; the m-th derivative of q is white noise. Steps may differ.
The filter is Kalman's (1960) in the form of Joseph, which keeps covariances positive; the smoother that of Rauch, Tung
and Striebel (1965).
"""

from __future__ import annotations

from dataclasses import dataclass
from math import factorial

import numpy as np

from dynident.arrays import Array
from dynident.model.kernels.jit import compiled, inlined

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
