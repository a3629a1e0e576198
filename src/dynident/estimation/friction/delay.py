"""The delay of a log's torque behind its positions, from the log itself.

A delay d turns the model into tau(t) = Y(t - d) theta. The derivative of the torque by d is minus its derivative by
time, so d is one more column of the linear problem: Gauss and Newton's method on the problem in which the linear
parameters are eliminated (Golub and Pereyra 1973), with one column a log.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dynident.arrays import Array, BoolArray
from dynident.estimation.problem import Observer, counting_rows
from dynident.estimation.uncertainty.covariance import correlation_factors
from dynident.experiment.log import Log
from dynident.experiment.preprocessing import LONGEST_DELAY, Prepared, Preprocessing, preprocess, thinned
from dynident.model.base_parameters import BaseParameters
from dynident.model.dynamic_model import DynamicModel
from dynident.model.reduction import CHUNK, Triangle, least_squares, reduce, triangle_of
from dynident.model.threads import one_blas_thread

#: A step below this share of a sample ends the search.
SETTLED = 0.02

#: Steps at most, and the longest one in s: what a straight line through the torque may be asked to bridge.
STEPS, LONGEST_STEP = 25, 0.05

#: A delay that is not this many of its standard deviations away from zero is none.
SIGNIFICANT = 2.0


@dataclass(frozen=True)
class Delay:
    """Delay of one log.

    Attributes:
        seconds: By how much its torque lags behind its positions, in s; negative where it runs ahead.
        deviation: Standard deviation of it, in s, with the residuals' correlation taken into account.
        applied: What the motion is shifted by, in s: ``seconds``, or 0 where that may well be none.
    """

    seconds: float
    deviation: float
    applied: float


def find_delays(
    model: DynamicModel, base: BaseParameters, logs: Sequence[Log], how: Preprocessing
) -> tuple[tuple[Delay, ...], tuple[Prepared, ...]]:
    """Return the delay of each log, and the logs with their motion shifted by it.

    Args:
        model: A model whose friction does not depend on the load.
        base: Its base parameters.
        logs: Raw logs, joints in the order of the robot.
        how: How they become rows.

    Raises:
        LogMismatch: A log is too short.
    """
    plain = [preprocess(log, how) for log in logs]
    observer = Observer(model, base)
    seconds, deviation, prepared = np.zeros(len(logs)), np.zeros(len(logs)), plain
    beta = _first_fit(observer, plain)
    for _ in range(STEPS):
        beta, step, deviation = _step(observer, prepared, beta)
        step = np.clip(step, -LONGEST_STEP, LONGEST_STEP)
        seconds = np.clip(seconds + step, -LONGEST_DELAY, LONGEST_DELAY)
        if np.all(np.abs(step) * [log.log.rate for log in plain] < SETTLED):
            break
        prepared = _moved(logs, plain, how, seconds)
    applied: Array = np.where(np.abs(seconds) > SIGNIFICANT * deviation, seconds, 0.0)
    found = tuple(Delay(*map(float, each)) for each in zip(seconds, deviation, applied, strict=True))
    return found, tuple(_moved(logs, plain, how, applied))


def common_delay(delays: Sequence[Delay]) -> float:
    """Return the delay in s to be expected of another log of the same robot: the mean, the surest counting most."""
    weights = np.array([1.0 / max(delay.deviation, 1e-9) ** 2 for delay in delays])
    return float(weights @ [delay.applied for delay in delays] / weights.sum())


def _moved(logs: Sequence[Log], plain: Sequence[Prepared], how: Preprocessing, seconds: Array) -> list[Prepared]:
    parts = zip(logs, plain, seconds.tolist(), strict=True)
    return [thinned(raw, log.log, how, delay) if delay else log for raw, log, delay in parts]


def _step(observer: Observer, logs: Sequence[Prepared], beta: Array) -> tuple[Array, Array, Array]:
    """Return beta (b,), the step of each delay that removes the most of the residual, and its deviation, (L,) in s."""
    masks = [counting_rows(observer.model, log) for log in logs]
    predicted = [log.smooth(observer.predict(log.log, beta).T).T for log in logs]
    slopes = [
        -np.gradient(torque, 1.0 / log.log.rate, axis=0)[log.keep] for torque, log in zip(predicted, logs, strict=True)
    ]
    residuals = [
        np.asarray(log.log.torque)[log.keep] - torque[log.keep] for log, torque in zip(logs, predicted, strict=True)
    ]
    squares = sum(
        np.sum(np.where(mask, residual, 0.0) ** 2, axis=0) for mask, residual in zip(masks, residuals, strict=True)
    )
    weights = _weights(np.asarray(squares), np.sum([mask.sum(axis=0) for mask in masks], axis=0))
    size = observer.base.count
    reduced = reduce(_triangles(observer, logs, masks, slopes), size + len(logs), np.tile(weights, len(logs)))
    solution = least_squares(reduced)
    spread = correlation_factors(residuals, masks).mean() * reduced.rest / max(reduced.rows, 1)
    deviation = np.sqrt(np.diag(solution.unscaled_covariance)[size:] * spread)
    return solution.beta[:size], solution.beta[size:], deviation


def _weights(squares: Array, rows: Array) -> Array:
    """Return the weights of the joints from their sums of squared residuals (n,), shape (n,)."""
    mean = squares / np.maximum(rows, 1)
    return 1.0 / np.sqrt(np.maximum(mean, 1e-24 * mean.max() + 1e-300))


def _triangles(
    observer: Observer, logs: Sequence[Prepared], masks: Sequence[BoolArray], extra: Sequence[Array]
) -> list[Triangle]:
    """Return the triangles of each joint, log after log, with the column ``extra`` (N, n) of each log's own delay."""
    found = []
    for k, (log, mask, column) in enumerate(zip(logs, masks, extra, strict=True)):
        factors: list[Array] = [np.zeros((0, len(own) + 2)) for own in observer.columns]
        with one_blas_thread():
            for part, blocks in observer.segments(log):
                for i, block in enumerate(blocks):
                    chosen = mask[part, i]
                    rows = np.vstack([block[:-1], column[part, i], block[-1]])[:, chosen]
                    for start in range(0, rows.shape[1], CHUNK):
                        factors[i] = triangle_of(np.vstack([factors[i], rows[:, start : start + CHUNK].T]))
        for own, factor, count in zip(observer.columns, factors, mask.sum(axis=0), strict=True):
            found.append(Triangle(np.append(own, observer.base.count + k), factor, int(count)))
    return found


def _first_fit(observer: Observer, logs: Sequence[Prepared]) -> Array:
    """Return beta (b,) of weighted least squares without delays."""
    parts = [observer.triangles(log, counting_rows(observer.model, log)) for log in logs]
    triangles = [first.merged(rest) for first, *rest in zip(*parts, strict=True)]
    weights, beta = np.ones(len(triangles)), np.zeros(observer.base.count)
    for _ in range(3):
        beta = least_squares(reduce(triangles, observer.base.count, weights)).beta
        squares = np.array([triangle.residual_square(beta) for triangle in triangles])
        weights = _weights(squares, np.array([triangle.rows for triangle in triangles]))
    return beta
