"""The Stribeck effect: friction that falls from standstill to slow motion."""

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
    power,
    smooth_sign,
)
from dynident.plugins import bounded


@dataclass(frozen=True)
class Stribeck(Friction):
    """Friction Fs exp(-(|dq| / velocity)^exponent) tanh(dq / width), Stribeck effect (Armstrong-Helouvry 1991).

    Fs is what friction at the least speed has above the Coulomb level, so ``coulomb`` stands beside it.

    Attributes:
        velocity: Stribeck velocity in rad/s (or m/s): the speed at which the effect has faded to 1 / e.
        exponent: How sharply it fades: 1 (Tustin) to 2 (Gauss).
        width: Smoothing width of the Coulomb term (tanh), in rad/s (or m/s).
    """

    velocity: float = 0.1
    exponent: float = 1.0
    width: float = bounded(0.02, least=1e-9, most=1e3)

    coefficients: ClassVar = (Coefficient("Fs", "N m", "N", nonnegative=True),)
    ranges: ClassVar = {
        "velocity": Range(0.01, 2.0, is_speed=True),
        "exponent": Range(1.0, 2.0),
        "width": Range(1e-3, 0.3, is_speed=True),
    }
    selection: ClassVar = SelectionUse(
        6, {"velocity": 0.1, "width": 0.01, "choose": ("part", "width", "velocity", "exponent")}
    )

    def terms(self, at: Inputs) -> tuple[Number, ...]:
        fading = exponential(-power(abs(at.dq) / self.velocity, self.exponent))
        return (fading * smooth_sign(at.dq, self.width),)
