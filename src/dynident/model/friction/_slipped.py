"""An element of presliding friction where nothing is known of the way that led to a sample: it has slipped."""

from __future__ import annotations

from dataclasses import dataclass

from dynident.model.friction.base import Coefficient, Friction, Inputs, Number, smooth_sign

#: Width of its sign, in rad/s or m/s.
WIDTH = 0.01


@dataclass(frozen=True)
class Slipped(Friction):
    """Coulomb friction Fp tanh(dq / 0.01) under the coefficient of an element of ``presliding``."""

    element: int = 1

    @property
    def coefficients(self) -> tuple[Coefficient, ...]:  # type: ignore[override]
        """Its level, named by the element."""
        symbol = "Fp" if self.element == 1 else f"Fp{self.element}"
        return (Coefficient(symbol, "N m", "N", nonnegative=True, in_simulators="friction"),)

    def terms(self, at: Inputs) -> tuple[Number, ...]:
        return (smooth_sign(at.dq, WIDTH),)
