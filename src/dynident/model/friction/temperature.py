"""Friction that changes with the temperature of the drive."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from dynident.errors import BadOption
from dynident.model.friction.base import Coefficient, Friction, Inputs, Number, SelectionUse, smooth_sign
from dynident.plugins import bounded


@dataclass(frozen=True)
class Temperature(Friction):
    """Change of Coulomb and viscous friction per degree: (FcT tanh(dq / width) + FvT dq) (T - reference).

    Stands beside ``coulomb`` and ``viscous``, which then hold at the reference. Cold grease is stiff, so both are
    negative as a rule. The log must have a temperature of each drive.

    Attributes:
        reference: Temperature in degrees Celsius at which the part adds nothing.
        width: Smoothing width of the Coulomb term (tanh), in rad/s (or m/s).
    """

    reference: float = bounded(25.0, least=-1e4, most=1e4)
    width: float = bounded(0.02, least=1e-9, most=1e3)

    coefficients: ClassVar = (
        Coefficient("FcT", "N m/K", "N/K", nonnegative=False),
        Coefficient("FvT", "N m s/(rad K)", "N s/(m K)", nonnegative=False),
    )
    selection: ClassVar = SelectionUse(11, {"choose": ("part",)})

    def __post_init__(self) -> None:
        if not -273.15 < self.reference < np.inf:
            raise BadOption("reference", self.reference, "give a temperature in degrees Celsius")
        super().__post_init__()

    def terms(self, at: Inputs) -> tuple[Number, ...]:
        above = at.temperature - self.reference
        return above * smooth_sign(at.dq, self.width), above * at.dq
