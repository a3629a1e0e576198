"""The bias by noise of the positions, which no residual shows, taken into the intervals.

The rows of the regressor are made of measured positions; their noise biases least squares (errors in variables) by an
amount that grows with its variance. It is extrapolated from fits with more of it (SIMEX; Cook and Stefanski 1994):
noise of the power that the positions have above the motion is drawn, once and three times as strong, and a parabola
through the three fits tells what there would be without any. A draw and its negative are fitted both, so that what
changes the estimate by chance, the first order, cancels (Hammersley and Morton 1956).

The estimate stays; the square of its bias is added to the covariance. Noise whose power is not the same at all
frequencies, of positions that were filtered before they were logged, is underestimated.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

import numpy as np

from dynident.arrays import Array
from dynident.data.log import Log
from dynident.data.preprocessing import Prepared, preprocess, resample
from dynident.data.preprocessing._spectra import noise_floor
from dynident.errors import DynidentError
from dynident.identification.estimate.estimate import Estimate
from dynident.identification.problem.choices import NoiseBias
from dynident.identification.problem.problem import Problem, make_problem
from dynident.identification.problem.regressor_stream import motion_of
from dynident.identification.selection.friction.load import with_load
from dynident.model.reduction import least_squares

#: Variance that is added, in units of that of the noise.
ADDED = (1.0, 3.0)

#: A bias of fewer stated standard deviations than this widens no interval by more than 5 %, and is left aside.
MATTERS = 0.3

#: Share of the bound of :func:`_may_matter` that biases reach: 0.03 to 0.29 for cut-offs of 3 to 40 Hz and noise of
#: 1e-6 to 1e-3 rad on an arm of three joints.
REACHED = 0.3

#: Seed of the draws.
SEED = 30


def with_noise_bias(
    estimate: Estimate, problem: Problem, logs: Sequence[Log], progress: Callable[[str], None] = lambda step: None
) -> Estimate:
    """Return the estimate with the bias by noise of the positions in its covariance, as it is where that is small.

    Args:
        estimate: The estimate, of a method that takes the measured motion for the true one.
        problem: What it solves.
        logs: The raw logs of the problem, joints in the order of the robot.
        progress: Called with the step in words where fits are needed.
    """
    found = noise_bias(estimate, problem, logs, progress)
    if found is None:
        return estimate
    bias = np.array(found.parameters)
    covariance = estimate.covariance + np.outer(bias, bias)
    return replace(estimate, covariance=covariance, choices=replace(estimate.choices, position_noise=found))


def noise_bias(
    estimate: Estimate, problem: Problem, logs: Sequence[Log], progress: Callable[[str], None]
) -> NoiseBias | None:
    """Return the bias by noise of the positions; None where it is small beside the deviations, or not to be had.

    Arguments as of :func:`with_noise_bias`.
    """
    even = [resample(log, problem.preprocessing.longest_gap_s) for log in logs]
    noise = [np.sqrt(noise_floor(log.q, log.rate) * log.rate / 2) for log in even]
    problem = with_load(problem, estimate.beta)
    try:
        more = _noisy(problem, even, noise, ADDED[0] ** 0.5)
        if not _may_matter(estimate, problem, more):
            return None
        progress("noise of the positions")
        first = _moved(estimate, problem, (more, _noisy(problem, even, noise, -(ADDED[0] ** 0.5))))
        if not np.any(np.abs(first) > MATTERS / 2 * estimate.std):
            return None
        second = _moved(estimate, problem, (_noisy(problem, even, noise, way * ADDED[1] ** 0.5) for way in (1, -1)))
    except DynidentError:  # so much noise that the rows determine nothing
        return None
    (once, more), (slope, steep) = ADDED, (first / ADDED[0], second / ADDED[1])
    bent = (steep - slope) / (more - once)
    bias = slope - bent * (once + 1.0)  # what the parabola through 0 falls by from 0 to -1
    if not np.any(np.abs(bias) > MATTERS * estimate.std):
        return None
    return NoiseBias(tuple(np.sqrt(np.mean(np.square(noise), axis=0)).tolist()), tuple(bias.tolist()))


def _noisy(problem: Problem, logs: Sequence[Log], noise: Sequence[Array], times: float) -> list[Prepared]:
    """Return the logs of a problem with white noise on the positions, of ``times`` the deviations (n,) of each."""
    found = []
    for k, (log, size, plain) in enumerate(zip(logs, noise, problem.logs, strict=True)):
        drawn = times * size * np.random.default_rng([SEED, k]).normal(size=log.q.shape)
        found.append(preprocess(replace(log, q=log.q + drawn), replace(plain.how, delay_s=plain.delay_s)))
    return found


def _may_matter(estimate: Estimate, problem: Problem, logs: Sequence[Prepared]) -> bool:
    """Return whether the bias may be as large as the deviations, by what a draw of the noise does to the torque.

    The bound: the root of the effective rows, times the noise of the torque by the positions over the residual, times
    the noise of the accelerations over themselves.
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


def _moved(estimate: Estimate, problem: Problem, draws: Iterable[Sequence[Prepared]]) -> Array:
    """Return what noise moves weighted least squares by in the mean over the logs with several draws, shape (b,)."""
    weights = 1.0 / np.asarray(estimate.joint_deviations)
    posed = (make_problem(problem.model, problem.base, noisy, problem.load) for noisy in draws)
    found = [least_squares(each.reduced(weights)).beta for each in posed]
    return np.mean(found, axis=0) - least_squares(problem.reduced(weights)).beta
