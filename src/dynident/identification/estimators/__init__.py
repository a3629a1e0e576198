"""Estimators, a family: one part per file, each a pure method from a Problem to a Solution."""

from dynident.identification.problem.estimator import Estimator, Solution
from dynident.plugins import Family

ESTIMATORS: Family[Estimator] = Family(
    "dynident.identification.estimators",
    Estimator,  # type: ignore[type-abstract]
    "estimator",
    rooms=("dynident.identification.simulated.estimators",),
)

__all__ = ["ESTIMATORS", "Estimator", "Solution"]
