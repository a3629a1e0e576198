"""Friction that changes with the temperature of the drive."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from dynident.arrays import Array
from dynident.errors import BadOption
from dynident.model.friction.base import (
    Coefficient,
    Friction,
    Motion,
    check_positive,
    no_slopes,
    signal,
    smooth_sign,
)


@dataclass(frozen=True)
class Temperature(Friction):
    """Change of dry and viscous friction per degree: (FcT tanh(dq / width) + FvT dq) (T - reference).

    Stands beside ``coulomb`` and ``viscous``, which then hold at the reference. Cold grease is stiff, so both are
    negative as a rule. The log must have a temperature of each drive.

    Attributes:
        reference: Temperature in degrees Celsius at which the part adds nothing.
        width: Speed in rad/s (or m/s) over which the sign turns.
    """

    reference: float = 25.0
    width: float = 0.02

    coefficients: ClassVar = (
        Coefficient("FcT", "N m/K", "N/K", nonnegative=False),
        Coefficient("FvT", "N m s/(rad K)", "N s/(m K)", nonnegative=False),
    )
    needs: ClassVar = ("temperature",)

    def __post_init__(self) -> None:
        if not -273.15 < self.reference < np.inf:
            raise BadOption("reference", self.reference, "give a temperature in degrees Celsius")
        check_positive(self.width, "width", "a speed in rad/s")

    def columns(self, motion: Motion) -> Array:
        above = signal(motion, "temperature", "temperature") - self.reference
        sign, _ = smooth_sign(motion.dq, self.width)
        return np.stack([above * sign, above * motion.dq], axis=-1)

    def derivatives(self, motion: Motion) -> tuple[Array, Array, Array]:
        above = signal(motion, "temperature", "temperature") - self.reference
        _, slope = smooth_sign(motion.dq, self.width)
        return no_slopes(motion, 2), np.stack([above * slope, above], axis=-1), no_slopes(motion, 2)
