"""Coloured residuals: autoregression by Burg's method, and rows whitened by it.

The residual of a joint is taken for a stationary normal process e_t = a_1 e_t-1 + ... + a_p e_t-p + u_t. Its whitened
rows have the exact likelihood, with the predictors of lower order at the beginning of each run (Levinson 1947;
Brockwell and Davis 1991, sections 5.2 and 8.1), so that nothing is lost at the ends of logs and at rows left out.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dynident.arrays import Array, BoolArray, IntArray


@dataclass(frozen=True)
class Colour:
    """One-step predictors of a stationary process.

    Attributes:
        predictors: Coefficients a_1..a_k of each order k from 0 to p.
        variances: Variance of the prediction error of each order, shape (p + 1,).
    """

    predictors: tuple[Array, ...]
    variances: Array

    @property
    def order(self) -> int:
        """P."""
        return len(self.predictors) - 1

    def cut(self, order: int) -> Colour:
        """Return the predictors up to an order."""
        return Colour(self.predictors[: order + 1], self.variances[: order + 1])

    def scaled(self, factor: float) -> Colour:
        """Return the same colour with all variances times a factor."""
        return Colour(self.predictors, self.variances * factor)

    def whitened(self, rows: Array) -> Array:
        """Return the prediction errors of a run of rows over their standard deviations, shape (k, m).

        Args:
            rows: Consecutive values, along the second axis, shape (k, m).
        """
        white = np.array(rows)
        for k in range(1, self.order + 1):
            white[:, self.order :] -= self.predictors[-1][k - 1] * rows[:, self.order - k : -k]
        white[:, self.order :] /= np.sqrt(self.variances[-1])
        for t in range(min(self.order, rows.shape[1])):
            before = rows[:, :t][:, ::-1] @ self.predictors[t]
            white[:, t] = (rows[:, t] - before) / np.sqrt(self.variances[t])
        return white


def colour_of(runs: Sequence[Array], longest: int, finest: float) -> Colour:
    """Return the predictors of a residual by Burg's method, all orders up to the longest.

    Each reflection coefficient minimises the squared errors of prediction forwards and backwards over all runs (Burg
    1975), which makes every predictor stable and, unlike sample autocovariances, keeps the depth of the spectrum of
    filtered noise.

    Args:
        runs: Residuals without gaps, shape (m,) each.
        longest: Highest order.
        finest: Smallest standard deviation.
    """
    total = max(sum(len(run) for run in runs), 1)
    power = float(sum(run @ run for run in runs)) / total
    forward, backward = [np.array(run) for run in runs], [np.array(run) for run in runs]
    predictors: list[Array] = [np.zeros(0)]
    variances = [power]
    for _ in range(longest):
        forward = [ahead[1:] for ahead in forward if len(ahead) > 1]
        backward = [back[:-1] for back in backward if len(back) > 1]
        both = float(sum(a @ a + b @ b for a, b in zip(forward, backward, strict=True)))
        if not both > 1e-24 * power:
            break
        shared = float(sum(a @ b for a, b in zip(forward, backward, strict=True)))
        reflection = 2.0 * shared / both
        last = predictors[-1]
        predictors.append(np.append(last - reflection * last[::-1], reflection))
        variances.append(variances[-1] * max(1.0 - reflection**2, 0.0))
        pairs = list(zip(forward, backward, strict=True))
        forward = [ahead - reflection * back for ahead, back in pairs]
        backward = [back - reflection * ahead for ahead, back in pairs]
    return Colour(tuple(predictors), np.maximum(variances, max(finest**2, 1e-300)))


def with_white_part(colour: Colour, share: float, order: int) -> Colour:
    """Return the predictors of the same process plus white noise of a share of its variance.

    Whitening then amplifies no frequency by more than 1 / sqrt(share) over the residual's deviation. The
    autocovariances that the predictors imply get the share added at lag zero and are solved anew (Levinson 1947).

    Args:
        colour: Predictors of all orders.
        share: 0 or more; 0 changes nothing.
        order: Order of the new predictors, as many as describe the sum well; white noise stays as it is.
    """
    if share == 0.0 or colour.order == 0:
        return colour
    lags, variance = [float(colour.variances[0])], float(colour.variances[0])
    for last, predictor in itertools.pairwise(colour.predictors):
        lags.append(float(last @ np.array(lags[:0:-1])) + float(predictor[-1]) * variance)
        variance *= 1.0 - float(predictor[-1]) ** 2
    for _ in range(colour.order, order):
        lags.append(float(colour.predictors[-1] @ np.array(lags[: -colour.order - 1 : -1])))
    predictors: list[Array] = [np.zeros(0)]
    variances = [lags[0] * (1.0 + share)]
    for k in range(1, len(lags)):
        last = predictors[-1]
        reflection = (lags[k] - float(last @ np.array(lags[k - 1 : 0 : -1]))) / variances[-1]
        predictors.append(np.append(last - reflection * last[::-1], reflection))
        variances.append(variances[-1] * (1.0 - reflection**2))
    return Colour(tuple(predictors), np.array(variances))


def best_order(colour: Colour, rows: int) -> int:
    """Return the order with the smallest Bayesian information criterion, rows log v_p + p log rows (Schwarz 1978)."""
    orders = np.arange(colour.order + 1)
    return int(np.argmin(rows * np.log(colour.variances) + orders * np.log(max(rows, 2))))


def unbroken_runs(keep: IntArray, every: int, counting: BoolArray) -> list[slice]:
    """Return the stretches of rows that all count and follow each other at the step of the log.

    Args:
        keep: Positions of the used rows on the uniform grid, shape (N,).
        every: The step.
        counting: Which of them count, shape (N,).
    """
    new = np.concatenate([[True], (np.diff(keep) != every) | ~counting[1:] | ~counting[:-1]])
    starts = np.flatnonzero(new)
    ends = np.append(starts[1:], len(keep))
    return [slice(int(a), int(b)) for a, b in zip(starts, ends, strict=True) if counting[a]]
