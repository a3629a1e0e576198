"""Huber's M-estimator."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dynident.errors import BadOption
from dynident.identification.problem.estimator import Estimator, Solution
from dynident.identification.problem.problem import Problem
from dynident.identification.residuals.robust import huber_loss, robust_fit, robust_solution
from dynident.identification.residuals.row_passes import RowPasses
from dynident.model.reduction import least_squares
from dynident.plugins import bounded


@dataclass(frozen=True)
class Huber(Estimator):
    """Huber's M-estimator: squares near zero, absolute values beyond k scales of the joint (Huber 1964; 1981).

    Convex for a given scale, so the start does not matter; the scale of a joint is its median absolute residual times
    1.4826. Rows with a gross error in the torque keep a bounded pull. A gross error in the motion is not seen.

    Attributes:
        bound: k, in scales; 1.345 costs 5 % of efficiency on normal data.
        iterations: Steps at most.
        tolerance: Step, in standard deviations of the fit, and relative change of the scales that end it.
    """

    bound: float = 1.345
    iterations: int = bounded(200, most=10_000)
    tolerance: float = 1e-3

    def __post_init__(self) -> None:
        if not 0 < self.bound < np.inf:
            raise BadOption("bound", self.bound, "give a number of scales above 0, such as 1.345")
        self.check_steps(self.iterations, self.tolerance, 0.001)

    def solve(self, problem: Problem) -> Solution:
        """Return the estimate.

        Raises:
            PoorExcitation: The rows do not determine all base parameters.
            SolverFailed: Not settled after so many steps.
        """
        passes, loss = RowPasses(problem), huber_loss(self.bound)
        start = least_squares(problem.reduced()).beta
        fit = robust_fit(passes, loss, start, None, self.iterations, self.tolerance)
        return robust_solution(passes, loss, fit, fit.iterations)
