"""Viscous friction."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from dynident.model.friction.base import Coefficient, Friction, Inputs, Number, SelectionUse


@dataclass(frozen=True)
class Viscous(Friction):
    """Viscous friction Fv dq, equation (3)."""

    coefficients: ClassVar = (Coefficient("Fv", "N m s/rad", "N s/m", nonnegative=True, in_simulators="damping"),)
    selection: ClassVar = SelectionUse(1, is_default=True)

    def terms(self, at: Inputs) -> tuple[Number, ...]:
        return (at.dq,)
