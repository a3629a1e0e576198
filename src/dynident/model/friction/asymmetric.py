"""Coulomb friction with one level per direction."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from dynident.arrays import Array
from dynident.model.friction.base import Coefficient, Friction, Motion, Range, check_positive, no_slopes, smooth_sign


@dataclass(frozen=True)
class Asymmetric(Friction):
    """Dry friction Fc+ forwards and Fc- backwards: Fc+ max(s, 0) + Fc- min(s, 0), s = tanh(dq / width).

    Stands in the place of ``coulomb``. With ``offset`` beside it only Fc+ + Fc- is well determined.

    Attributes:
        width: Speed in rad/s (or m/s) over which the sign turns.
    """

    width: float = 0.02

    coefficients: ClassVar = (
        Coefficient("Fc+", "N m", "N", nonnegative=True),
        Coefficient("Fc-", "N m", "N", nonnegative=True),
    )
    ranges: ClassVar = {"width": Range(1e-3, 0.3, is_speed=True)}

    def __post_init__(self) -> None:
        check_positive(self.width, "width", "a speed in rad/s")

    def columns(self, motion: Motion) -> Array:
        sign, _ = smooth_sign(motion.dq, self.width)
        return np.stack([np.maximum(sign, 0.0), np.minimum(sign, 0.0)], axis=-1)

    def derivatives(self, motion: Motion) -> tuple[Array, Array, Array]:
        sign, slope = smooth_sign(motion.dq, self.width)
        parts = np.stack([np.where(sign > 0, slope, 0.0), np.where(sign < 0, slope, 0.0)], axis=-1)
        return no_slopes(motion, 2), parts, no_slopes(motion, 2)
