"""Viscous friction that grows more slowly than speed, as greased gears show."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from dynident.errors import BadOption
from dynident.model.friction.base import Coefficient, Friction, Inputs, Number, Range, SelectionUse, power
from dynident.plugins import bounded


@dataclass(frozen=True)
class Degressive(Friction):
    """Sub-linear viscous friction Fd dq (dq^2 + width^2)^((exponent - 1) / 2): |dq|^exponent, smooth at standstill.

    Greases thin under shear: their drag grows with a power of speed below one (power-law fluid). Speeds count in units
    of 1 rad/s (1 m/s), so that Fd is the torque at that speed.

    Attributes:
        exponent: Power of the speed, above 0 and below 1.
        width: Speed in rad/s (or m/s) below which it is a straight line.
    """

    exponent: float = 0.5
    width: float = bounded(0.02, least=1e-9, most=1e3)

    coefficients: ClassVar = (Coefficient("Fd", "N m", "N", nonnegative=True),)
    ranges: ClassVar = {"exponent": Range(0.2, 0.8)}
    selection: ClassVar = SelectionUse(4, {"choose": ("part",)})

    def __post_init__(self) -> None:
        if not 0 < self.exponent < 1:
            raise BadOption("exponent", self.exponent, "give a power between 0 and 1; 1 is the part 'viscous'")
        super().__post_init__()

    def terms(self, at: Inputs) -> tuple[Number, ...]:
        return (at.dq * power(at.dq**2 + self.width**2, (self.exponent - 1.0) / 2.0),)
