"""Torque ripple over the turn of a shaft: eccentric gears, cogging, the meshing of teeth."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from dynident.arrays import Array
from dynident.model.friction.base import Coefficient, Friction, Motion, check_positive, no_slopes


@dataclass(frozen=True)
class Periodic(Friction):
    """Torque that repeats with position: Ps1 sin kq + Pc1 cos kq + Ps2 sin 2kq + Pc2 cos 2kq, k = cycles.

    Once and twice per turn of the joint with cycles = 1, where it may look like gravity; of a motor shaft with cycles =
    gear ratio. It can only be told where the log spans a good part of a cycle and samples it more than four times.

    Attributes:
        cycles: Cycles per turn of the joint (per 2 pi m of a sliding one).
    """

    cycles: float = 1.0

    coefficients: ClassVar = tuple(
        Coefficient(symbol, "N m", "N", nonnegative=False) for symbol in ("Ps1", "Pc1", "Ps2", "Pc2")
    )

    def __post_init__(self) -> None:
        check_positive(self.cycles, "cycles", "cycles per turn,")

    def columns(self, motion: Motion) -> Array:
        angle = self.cycles * motion.q
        return np.stack([np.sin(angle), np.cos(angle), np.sin(2 * angle), np.cos(2 * angle)], axis=-1)

    def derivatives(self, motion: Motion) -> tuple[Array, Array, Array]:
        angle = self.cycles * motion.q
        found = np.stack([np.cos(angle), -np.sin(angle), 2 * np.cos(2 * angle), -2 * np.sin(2 * angle)], axis=-1)
        return self.cycles * found, no_slopes(motion, 4), no_slopes(motion, 4)
