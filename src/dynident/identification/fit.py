"""The bare fit: a problem and an estimator to an estimate with covariance, verdicts and provenance."""

from __future__ import annotations

import platform
import time
from collections.abc import Callable
from dataclasses import asdict, is_dataclass, replace
from importlib.metadata import version
from typing import Any

import numpy as np

from dynident.data.formats import ColumnMap
from dynident.identification.consistency.verdicts import judge
from dynident.identification.estimate.envelope import envelope_of
from dynident.identification.estimate.estimate import Estimate
from dynident.identification.estimators import ESTIMATORS, Estimator
from dynident.identification.estimators.wls import WLS
from dynident.identification.problem.estimator import Solution
from dynident.identification.problem.problem import Problem
from dynident.identification.residuals.coloured import spectral_uncertainty
from dynident.identification.residuals.covariance import correlation_factors
from dynident.identification.selection.friction.load import PASSES, agrees, with_load
from dynident.identification.uncertainty.propagation import field_covariance, gain_uncertainty
from dynident.identification.validate import validate_prepared
from dynident.model.reduction import least_squares


def fit(problem: Problem, estimator: Estimator, progress: Callable[[str], None] = lambda step: None) -> Estimate:
    """Return the estimate of one estimator, with covariance, verdicts and provenance.

    Args:
        problem: The problem, of :func:`~dynident.identification.build_problem.build_problem`.
        estimator: The estimator.
        progress: Called with each step in words.

    Raises:
        SolverFailed: The estimator found no checked solution.
    """
    model, base = problem.model, problem.base
    progress(f"estimator {ESTIMATORS.name_of(estimator)}")
    started = time.perf_counter()
    if estimator.may_not_converge:
        problem, _ = _solved(problem, WLS(), progress)
        solution = estimator.solve(problem)
    else:
        problem, solution = _solved(problem, estimator, progress)
    seconds = time.perf_counter() - started
    deviations = problem.joint_deviations(solution.beta)
    train = validate_prepared(model, base, problem.logs, solution.beta)
    factors = correlation_factors(np.split(train.residual, train.starts[1:]), problem.masks)
    covariance, degrees = solution.covariance, solution.degrees
    choices = replace(
        problem.choices,
        gain_std=gain_uncertainty(problem, solution.weights),
        constraints_not_kept=not_kept(problem, estimator),
    )
    if covariance is None:
        found = spectral_uncertainty(problem, solution.weights, solution.beta)
        pull = solution.pull(problem)
        found = found.with_prior(field_covariance(problem, solution.beta, deviations, factors))
        covariance, degrees = found.covariance + np.outer(pull, pull), found.degrees
    return Estimate(
        model=model,
        base=base,
        beta=solution.beta,
        covariance=covariance,
        theta=solution.theta,
        joint_deviations=deviations,
        correlation_factors=factors,
        condition_number=least_squares(problem.reduced(1.0 / deviations)).condition_number,
        samples=problem.samples,
        inertial_base_parameters=base.rank_of(model.inertial_count),
        estimator=ESTIMATORS.name_of(estimator),
        options=asdict(estimator) if is_dataclass(estimator) else {},
        consistency=judge(model, base, solution.beta, solution.theta),
        train=train,
        preprocessing=problem.preprocessing,
        columns=ColumnMap(joints=model.robot.joint_names),
        choices=choices,
        run=replace(solution.run, seconds=seconds),
        provenance={**versions(), "logs": [asdict(log.kept.source) for log in problem.logs]},
        degrees=degrees,
        envelope=envelope_of([log.kept for log in problem.logs], problem.triangles, covariance),
    )


def _solved(problem: Problem, estimator: Estimator, progress: Callable[[str], None]) -> tuple[Problem, Solution]:
    """Return the problem with the load of the drives that its own solution has, and that solution."""
    solution = estimator.solve(problem)
    for _ in range(PASSES):
        if agrees(problem, solution.beta):
            break
        progress("load of the drives")
        problem = with_load(problem, solution.beta)
        solution = estimator.solve(problem)
    return problem, solution


def not_kept(problem: Problem, estimator: Estimator) -> str | None:
    """Return the name of an estimator that leaves stated constraints aside, for a warning; None where none are."""
    if problem.constraints.is_empty or estimator.keeps_constraints:
        return None
    return ESTIMATORS.name_of(estimator)


def versions() -> dict[str, Any]:
    """Return the versions that produced a result."""
    packages = ("dynident", "numpy", "scipy", "numba", "clarabel")
    return {
        "versions": {name: version(name) for name in packages},
        "python": platform.python_version(),
        "platform": platform.platform(),
    }
