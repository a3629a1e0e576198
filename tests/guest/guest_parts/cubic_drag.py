"""Drag that grows with the cube of the speed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from dynident.arrays import Array
from dynident.model.friction import Friction, Motion
from dynident.model.friction.base import Coefficient, no_slopes


@dataclass(frozen=True)
class CubicDrag(Friction):
    """Torque Fc3 dq^3 of a churning lubricant."""

    coefficients: ClassVar = (Coefficient("Fc3", "N m s^3/rad^3", "N s^3/m^3", nonnegative=True),)

    def columns(self, motion: Motion) -> Array:
        return (motion.dq**3)[..., None]

    def derivatives(self, motion: Motion) -> tuple[Array, Array, Array]:
        return no_slopes(motion), (3.0 * motion.dq**2)[..., None], no_slopes(motion)
