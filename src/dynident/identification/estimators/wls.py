"""Weighted least squares with the residual variance of each joint."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from dynident.errors import BadOption
from dynident.identification.problem.estimator import Estimator, Solution
from dynident.identification.problem.method_run import MethodRun
from dynident.identification.problem.problem import Problem
from dynident.model.reduction import least_squares
from dynident.plugins import bounded


@dataclass(frozen=True)
class WLS(Estimator):
    """Weighted least squares: each joint weighted by its residual standard deviation (Gautier and Poignet 2001).

    Attributes:
        iterations: How often the weights are renewed at most.
        tolerance: Relative change of the weights that ends the iteration.
    """

    iterations: int = bounded(10, most=10_000)
    tolerance: float = 1e-3

    from_triangles: ClassVar = True
    fits_folds: ClassVar = True

    def __post_init__(self) -> None:
        self.check_steps(self.iterations)
        if not 0 <= self.tolerance < np.inf:
            raise BadOption("tolerance", self.tolerance, "give a relative change, 0 or more")

    def solve(self, problem: Problem) -> Solution:
        beta = least_squares(problem.reduced()).beta
        weights = 1.0 / problem.joint_deviations(beta)
        done, settled = 0, False
        while not settled and done < self.iterations:
            done += 1
            beta = least_squares(problem.reduced(weights)).beta
            renewed = 1.0 / problem.joint_deviations(beta)
            settled = bool(np.all(np.abs(renewed - weights) <= self.tolerance * weights))
            weights = renewed
        return Solution(beta, weights, run=MethodRun(iterations=done))
