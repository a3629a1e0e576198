"""Is least squares biased by noise in the regressor? The test of Durbin, Wu and Hausman.

Least squares is unbiased only where the regressor does not depend on the noise of the equation (exogeneity); in closed
loop with differentiated encoder noise it does. Instruments that are free of that noise give an estimate that holds
either way. If both estimate the same, they differ by chance alone: d = beta_iv - beta_ls with a covariance that
follows from the rows, d' cov(d)^+ d is chi-squared. Source: Durbin 1954, Wu 1973, Hausman 1978; for robots: Janot,
Vandanjon and Gautier 2014. The covariance of the difference is taken from the rows of both estimates at once, so it
needs neither white residuals nor an efficient least-squares estimate.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dynident.arrays import Array
from dynident.errors import SolverFailed
from dynident.identification.residuals.instruments import Instruments
from dynident.identification.residuals.quantiles import chi_square_tail, normal_share
from dynident.model.reduction import least_squares

#: Directions of the difference whose deviation is below this share of the largest, in units of the deviations of the
#: estimate, hold no test.
NO_TEST = 1e-6


@dataclass(frozen=True)
class Exogeneity:
    """What the test of Durbin, Wu and Hausman says.

    Attributes:
        statistic: d' cov(d)^+ d.
        degrees: Rank of cov(d): degrees of freedom of the chi-squared distribution.
        p_value: Chance of a statistic as large where least squares is unbiased.
        difference: Instrumental-variable estimate less least squares, shape (b,), in the parameters' units.
        deviations: Standard deviation of the difference, shape (b,).
        p_values: Of each parameter's difference by itself, two-sided, shape (b,); 1 where it cannot differ.
    """

    statistic: float
    degrees: int
    p_value: float
    difference: Array
    deviations: Array
    p_values: Array

    def is_biased(self, level: float = 0.01) -> bool:
        """Return whether least squares is found biased at a level of significance."""
        return self.p_value < level


def durbin_wu_hausman(made: Instruments, weights: Array | None = None) -> Exogeneity:
    """Test whether noise in the regressor biases least squares.

    Args:
        made: Instruments beside the regressor, from ``instruments``.
        weights: Weight of each joint's rows in both estimates, shape (n,); None: 1 / residual deviations.

    Raises:
        SolverFailed: The instruments do not go with the regressor, or are the regressor itself.
    """
    problem = made.problem
    if weights is None:
        weights = 1.0 / problem.joint_deviations(least_squares(problem.reduced()).beta)
    plain = least_squares(problem.reduced(weights))
    beta = made.solve(weights)
    spread = made.difference_root(weights, beta, plain.unscaled_covariance)
    own = np.sqrt(np.diag(plain.unscaled_covariance))
    _, values, directions = np.linalg.svd(spread / own, full_matrices=False)
    level = NO_TEST * max(float(values[0]), 1.0) if len(values) else 0.0
    kept = values > level
    if not kept.any():
        step = "give reference_hz, or log commanded positions"
        raise SolverFailed("the test of exogeneity", "the instruments are the regressor itself", step)
    difference = beta - plain.beta
    statistic = float(np.sum((directions[kept] @ (difference / own) / values[kept]) ** 2))
    degrees = int(kept.sum())
    deviations = np.linalg.norm(spread, axis=0)
    ratio = np.abs(difference) / np.where(deviations > level * own, deviations, np.inf)
    p_value = float(chi_square_tail(statistic, degrees))
    return Exogeneity(statistic, degrees, p_value, difference, deviations, 2.0 * normal_share(-ratio))
