"""Coulomb friction with a smooth sign."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from dynident.arrays import Array
from dynident.errors import BadOption
from dynident.model.friction.base import Coefficient, Friction, Motion, Range, no_slopes, smooth_sign


@dataclass(frozen=True)
class Coulomb(Friction):
    """Dry friction Fc sign(dq), equation (3), the sign smoothed to tanh(dq / width).

    Attributes:
        width: Speed in rad/s (or m/s) over which the sign turns; 0 is the sharp sign of the article.
    """

    width: float = 0.02

    coefficients: ClassVar = (Coefficient("Fc", "N m", "N", nonnegative=True),)
    ranges: ClassVar = {"width": Range(1e-3, 0.3, is_speed=True)}

    def __post_init__(self) -> None:
        if not 0 <= self.width < np.inf:
            raise BadOption("width", self.width, "give a speed >= 0 in rad/s")

    def columns(self, motion: Motion) -> Array:
        return smooth_sign(motion.dq, self.width)[0][..., None]

    def derivatives(self, motion: Motion) -> tuple[Array, Array, Array]:
        slope = smooth_sign(motion.dq, self.width)[1]
        return no_slopes(motion), slope[..., None], no_slopes(motion)
