"""Friction that changes as a drive warms up, where nothing is known of the way that led to a sample: it is cold."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from dynident.model.friction.base import Coefficient, Friction, Inputs, Number


@dataclass(frozen=True)
class Cold(Friction):
    """Nothing, under the coefficients of ``warm_up``: Coulomb and viscous friction stand as at the start of a log."""

    coefficients: ClassVar = (
        Coefficient("FcW", "N m s/rad", "N s/m", nonnegative=False),
        Coefficient("FvW", "N m s^2/rad^2", "N s^2/m^2", nonnegative=False),
    )

    def terms(self, at: Inputs) -> tuple[Number, ...]:
        return 0.0, 0.0
