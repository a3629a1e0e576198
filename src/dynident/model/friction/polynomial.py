"""Viscous friction beyond the straight line: second and third power of the speed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from dynident.arrays import Array
from dynident.model.friction.base import Coefficient, Friction, Motion, no_slopes


@dataclass(frozen=True)
class Polynomial(Friction):
    """Friction Fv2 |dq| dq + Fv3 dq^3 that grows faster than speed; ``viscous`` is the linear term beside it.

    Both are >= 0, so that the friction stays a friction beyond the speeds of the log. Friction that grows more slowly
    than speed is ``degressive``.
    """

    coefficients: ClassVar = (
        Coefficient("Fv2", "N m s^2/rad^2", "N s^2/m^2", nonnegative=True),
        Coefficient("Fv3", "N m s^3/rad^3", "N s^3/m^3", nonnegative=True),
    )

    def columns(self, motion: Motion) -> Array:
        dq = motion.dq
        return np.stack([np.abs(dq) * dq, dq**3], axis=-1)

    def derivatives(self, motion: Motion) -> tuple[Array, Array, Array]:
        dq = motion.dq
        return no_slopes(motion, 2), np.stack([2.0 * np.abs(dq), 3.0 * dq**2], axis=-1), no_slopes(motion, 2)
