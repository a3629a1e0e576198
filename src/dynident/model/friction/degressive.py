"""Viscous friction that grows more slowly than speed, as greased gears show."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from dynident.arrays import Array
from dynident.errors import BadOption
from dynident.model.friction.base import Coefficient, Friction, Motion, Range, check_positive, no_slopes


@dataclass(frozen=True)
class Degressive(Friction):
    """Friction Fd dq (dq^2 + width^2)^((exponent - 1) / 2): a power |dq|^exponent below 1, smooth at standstill.

    Greases thin under shear: their drag grows with a power of speed below one (power-law fluid). Speeds count in units
    of 1 rad/s (1 m/s), so that Fd is the torque at that speed.

    Attributes:
        exponent: Power of the speed, above 0 and below 1.
        width: Speed in rad/s (or m/s) below which it is a straight line.
    """

    exponent: float = 0.5
    width: float = 0.02

    coefficients: ClassVar = (Coefficient("Fd", "N m", "N", nonnegative=True),)
    ranges: ClassVar = {"exponent": Range(0.2, 0.8)}

    def __post_init__(self) -> None:
        if not 0 < self.exponent < 1:
            raise BadOption("exponent", self.exponent, "give a power between 0 and 1; 1 is the part 'viscous'")
        check_positive(self.width, "width", "a speed in rad/s")

    def columns(self, motion: Motion) -> Array:
        dq = motion.dq
        return (dq * (dq**2 + self.width**2) ** ((self.exponent - 1.0) / 2.0))[..., None]

    def derivatives(self, motion: Motion) -> tuple[Array, Array, Array]:
        square, width = motion.dq**2, self.width**2
        slope = (self.exponent * square + width) * (square + width) ** ((self.exponent - 3.0) / 2.0)
        return no_slopes(motion), slope[..., None], no_slopes(motion)
