"""A friction part with states, as tests add it: stop operators of Prandtl and Ishlinskii."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from dynident.model.friction.base import Coefficient, Friction, Inputs, Number, State, larger, smaller


@dataclass(frozen=True)
class Presliding(Friction):
    """Torque Fp1 z1 / fine + Fp2 z2 / coarse of two springs z that follow the motion until they slip.

    Attributes:
        fine: Deflection in rad (or m) at which the first one slips.
        coarse: The same of the second one.
    """

    fine: float = 0.01
    coarse: float = 0.1

    coefficients: ClassVar = (
        Coefficient("Fp1", "N m", "N", nonnegative=True),
        Coefficient("Fp2", "N m", "N", nonnegative=True),
    )

    @property
    def states(self) -> tuple[State, ...]:
        return tuple(
            State(symbol, "rad", "m", -width, width) for symbol, width in (("z1", self.fine), ("z2", self.coarse))
        )

    def terms(self, at: Inputs) -> tuple[Number, ...]:
        return at.state[0] / self.fine, at.state[1] / self.coarse

    def update(self, at: Inputs) -> tuple[Number, ...]:
        widths = (self.fine, self.coarse)
        return tuple(smaller(larger(z + at.moved, -w), w) for z, w in zip(at.state, widths, strict=True))
