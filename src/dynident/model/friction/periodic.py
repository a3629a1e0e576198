"""Torque ripple over the turn of a shaft: eccentric gears, cogging, the meshing of teeth."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

from dynident.model.friction.base import Coefficient, Friction, Inputs, Number, check_positive, cosine, sine


@dataclass(frozen=True)
class Periodic(Friction):
    """Periodic torque ripple over position: Ps1 sin kq + Pc1 cos kq + Ps2 sin 2kq + Pc2 cos 2kq, k = cycles.

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

    @property
    def cycle(self) -> float | None:
        return 2.0 * math.pi / self.cycles

    def terms(self, at: Inputs) -> tuple[Number, ...]:
        angle = self.cycles * at.q
        once, beside = sine(angle), cosine(angle)
        return once, beside, 2.0 * once * beside, 1.0 - 2.0 * once * once
