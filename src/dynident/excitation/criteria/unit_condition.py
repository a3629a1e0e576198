"""Condition number with unit columns: free of the units of the parameters."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from dynident.arrays import Array
from dynident.excitation.criteria.base import Criterion, column_squares, log_ends, singular_values


@dataclass(frozen=True)
class UnitCondition(Criterion):
    """Condition number of the observation matrix with its columns scaled to unit length; the smaller the better.

    It does not see how large the motion is: among motions of equal shape the slow one is as good as the fast one.
    """

    stages: ClassVar = (4.0, 16.0, 64.0)

    def value(self, triangle: Array) -> float:
        norms = np.linalg.norm(triangle, axis=0)
        if not np.all(norms > 0):
            return np.inf
        values = singular_values(triangle / norms)
        return float(values[0] / values[-1]) if values[-1] > 0 else np.inf

    def objective(self, information: Array, sharpness: float) -> tuple[float, Array]:
        diagonal = column_squares(information)
        inverse = 1.0 / np.sqrt(diagonal)
        scaled = information * np.outer(inverse, inverse)
        objective, slope = log_ends(scaled, sharpness, 0.5, -0.5)
        gradient = slope * np.outer(inverse, inverse)
        # Each diagonal entry of M also scales its row and its column.
        gradient[np.diag_indices_from(gradient)] -= np.sum(slope * scaled, axis=1) / diagonal
        return objective, gradient
