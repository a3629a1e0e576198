"""A-optimal design: the smallest mean variance."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from dynident.arrays import Array
from dynident.excitation.criteria.base import Criterion, log_ends, singular_values


@dataclass(frozen=True)
class AOptimal(Criterion):
    """Trace of the inverse of the noise-weighted information per sample in SI units, the smaller the better.

    The sum of the variances of all base parameters times the number of samples; it depends on their units. The search
    works on its logarithm.
    """

    weighted: ClassVar = True

    def value(self, triangle: Array) -> float:
        values = singular_values(triangle)
        return float(np.sum(values**-2.0)) if values[-1] > 0 else np.inf

    def objective(self, information: Array, sharpness: float) -> tuple[float, Array]:
        return log_ends(information, 1.0, 0.0, -1.0)  # log of the sum of 1 / l is that of the smallest one at p = 1
