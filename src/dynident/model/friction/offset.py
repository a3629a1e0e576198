"""A constant torque: sensor or amplifier offset, and the asymmetry of Coulomb friction."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from dynident.model.friction.base import Coefficient, Friction, Inputs, Number, SelectionUse


@dataclass(frozen=True)
class Offset(Friction):
    """Constant torque offset F0 per drive."""

    coefficients: ClassVar = (Coefficient("F0", "N m", "N", nonnegative=False),)
    selection: ClassVar = SelectionUse(2, is_default=True)

    def terms(self, at: Inputs) -> tuple[Number, ...]:
        return (1.0,)
