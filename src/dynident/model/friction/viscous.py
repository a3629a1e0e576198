"""Viscous friction."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from dynident.model.friction.base import Coefficient, Friction, Inputs, Number, SelectionCandidate, SharedUse


@dataclass(frozen=True)
class Viscous(Friction):
    """Viscous friction Fv dq, equation (3)."""

    coefficients: ClassVar = (Coefficient("Fv", "N m s/rad", "N s/m", nonnegative=True, in_simulators="damping"),)
    candidates: ClassVar = (SelectionCandidate(10),)
    shared: ClassVar = SharedUse(1, "default")

    def terms(self, at: Inputs) -> tuple[Number, ...]:
        return (at.dq,)
