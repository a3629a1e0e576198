"""Load-dependent friction that falls from standstill to slow motion."""

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
    smooth_sign,
)
from dynident.plugins import bounded


@dataclass(frozen=True)
class LoadStribeck(Friction):
    """Load-dependent Stribeck effect Fls |torque| exp(-(dq / velocity)^2) tanh(dq / width), torque as for ``load``.

    Teeth under load lubricate worse at low speed: what a gear loses of its load is larger there (Duclusaud, Passault,
    Padois and Ly 2025, model M4). It stands beside ``load``, the share that is lost at all speeds.

    Attributes:
        velocity: Stribeck velocity in rad/s (or m/s): the speed at which the effect has faded to 1 / e.
        width: Smoothing width of the Coulomb term (tanh), in rad/s (or m/s).
    """

    velocity: float = 0.1
    width: float = bounded(0.02, least=1e-9, most=1e3)

    coefficients: ClassVar = (Coefficient("Fls", "1", "1", nonnegative=True),)
    ranges: ClassVar = {"velocity": Range(0.01, 2.0, is_speed=True), "width": Range(1e-3, 0.3, is_speed=True)}
    selection: ClassVar = SelectionUse(7, {"velocity": 0.1, "width": 0.01, "choose": ("part", "width", "velocity")})
    after: ClassVar = ("load", "load_directional")

    def terms(self, at: Inputs) -> tuple[Number, ...]:
        slow = exponential(-((at.dq / self.velocity) ** 2)) * smooth_sign(at.dq, self.width)
        return (abs(at.load) * slow,)
