"""Coulomb friction with one level per direction."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from dynident.arrays import Array
from dynident.model.friction.base import Coefficient, Friction, Inputs, Number, Range, larger, smaller, smooth_sign
from dynident.plugins import bounded


@dataclass(frozen=True)
class Asymmetric(Friction):
    """Asymmetric Coulomb friction Fc+ forwards and Fc- backwards: Fc+ max(s, 0) + Fc- min(s, 0), s = tanh(dq / width).

    Stands in the place of ``coulomb``. With ``offset`` beside it only Fc+ + Fc- is well determined.

    Attributes:
        width: Smoothing width of the Coulomb term (tanh), in rad/s (or m/s).
    """

    width: float = bounded(0.02, least=1e-9, most=1e3)

    coefficients: ClassVar = (
        Coefficient("Fc+", "N m", "N", nonnegative=True),
        Coefficient("Fc-", "N m", "N", nonnegative=True),
    )
    ranges: ClassVar = {"width": Range(1e-3, 0.3, is_speed=True)}

    def terms(self, at: Inputs) -> tuple[Number, ...]:
        sign = smooth_sign(at.dq, self.width)
        return larger(sign, 0.0), smaller(sign, 0.0)

    def in_simulators(self, values: Array) -> tuple[dict[str, float], dict[str, float]]:
        forwards, backwards = values.tolist()
        return {"friction": 0.5 * forwards + 0.5 * backwards}, {"(Fc+ - Fc-)/2": 0.5 * (forwards - backwards)}
