"""Drag that grows with the cube of the speed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from dynident.model.friction.base import Coefficient, Friction, Inputs, Number


@dataclass(frozen=True)
class CubicDrag(Friction):
    """Torque Fc3 dq^3 of a churning lubricant."""

    coefficients: ClassVar = (Coefficient("Fc3", "N m s^3/rad^3", "N s^3/m^3", nonnegative=True),)

    def terms(self, at: Inputs) -> tuple[Number, ...]:
        return (at.dq**3,)
