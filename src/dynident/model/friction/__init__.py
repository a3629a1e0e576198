"""Friction and drive terms, a family: one part per file, each a block of regressor columns."""

from dynident.model.friction.base import WHOLE, Coefficient, Friction, Motion
from dynident.plugins import Family

FRICTION: Family[Friction] = Family("dynident.model.friction", Friction, "friction model")  # type: ignore[type-abstract]

__all__ = ["FRICTION", "WHOLE", "Coefficient", "Friction", "Motion"]
