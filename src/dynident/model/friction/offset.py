"""A constant torque: sensor or amplifier offset, and the asymmetry of Coulomb friction."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from dynident.arrays import Array
from dynident.model.friction.base import Coefficient, Friction, Motion, no_slopes


@dataclass(frozen=True)
class Offset(Friction):
    """A constant torque F0 per drive."""

    coefficients: ClassVar = (Coefficient("F0", "N m", "N", nonnegative=False),)

    def columns(self, motion: Motion) -> Array:
        return np.ones((*motion.dq.shape, 1))

    def derivatives(self, motion: Motion) -> tuple[Array, Array, Array]:
        return no_slopes(motion), no_slopes(motion), no_slopes(motion)
