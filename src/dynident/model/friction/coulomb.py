"""Coulomb friction with a smooth sign."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from dynident.errors import BadOption
from dynident.model.friction.base import Coefficient, Friction, Inputs, Number, Range, SelectionUse, smooth_sign
from dynident.plugins import bounded


@dataclass(frozen=True)
class Coulomb(Friction):
    """Coulomb friction Fc sign(dq), equation (3), the sign smoothed to tanh(dq / width).

    Attributes:
        width: Smoothing width of the Coulomb term (tanh), in rad/s (or m/s); 0 is the sharp sign of the article.
    """

    width: float = bounded(0.02, least=1e-9, most=1e3)

    coefficients: ClassVar = (Coefficient("Fc", "N m", "N", nonnegative=True, in_simulators="friction"),)
    ranges: ClassVar = {"width": Range(1e-3, 0.3, is_speed=True)}
    selection: ClassVar = SelectionUse(0, {"width": 0.01, "choose": ("width",)}, is_default=True)

    def __post_init__(self) -> None:
        if not 0 <= self.width < np.inf:
            raise BadOption("width", self.width, "give a speed >= 0 in rad/s")

    def terms(self, at: Inputs) -> tuple[Number, ...]:
        return (smooth_sign(at.dq, self.width),)
