"""Do stated 95 % intervals hold the truth? A Monte Carlo over the noise, for every estimator of base parameters.

A short one runs always; the long one, ``-m battery``, has the bounds that the documentation states. The figures of more
arms and lengths are those of ``python -m benchmarks.coverage``.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from dynident.arrays import Array
from dynident.data.log import Log
from dynident.identification.estimators import ESTIMATORS, Estimator
from dynident.identification.estimators.map import MAP
from dynident.identification.estimators.rls import RLS
from dynident.identification.estimators.wls import WLS
from dynident.identification.problem.problem import Problem
from dynident.identification.residuals.coloured import Uncertainty, spectral_uncertainty
from dynident.identification.simulated.estimators.kalman import Kalman
from dynident.model.robot import Robot
from noisy_arms import Bench

MakeLog = Callable[..., Log]

#: Least squares in its forms, with priors that are flat enough, robust ones, and those in steps.
PARTS = ("ols", "wls", "ridge", "map", "huber", "tukey", "irls", "l1", "tls", "two_step", "essential", "iv", "didim")

#: Noise: memory from row to row, and the cut-off in Hz of the filter, if any.
KINDS = {"white": (0.0, None), "coloured": (0.9, None), "white, filtered": (0.0, 5.0), "coloured, filtered": (0.9, 5.0)}


@pytest.fixture(scope="module")
def bench(spatial_3r: Robot, exact_log: MakeLog) -> Bench:
    return Bench(spatial_3r, exact_log, samples=1200, friction=("coulomb", "viscous", "offset"))


def made(name: str) -> Estimator:
    return MAP(share=10.0) if name == "map" else ESTIMATORS.make(name)


def noisy(bench: Bench, kind: str, seed: int) -> Problem:
    memory, cutoff = KINDS[kind]
    noise = bench.coloured(seed, memory)
    return bench.problem(noise) if cutoff is None else bench.filtered(noise, cutoff)


def stated(part: Estimator, problem: Problem) -> tuple[Array, Uncertainty]:
    solution = part.solve(problem)
    if solution.covariance is None:
        return solution.beta, spectral_uncertainty(problem, solution.weights, solution.beta)
    degrees = np.full(len(solution.beta), np.inf) if solution.degrees is None else solution.degrees
    return solution.beta, Uncertainty(solution.covariance, degrees)


def covered(bench: Bench, part: Estimator, kind: str, seeds: int) -> tuple[Array, Array, Array]:
    """Return which intervals hold the truth, the errors and the stated deviations, shape (seeds, b) each."""
    inside, errors, deviations = [], [], []
    for seed in range(seeds):
        beta, found = stated(part, noisy(bench, kind, seed))
        errors.append(beta - bench.truth)
        deviations.append(found.deviations)
        inside.append(np.abs(errors[-1]) < found.half_widths())
    return np.array(inside), np.array(errors), np.array(deviations)


@pytest.mark.parametrize("name", ["tls", "huber", "l1", "two_step", "essential"])
@pytest.mark.parametrize("kind", ["white", "coloured, filtered"])
def test_intervals_hold_the_truth(name: str, kind: str, bench: Bench) -> None:
    inside, _, _ = covered(bench, made(name), kind, 8)
    assert 0.86 < np.mean(inside) < 0.995


@pytest.mark.battery
@pytest.mark.parametrize("name", PARTS)
@pytest.mark.parametrize("kind", KINDS)
def test_intervals_hold_the_truth_in_95_of_100_cases(name: str, kind: str, bench: Bench) -> None:
    simulated = name in ("iv", "didim")
    inside, errors, deviations = covered(bench, made(name), kind, 60 if simulated else 200)
    assert 0.925 - 0.01 * simulated < np.mean(inside) < 0.975
    assert 0.85 < np.median(np.sqrt(np.mean(deviations**2, axis=0)) / np.std(errors, axis=0)) < 1.2


@pytest.mark.parametrize("forgetting", [0.98, 0.995])
def test_a_fading_memory_is_as_sure_as_what_is_left_of_it(forgetting: float, bench: Bench) -> None:
    """Rows count lambda^age times: were all noise white, the covariance is that of weighted rows."""
    problem = bench.problem(bench.white(0))
    part = RLS(forgetting)
    solution = part.solve(problem)
    rows, age = problem.rows, problem.samples - 1 - problem.rows.samples
    weighted = rows.matrix * solution.weights[rows.joint, None]
    gram = (weighted * (forgetting**age)[:, None]).T @ weighted
    inverse = np.linalg.inv(gram)
    meat = (weighted * (forgetting ** (2 * age))[:, None]).T @ weighted
    expected = np.sqrt(np.diag(inverse @ meat @ inverse))
    assert solution.covariance is not None
    np.testing.assert_allclose(np.sqrt(np.diag(solution.covariance)) / expected, 1.0, atol=0.3)


def test_the_kalman_filter_is_not_biased_by_noise_of_the_torque(planar_2r: Robot, exact_log: MakeLog) -> None:
    """Exact positions, noisy torques: as far from the truth as least squares, and deviations to match."""
    bench = Bench(planar_2r, exact_log, samples=250, friction=("viscous",))
    inside, errors, deviations, plain = [], [], [], []
    for seed in range(5):
        problem = bench.problem(bench.white(seed))
        beta, found = stated(Kalman(), problem)
        errors.append(beta - bench.truth)
        deviations.append(found.deviations)
        inside.append(np.abs(errors[-1]) < found.half_widths())
        plain.append(WLS().solve(problem).beta - bench.truth)
    norms = bench.problem(np.zeros_like(bench.white(0))).reduced(1 / bench.size).column_norms
    size = [np.linalg.norm(np.array(one) * norms) for one in (errors, plain)]
    assert size[0] < 1.5 * size[1]
    assert np.mean(inside) > 0.8
    assert np.all(np.abs(np.mean(errors, axis=0)) < 1.8 * np.mean(deviations, axis=0))
