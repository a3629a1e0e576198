"""Tukey's biweight M-estimator."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dynident.errors import BadOption
from dynident.identification.problem.estimator import Estimator, Solution
from dynident.identification.problem.problem import Problem
from dynident.identification.residuals.robust import biweight_loss, huber_loss, robust_fit, robust_solution
from dynident.identification.residuals.row_passes import RowPasses
from dynident.model.reduction import least_squares
from dynident.plugins import bounded

#: Bound of the Huber fit that Tukey's begins at.
START = 1.345


@dataclass(frozen=True)
class Tukey(Estimator):
    """Tukey's biweight M-estimator: residuals beyond c scales have zero weight (Beaton and Tukey 1974; Huber 1981).

    Not convex, so the start matters: it begins at Huber's estimate and holds its scales, as an MM-estimator does
    (Yohai 1987), whose start here is not safe against gross errors in the motion.

    Attributes:
        bound: c, in scales; 4.685 costs 5 % of efficiency on normal data.
        iterations: Steps at most, of the start and of the fit each.
        tolerance: Step, in standard deviations of the fit, that ends it.
    """

    bound: float = 4.685
    iterations: int = bounded(200, most=10_000)
    tolerance: float = 1e-3

    def __post_init__(self) -> None:
        if not 1.5 <= self.bound < np.inf:
            raise BadOption("bound", self.bound, "give a number of scales, 1.5 or more, such as 4.685")
        self.check_steps(self.iterations, self.tolerance, 0.001)

    def solve(self, problem: Problem) -> Solution:
        """Return the estimate.

        Raises:
            PoorExcitation: The rows do not determine all base parameters.
            SolverFailed: Not settled after so many steps, or most rows of a joint lie far out.
        """
        passes, loss = RowPasses(problem), biweight_loss(self.bound)
        plain = least_squares(problem.reduced()).beta
        start = robust_fit(passes, huber_loss(START), plain, None, self.iterations, self.tolerance)
        fit = robust_fit(passes, loss, start.beta, start.scale, self.iterations, self.tolerance)
        return robust_solution(passes, loss, fit, start.iterations + fit.iterations)
