"""Bayesian D-optimal design: the smallest volume of the confidence ellipsoid after the run, given what is known."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from dynident.arrays import Array
from dynident.errors import BadOption
from dynident.excitation.criteria.base import Criterion, log_volume


@dataclass(frozen=True)
class BayesianD(Criterion):
    """log det(N M + S0^-1) - b log N, the information after the run per row, the larger the better.

    S0 is the covariance of the base parameters before it: of the nominal model, of an estimate, of earlier logs. The
    motion goes where little is known yet; what is known well may stay unexcited (Chaloner and Verdinelli 1995,
    equation 5). Without any prior it is d_optimal without regularisation.

    Attributes:
        deviation: Relative standard deviation of the nominal inertias and of stated friction that counts as known
            before; none leaves the nominal model out.
    """

    deviation: float | None = 0.5

    weighted: ClassVar = True
    larger_is_better: ClassVar = True

    def __post_init__(self) -> None:
        if self.deviation is not None and not 0 < self.deviation < np.inf:
            raise BadOption("deviation", self.deviation, "give a share above 0, such as 0.5, or none")

    @property
    def nominal_deviation(self) -> float | None:
        return self.deviation

    def value(self, triangle: Array) -> float:
        norms = np.linalg.norm(triangle, axis=0)
        if not np.all(norms > 0):
            return -np.inf
        values = np.linalg.svd(triangle / norms, compute_uv=False)
        return 2.0 * float(np.sum(np.log(values)) + np.sum(np.log(norms))) if np.all(values > 0) else -np.inf

    def objective(self, information: Array, sharpness: float) -> tuple[float, Array]:
        value, gradient = log_volume(information)
        return -value / len(information), -gradient / len(information)
