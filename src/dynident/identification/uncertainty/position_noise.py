"""The bias by noise of the positions, which no residual shows: taken out of least squares, or into the intervals.

Noise of the measured positions, in the rows, biases least squares (errors in variables). What it adds to the products
[W, tau]'[W, tau] is found by adding as much again: noise as the positions have (:func:`like_noise`) is drawn,
and a draw and its negative are reduced both, so that the first order cancels (Hammersley and Morton 1956). Less
that, least squares has no bias to first order in the variance (Fuller 1987, section 2.2; Cook and Stefanski 1994).
Estimators that solve from triangles go without the bias; the others get its square into the covariance. Noise that is
not white, of positions that were filtered before they were logged, is underestimated.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from dynident.arrays import Array
from dynident.data.log import Log
from dynident.data.preprocessing import Prepared, preprocess, resample
from dynident.data.preprocessing._spectra import like_noise
from dynident.errors import DynidentError
from dynident.identification.estimate.estimate import Estimate
from dynident.identification.estimators.ols import OLS
from dynident.identification.problem.choices import NoiseBias
from dynident.identification.problem.estimator import Estimator
from dynident.identification.problem.problem import Problem
from dynident.identification.problem.regressor_stream import motion_of
from dynident.identification.selection.friction.load import with_load
from dynident.model.reduction import Reduced, least_squares

#: A bias of fewer stated standard deviations than this widens no interval by more than 5 %, and is left aside.
MATTERS = 0.3

#: Share of the bound of :func:`_may_matter` that biases reach: 0.29 at most (cut-offs 3 to 40 Hz, 1e-6 to 1e-3 rad).
REACHED = 0.3

#: Share of noise in the information on a direction up to which it is taken out, and its first order is believed.
MOST, BELIEVED = 0.95, 0.5

#: Share of the bias that is left at least: half stayed where noise of the speeds is wider than the sign of friction.
LEFT = 0.5

#: Seed of the draws.
SEED = 30


def without_noise(
    estimate: Estimate,
    problem: Problem,
    estimator: Estimator,
    logs: Sequence[Log],
    fit: Callable[[Problem, Estimator], Estimate],
) -> tuple[Estimate, Problem]:
    """Return estimate and problem without the bias by noise of the positions, as they are where that is small.

    Args:
        estimate: The estimate; what of the bias may be left is in the covariance of the one returned.
        problem: What it solves.
        estimator: What found it.
        logs: The raw logs of the problem, joints in the order of the robot.
        fit: Fits a problem again.
    """
    problem = with_load(problem, estimate.beta)
    if estimator.allows_for_noise:
        return estimate, problem
    even = [resample(log, problem.preprocessing.longest_gap_s) for log in logs]
    drawn = [np.random.default_rng([SEED, k]) for k in range(len(logs))]
    noise = [like_noise(*each) for each in zip(even, [log.resolution for log in logs], drawn, strict=True)]
    try:
        more = _noisy(problem, even, noise)
        if not _may_matter(estimate, problem, more):
            return estimate, problem
        added = _added(problem, (more, _noisy(problem, even, [-each for each in noise])))
        weights = np.ones(len(problem.triangles)) if isinstance(estimator, OLS) else 1.0 / estimate.joint_deviations
        bias, spread, share = bias_of(problem.reduced(weights), np.tensordot(weights**2, added, 1))
        if not np.any(np.abs(bias) > MATTERS * estimate.std):
            return estimate, problem
        left = max(share, LEFT) if estimator.from_triangles and share < MOST else 1.0
        if left < 1.0:
            clean = problem.without(bias)
            estimate, problem = fit(clean, estimator), clean
    except DynidentError:  # positions that cannot be prepared with more noise, or a fit without a checked solution
        return estimate, problem
    sizes = np.sqrt(np.mean([np.mean(each**2, axis=0) for each in noise], axis=0))
    found = NoiseBias(tuple(sizes.tolist()), tuple(bias.tolist()), left)
    grown = spread if left < 1.0 else np.eye(len(bias))
    covariance = grown @ estimate.covariance @ grown.T + left**2 * np.outer(bias, bias)
    return replace(estimate, covariance=covariance, choices=replace(estimate.choices, position_noise=found)), problem


def bias_of(reduced: Reduced, added: Array) -> tuple[Array, Array, float]:
    """Return what noise biases least squares by, shape (b,).

    In directions of more noise than signal, whose shares come out up to above 1, the estimate is extrapolated from
    noise added once and twice (Cook and Stefanski 1994), which moves it by three times itself at most.
    Also the matrix that errors grow by where it is taken out (b, b), and the largest share of noise in a direction.

    Args:
        reduced: The weighted problem.
        added: What the noise added to [W, tau]'[W, tau], shape (b + 1, b + 1).
    """
    inverse, beta = np.linalg.inv(reduced.r), least_squares(reduced).beta
    shares, directions = np.linalg.eigh(inverse.T @ added[:-1, :-1] @ inverse)
    once, twice = 1.0 / (1.0 + np.maximum(shares, 0.0)), 1.0 / (1.0 + 2.0 * np.maximum(shares, 0.0))
    exact = 1.0 / (1.0 - np.minimum(shares, BELIEVED))
    own, torque = np.where(shares > BELIEVED, [3.0 - 3.0 * once + twice, 3.0 * once - 2.0 * twice], exact)
    spread = inverse @ (directions * own) @ directions.T @ reduced.r
    moved = inverse @ (directions * torque) @ directions.T @ inverse.T @ added[:-1, -1]
    return beta - spread @ beta + moved, spread, float(shares[-1])


def _noisy(problem: Problem, logs: Sequence[Log], noise: Sequence[Array]) -> list[Prepared]:
    """Return the logs of a problem with noise on the positions, shape (N, n) of each."""
    return [
        preprocess(replace(log, q=log.q + drawn), replace(plain.how, delay_s=plain.delay_s))
        for log, drawn, plain in zip(logs, noise, problem.logs, strict=True)
    ]


def _may_matter(estimate: Estimate, problem: Problem, logs: Sequence[Prepared]) -> bool:
    """Return whether the bias may be as large as the deviations, by what a draw of the noise does to the torque.

    The bound: root of the effective rows, noise of the torque over residual, noise of accelerations over themselves.
    """
    regressor, worst = problem.regressor, 0.0
    for noisy, plain in zip(logs, problem.logs, strict=True):
        change = regressor.predict(noisy.log, estimate.beta) - regressor.predict(plain.log, estimate.beta)
        change = plain.smooth(change.T).T[plain.keep] / np.asarray(estimate.joint_deviations)
        before, after = (motion_of(one.log).ddq[plain.keep] for one in (plain, noisy))
        column = np.sqrt(np.mean((after - before) ** 2, axis=0) / np.maximum(np.mean(before**2, axis=0), 1e-300))
        worst = max(worst, float(np.sqrt(np.mean(change**2, axis=0).max()) * column.max()))
    rows = np.sum(np.sum([mask.sum(axis=0) for mask in problem.masks], axis=0) / estimate.correlation_factors)
    return bool(np.sqrt(rows) * worst * REACHED > MATTERS)


def _added(problem: Problem, draws: Sequence[Sequence[Prepared]]) -> Array:
    """Return what noise adds to [W, tau]'[W, tau] of each joint in the mean over the logs with several draws."""
    size = problem.base.count
    found = np.zeros((len(problem.triangles), size + 1, size + 1))
    noisy = [problem.regressor.triangles(*each) for logs in draws for each in zip(logs, problem.masks, strict=True)]
    for share, triangles in [(-1.0, problem.triangles), *((1.0 / len(draws), each) for each in noisy)]:
        for into, own in zip(found, triangles, strict=True):
            places = np.append(own.columns, size)
            into[np.ix_(places, places)] += share * own.factor.T @ own.factor
    return found
