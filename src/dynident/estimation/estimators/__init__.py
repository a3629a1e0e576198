"""Estimators, a family: one part per file, each a pure method from a Problem to a Solution."""

from dynident.estimation.estimators.base import Estimator, Solution
from dynident.plugins import Family

ESTIMATORS: Family[Estimator] = Family("dynident.estimation.estimators", Estimator, "estimator")  # type: ignore[type-abstract]

__all__ = ["ESTIMATORS", "Estimator", "Solution"]
