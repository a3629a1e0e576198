"""Ordinary least squares."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from dynident.identification.problem.estimator import Estimator, Solution
from dynident.identification.problem.problem import Problem
from dynident.model.reduction import least_squares


@dataclass(frozen=True)
class OLS(Estimator):
    """Ordinary least squares: equal weight of all equations, in N m (Atkeson, An and Hollerbach 1986)."""

    from_triangles: ClassVar = True
    fits_folds: ClassVar = True

    def solve(self, problem: Problem) -> Solution:
        weights = np.ones(len(problem.triangles))
        return Solution(least_squares(problem.reduced(weights)).beta, weights)
