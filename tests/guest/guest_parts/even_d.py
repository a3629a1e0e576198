"""D-optimal design per parameter."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from dynident.arrays import Array
from dynident.excitation.criteria.base import Criterion, log_volume


@dataclass(frozen=True)
class EvenD(Criterion):
    """log det(M) / b of the noise-weighted information per sample, b its size; the larger the better."""

    weighted: ClassVar = True
    larger_is_better: ClassVar = True

    def value(self, triangle: Array) -> float:
        diagonal = np.abs(np.linalg.svd(triangle, compute_uv=False))
        small = diagonal[-1] <= len(diagonal) * np.finfo(float).eps * diagonal[0]
        return -np.inf if small else float(2.0 * np.mean(np.log(diagonal)))

    def objective(self, information: Array, sharpness: float) -> tuple[float, Array]:
        value, gradient = log_volume(information, 1e-9)
        return -value / len(information), -gradient / len(information)
