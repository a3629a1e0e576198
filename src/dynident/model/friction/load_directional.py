"""Load-dependent friction by the direction of the power: the motor moves the load, or the load moves the motor."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from dynident.model.friction.base import (
    Coefficient,
    Friction,
    Inputs,
    Number,
    Range,
    SelectionUse,
    exponential,
    larger,
    smaller,
    smooth_sign,
)
from dynident.plugins import bounded


@dataclass(frozen=True)
class LoadDirectional(Friction):
    """Load friction |torque| (Fl+ or Fl-) exp(-(dq / velocity)^2) tanh(dq / width), by the direction of the power.

    Fl+ where the motor moves the load, Fl- where the load moves the motor: a gear is less efficient one way than the
    other (Duclusaud, Passault, Padois and Ly 2025, model M5). With a velocity far above that of the motion it stands in
    the place of ``load``, else in that of ``load_stribeck``.

    Attributes:
        velocity: Speed in rad/s (or m/s) at which it has faded to 1 / e.
        width: Smoothing width of the Coulomb term (tanh), in rad/s (or m/s).
    """

    velocity: float = 0.1
    width: float = bounded(0.02, least=1e-9, most=1e3)

    coefficients: ClassVar = (
        Coefficient("Fl+", "1", "1", nonnegative=True),
        Coefficient("Fl-", "1", "1", nonnegative=True),
    )
    ranges: ClassVar = {"velocity": Range(0.01, 100.0, is_speed=True), "width": Range(1e-3, 0.3, is_speed=True)}
    selection: ClassVar = SelectionUse(8, {"velocity": 100.0, "width": 0.01, "choose": ("part", "width", "velocity")})
    in_place_of: ClassVar = ("load",)
    contains: ClassVar = ("load_stribeck",)

    def terms(self, at: Inputs) -> tuple[Number, ...]:
        slow = exponential(-((at.dq / self.velocity) ** 2))
        sign, up, down = smooth_sign(at.dq, self.width), larger(at.load, 0.0), smaller(at.load, 0.0)
        forth, back = larger(sign, 0.0), smaller(sign, 0.0)
        return slow * (up * forth - down * back), slow * (up * back - down * forth)
