"""D-optimal design: the smallest volume of the confidence ellipsoid."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from dynident.arrays import Array
from dynident.errors import BadOption
from dynident.excitation.criteria.base import Criterion, log_volume


@dataclass(frozen=True)
class DOptimal(Criterion):
    """log det(M + d diag M) of the noise-weighted information per sample, the larger the better.

    Minus half of it is the log volume of the confidence ellipsoid; the best motion does not depend on the units of the
    parameters (Swevers et al. 1997, there without d).

    Attributes:
        regularisation: d, which keeps the criterion finite where a direction is not excited at all.
    """

    regularisation: float = 1e-9

    weighted: ClassVar = True
    larger_is_better: ClassVar = True

    def __post_init__(self) -> None:
        if not 0 <= self.regularisation < 1:
            raise BadOption("regularisation", self.regularisation, "give a number from 0 to less than 1")

    def value(self, triangle: Array) -> float:
        norms = np.linalg.norm(triangle, axis=0)
        if not np.all(norms > 0):
            return -np.inf
        values = np.linalg.svd(triangle / norms, compute_uv=False) ** 2 + self.regularisation
        if not np.all(values > 0):
            return -np.inf
        return float(np.sum(np.log(values)) + 2.0 * np.sum(np.log(norms)))

    def objective(self, information: Array, sharpness: float) -> tuple[float, Array]:
        value, gradient = log_volume(information, self.regularisation)
        return -value / len(information), -gradient / len(information)
