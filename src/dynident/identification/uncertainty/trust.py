"""An estimate with all that says how far to trust it: diagnostics, cross-validation, bootstrap."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from dynident.arrays import Array
from dynident.errors import BadOption
from dynident.identification.estimate.estimate import Estimate
from dynident.identification.estimators import Estimator
from dynident.identification.estimators.wls import WLS
from dynident.identification.problem.problem import Problem
from dynident.identification.problem.regressor_stream import RegressorStream
from dynident.identification.residuals.coloured import spectral_uncertainty
from dynident.identification.selection.friction.load import with_load
from dynident.identification.uncertainty.diagnostics import diagnose
from dynident.identification.uncertainty.propagation import prediction_deviations, standard_covariance
from dynident.model.reduction import Reduced, least_squares

if TYPE_CHECKING:
    from dynident.identification.uncertainty.bootstrap import BootstrapDraws

#: BootstrapDraws below which a quantile of 2.5 % is a guess.
FEWEST_DRAWS = 40


@dataclass(frozen=True)
class TrustOptions:
    """What is found out about how far to trust an estimate, beyond its covariance.

    Attributes:
        diagnose: Test the residual and the estimate; ``diagnostics`` of the estimate has the figures.
        folds: Parts of the logs for the cross-validation of the diagnostics; 0: none.
        bootstrap: Draws of the bootstrap of the diagnostics; 0: none. It brings the diagnostics with it.
        sensitivity: Fit at half and at double the cut-off as well; ``choices.cutoff_sensitivity`` has the table.
        nominal: Errors of the robot model's own inertias on the same samples; ``nominal`` of the training figures.
    """

    diagnose: bool = False
    folds: int = 5
    bootstrap: int = 0
    sensitivity: bool = False
    nominal: bool = False


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
    problem = with_load(problem, estimate.beta)
    refit = estimator.refit(problem, estimate.run) if draws or (folds and estimator.fits_folds) else None
    measured = problem if problem.bias is None else replace(problem.without(-problem.bias), bias=None)
    found: dict[str, Any] = diagnose(measured, estimator, estimate.beta, folds, refit).figures()
    found["bootstrap"] = _bootstrap(estimate, problem, refit, draws) if draws else None
    regressor, kept = RegressorStream(estimate.model, estimate.base, estimate.beta), problem.kept
    of_rows = [(log, kept and kept.of_log(k)) for k, log in enumerate(problem.logs)]
    spread = np.concatenate([prediction_deviations(regressor, log, estimate.covariance, own) for log, own in of_rows])
    deviations = None
    if estimate.theta is not None:
        variances = np.diag(standard_covariance(estimate, problem, estimator.prior_pull))
        deviations = np.sqrt(np.maximum(variances, 0.0))
    train = replace(estimate.train, deviations=spread, noise=estimate.joint_deviations)
    return replace(estimate, diagnostics=found, train=train, standard_deviations=deviations)


def _bootstrap(
    estimate: Estimate, problem: Problem, refit: Callable[[Reduced], Array] | None, draws: int
) -> dict[str, Any]:
    """Return intervals by bootstrap: possible robots fitted again, or residuals drawn again in blocks."""
    if refit is not None:
        weights = WLS().solve(problem).weights
        covariance = spectral_uncertainty(problem, weights, estimate.beta).covariance  # a draw is pulled by its own fit
        kind, found = "refit", refit_draws(problem, refit, covariance, draws)
    else:
        from dynident.identification.uncertainty.bootstrap import block_bootstrap

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


def refit_draws(
    problem: Problem, refit: Callable[[Reduced], Array], covariance: Array, draws: int = 200
) -> BootstrapDraws:
    """Return possible robots fitted to base parameters drawn from N(least squares, covariance).

    Args:
        problem: The problem.
        refit: From a triangle to standard parameters, of :meth:`Estimator.refit`.
        covariance: Of the least-squares estimate, shape (b, b).
        draws: How many.

    Raises:
        SolverFailed: No solver found a checked solution of a draw.
    """
    from dynident.identification.uncertainty.bootstrap import refitted

    reduced = problem.reduced(WLS().solve(problem).weights)
    return refitted(reduced, least_squares(reduced).beta, covariance, refit, problem.base.from_standard, draws)
