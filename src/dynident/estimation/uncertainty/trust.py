"""An estimate with all that says how far to trust it: diagnostics, cross-validation, bootstrap."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from dynident.arrays import Array
from dynident.errors import BadOption
from dynident.estimation.consistency.consistent_fit import consistent_fit, scale_of
from dynident.estimation.estimate import Estimate
from dynident.estimation.estimators import Estimator
from dynident.estimation.estimators.consistent import Consistent
from dynident.estimation.estimators.wls import WLS
from dynident.estimation.friction.load import with_load
from dynident.estimation.observer import Observer
from dynident.estimation.problem import Problem
from dynident.estimation.uncertainty.diagnostics import diagnose
from dynident.estimation.uncertainty.propagation import PULL, prediction_deviations, standard_covariance
from dynident.model.reduction import Reduced, least_squares

if TYPE_CHECKING:
    from dynident.estimation.uncertainty.bootstrap import Draws

#: Draws below which a quantile of 2.5 % is a guess.
FEWEST_DRAWS = 40


def with_diagnostics(
    estimate: Estimate, problem: Problem, estimator: Estimator, folds: int = 5, draws: int = 0
) -> Estimate:
    """Return the estimate with its diagnostics as plain data, bands of its torques and deviations of its theta.

    Args:
        estimate: The estimate.
        problem: The problem that it solves.
        estimator: What found it.
        folds: Parts of the logs for cross-validation; 0: none.
        draws: Draws of the bootstrap; 0: none.

    Raises:
        BadOption: One part, or too few draws for an interval.
    """
    if draws and draws < FEWEST_DRAWS:
        raise BadOption("bootstrap", draws, f"give {FEWEST_DRAWS} draws or more, such as 200")
    if "torque" in problem.model.needs:
        problem = with_load(problem, estimate.beta)
    found: dict[str, Any] = diagnose(problem, estimator, estimate.beta, folds).figures()
    found["bootstrap"] = _bootstrap(estimate, problem, estimator, draws) if draws else None
    observer = Observer(estimate.model, estimate.base, estimate.beta)
    spread = np.concatenate([prediction_deviations(observer, log, estimate.covariance) for log in problem.logs])
    return replace(
        estimate,
        diagnostics=found,
        train=replace(estimate.train, deviations=spread, noise=estimate.joint_deviations),
        standard_deviations=None if estimate.theta is None else _standard_deviations(estimate, problem),
    )


def _standard_deviations(estimate: Estimate, problem: Problem) -> Array:
    pull = estimate.options.get("pull") or PULL
    return np.sqrt(np.maximum(np.diag(standard_covariance(estimate, problem, pull)), 0.0))


def _bootstrap(estimate: Estimate, problem: Problem, estimator: Estimator, draws: int) -> dict[str, Any]:
    """Return intervals by bootstrap: possible robots fitted again, or residuals drawn again in blocks."""
    if isinstance(estimator, Consistent):
        kind, found = "refit", consistent_draws(problem, estimator, estimate.covariance, draws)
    else:
        from dynident.estimation.uncertainty.bootstrap import block_bootstrap

        kind, found = "blocks", block_bootstrap(problem, WLS().solve(problem).weights, estimate.beta, draws)
    low, high = found.interval()
    theta = found.theta
    return {
        "kind": kind,
        "draws": draws,
        "block": found.block,
        "std": np.std(found.beta, axis=0, ddof=1).tolist(),
        "low": low.tolist(),
        "high": high.tolist(),
        "standard_std": None if theta is None else np.std(theta, axis=0, ddof=1).tolist(),
    }


def consistent_draws(problem: Problem, estimator: Consistent, covariance: Array, draws: int = 200) -> Draws:
    """Return possible robots fitted to base parameters drawn from N(least squares, covariance).

    Args:
        problem: The problem.
        estimator: The consistent estimator with its options.
        covariance: Of the least-squares estimate, shape (b, b).
        draws: How many.

    Raises:
        SolverFailed: No solver found a checked solution of a draw.
    """
    from dynident.estimation.uncertainty.bootstrap import refitted

    reduced, scale = problem.reduced(WLS().solve(problem).weights), scale_of(problem)

    def fit(drawn: Reduced) -> Array:
        pull, margin, metric = estimator.pull, estimator.margin, estimator.metric
        return consistent_fit(
            problem.model, problem.base, drawn, scale, pull, margin, metric, problem.constraints
        ).theta

    return refitted(reduced, least_squares(reduced).beta, covariance, fit, problem.base.from_standard, draws)
