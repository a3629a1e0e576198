"""E-optimal design: the worst direction as well known as possible."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from dynident.arrays import Array
from dynident.excitation.criteria.base import Criterion, log_ends, singular_values


@dataclass(frozen=True)
class EOptimal(Criterion):
    """Smallest eigenvalue of the noise-weighted information per sample in SI units, the larger the better.

    One over it is the greatest variance of any direction of parameters; it depends on their units.
    """

    weighted: ClassVar = True
    larger_is_better: ClassVar = True
    stages: ClassVar = (2.0, 8.0, 32.0, 128.0)

    def value(self, triangle: Array) -> float:
        return float(singular_values(triangle)[-1] ** 2)

    def objective(self, information: Array, sharpness: float) -> tuple[float, Array]:
        return log_ends(information, sharpness, 0.0, -1.0)
