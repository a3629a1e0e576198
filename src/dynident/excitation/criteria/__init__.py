"""Excitation criteria, a family: what makes one motion better than another, one measure per part."""

from dynident.excitation.criteria.base import Criterion
from dynident.plugins import Family

CRITERIA: Family[Criterion] = Family("dynident.excitation.criteria", Criterion, "criterion")  # type: ignore[type-abstract]

__all__ = ["CRITERIA", "Criterion"]
