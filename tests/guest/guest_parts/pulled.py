"""Weighted least squares with a pull to zero."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dynident.errors import BadOption
from dynident.identification.estimators import Estimator, Solution
from dynident.identification.problem.problem import Problem
from dynident.model.reduction import least_squares


@dataclass(frozen=True)
class Pulled(Estimator):
    """beta = argmin |R beta - z|^2 + strength |D beta|^2, D the norms of the columns.

    Attributes:
        strength: Share of a column's own weight that pulls it to zero.
    """

    strength: float = 1e-14

    def __post_init__(self) -> None:
        if not 0 <= self.strength < 1:
            raise BadOption("strength", self.strength, "give a number from 0 to less than 1")

    def solve(self, problem: Problem) -> Solution:
        weights = 1.0 / problem.joint_deviations(least_squares(problem.reduced()).beta)
        reduced = problem.reduced(weights)
        pull = np.sqrt(self.strength) * np.diag(reduced.column_norms)
        rows, target = np.vstack([reduced.r, pull]), np.concatenate([reduced.z, np.zeros(len(reduced.z))])
        return Solution(np.linalg.lstsq(rows, target)[0], weights)
