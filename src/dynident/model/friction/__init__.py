"""Friction and drive terms, a family: one part per file, each a block of regressor columns."""

from dynident.model.friction.base import WHOLE, Coefficient, Friction, Motion
from dynident.plugins import Family

FRICTION: Family[Friction] = Family("dynident.model.friction", Friction, "friction model")  # type: ignore[type-abstract]

#: Names of the parts of a model whose friction is not stated.
DEFAULT_FRICTION = ("coulomb", "viscous", "offset")

__all__ = ["DEFAULT_FRICTION", "FRICTION", "WHOLE", "Coefficient", "Friction", "Motion"]
