"""The article's criterion: the condition number of the observation matrix."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from dynident.arrays import Array
from dynident.excitation.criteria.base import Criterion, log_ends, singular_values


@dataclass(frozen=True)
class Condition(Criterion):
    """Condition number of the observation matrix in SI units, as the article; the smaller the better.

    It depends on the units of the parameters. The search works on its logarithm, smoothed by p-norms of the eigenvalues
    of W'W (Gautier and Khalil 1992 for the measure).
    """

    stages: ClassVar = (4.0, 16.0, 64.0)

    def value(self, triangle: Array) -> float:
        values = singular_values(triangle)
        return float(values[0] / values[-1]) if values[-1] > 0 else np.inf

    def objective(self, information: Array, sharpness: float) -> tuple[float, Array]:
        return log_ends(information, sharpness, 0.5, -0.5)
