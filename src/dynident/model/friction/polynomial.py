"""Viscous friction beyond the straight line: second and third power of the speed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from dynident.model.friction.base import Coefficient, Friction, Inputs, Number


@dataclass(frozen=True)
class Polynomial(Friction):
    """Super-linear viscous friction Fv2 |dq| dq + Fv3 dq^3; ``viscous`` is the linear term beside it.

    Both are >= 0, so that the friction stays a friction beyond the speeds of the log. Friction that grows more slowly
    than speed is ``degressive``.
    """

    coefficients: ClassVar = (
        Coefficient("Fv2", "N m s^2/rad^2", "N s^2/m^2", nonnegative=True),
        Coefficient("Fv3", "N m s^3/rad^3", "N s^3/m^3", nonnegative=True),
    )

    def terms(self, at: Inputs) -> tuple[Number, ...]:
        return abs(at.dq) * at.dq, at.dq**3
