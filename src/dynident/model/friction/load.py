"""Coulomb friction that grows with the torque which the gear transmits."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from dynident.model.friction.base import Coefficient, Friction, Inputs, Number, Range, SelectionUse, smooth_sign
from dynident.plugins import bounded


@dataclass(frozen=True)
class Load(Friction):
    """Load-dependent Coulomb friction Fl |torque| tanh(dq / width), the torque that of the model without friction.

    The torque is the estimate's own: identification repeats the linear fit until the two agree (Hamon, Gautier and
    Garrec 2010 take it from the measurement instead, whose noise is then in the regressor). Fl is a loss: 0.05 means
    that 5 % of the load is lost.

    Attributes:
        width: Smoothing width of the Coulomb term (tanh), in rad/s (or m/s).
    """

    width: float = bounded(0.02, least=1e-9, most=1e3)

    coefficients: ClassVar = (Coefficient("Fl", "1", "1", nonnegative=True),)
    ranges: ClassVar = {"width": Range(1e-3, 0.3, is_speed=True)}
    selection: ClassVar = SelectionUse(5, {"width": 0.01, "choose": ("part", "width")})

    def terms(self, at: Inputs) -> tuple[Number, ...]:
        return (abs(at.load) * smooth_sign(at.dq, self.width),)
