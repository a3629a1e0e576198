"""Coulomb friction that grows with the torque which the gear transmits."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from dynident.arrays import Array
from dynident.model.friction.base import (
    Coefficient,
    Friction,
    Motion,
    Range,
    check_positive,
    no_slopes,
    signal,
    smooth_sign,
)


@dataclass(frozen=True)
class Load(Friction):
    """Dry friction Fl |torque| tanh(dq / width) of a loaded gear, the torque that of the model without friction.

    The torque is the estimate's own: identification repeats the linear fit until the two agree (Hamon, Gautier and
    Garrec 2010 take it from the measurement instead, whose noise is then in the regressor). Fl is a loss: 0.05 means
    that 5 % of the load is lost.

    Attributes:
        width: Speed in rad/s (or m/s) over which the sign turns.
    """

    width: float = 0.02

    coefficients: ClassVar = (Coefficient("Fl", "1", "1", nonnegative=True),)
    ranges: ClassVar = {"width": Range(1e-3, 0.3, is_speed=True)}
    needs: ClassVar = ("torque",)

    def __post_init__(self) -> None:
        check_positive(self.width, "width", "a speed in rad/s")

    def columns(self, motion: Motion) -> Array:
        sign, _ = smooth_sign(motion.dq, self.width)
        return (np.abs(signal(motion, "torque", "load")) * sign)[..., None]

    def derivatives(self, motion: Motion) -> tuple[Array, Array, Array]:
        _, slope = smooth_sign(motion.dq, self.width)
        found = np.abs(signal(motion, "torque", "load")) * slope
        return no_slopes(motion), found[..., None], no_slopes(motion)
