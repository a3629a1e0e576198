"""Viscous friction."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from dynident.arrays import Array
from dynident.model.friction.base import Coefficient, Friction, Motion, no_slopes


@dataclass(frozen=True)
class Viscous(Friction):
    """Friction Fv dq that grows with speed, equation (3)."""

    coefficients: ClassVar = (Coefficient("Fv", "N m s/rad", "N s/m", nonnegative=True),)

    def columns(self, motion: Motion) -> Array:
        return motion.dq[..., None]

    def derivatives(self, motion: Motion) -> tuple[Array, Array, Array]:
        return no_slopes(motion), np.ones((*motion.dq.shape, 1)), no_slopes(motion)
