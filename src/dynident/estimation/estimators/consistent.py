"""Physically consistent weighted least squares, the default."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dynident.errors import BadOption
from dynident.estimation.consistency import MARGIN, PULL, consistent_fit, natural_scale
from dynident.estimation.estimators.base import Estimator, Solution
from dynident.estimation.estimators.wls import WLS
from dynident.estimation.problem import Problem


@dataclass(frozen=True)
class Consistent(Estimator):
    """Weighted least squares over possible robots only: P_i > 0 for every link, friction and rotor inertia >= 0.

    Weights come from weighted least squares first. What the data leave open settles at the description's inertias
    where they are possible, else at balls of the right size.

    Attributes:
        pull: How tightly the prior holds: its standard deviation is 1 / sqrt(pull) natural sizes of a parameter.
        margin: Smallest eigenvalue of each link's scaled pseudo-inertia: how far inside the possible it stays.
    """

    pull: float = PULL
    margin: float = MARGIN

    def __post_init__(self) -> None:
        if not 0 < self.pull < 1e6:
            raise BadOption("pull", self.pull, "give a number above 0, such as 0.01")
        if not 0 < self.margin < 0.1:
            raise BadOption("margin", self.margin, "give a share between 0 and 0.1, such as 1e-8")

    def solve(self, problem: Problem) -> Solution:
        weights = WLS().solve(problem).weights
        reduced = problem.reduced(weights)
        torque = np.array([np.sqrt(t.torque_square / max(t.rows, 1)) for t in problem.triangles])
        acceleration = np.sqrt(np.mean(np.concatenate([np.asarray(log.log.ddq) for log in problem.logs]) ** 2, axis=0))
        scale = natural_scale(problem.model, torque, acceleration)
        theta = consistent_fit(problem.model, problem.base, reduced, scale, self.pull, self.margin)
        beta = problem.base.from_standard(theta)
        extras = {
            "prior": scale.source,
            "residual_above_unconstrained": float(np.sqrt(reduced.residual_square(beta) / reduced.rest) - 1.0)
            if reduced.rest > 0
            else None,
        }
        return Solution(beta, weights, theta=theta, extras=extras)
