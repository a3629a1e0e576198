"""Least squares with the robot model's inertias as a prior."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from dynident.arrays import Array, BoolArray
from dynident.errors import BadOption, SolverFailed
from dynident.identification.estimators._pulled import pulled_uncertainty
from dynident.identification.estimators.wls import WLS
from dynident.identification.problem.estimator import Estimator, Solution
from dynident.identification.problem.method_run import MethodRun
from dynident.identification.problem.problem import Problem
from dynident.identification.residuals.covariance import residual_factors
from dynident.identification.residuals.row_passes import RowPasses
from dynident.model.dynamic_model import DynamicModel


@dataclass(frozen=True, kw_only=True)
class MapRun(MethodRun):
    """Distance from the prior in its std, root mean square; share of its parameters that the data decide."""

    prior_distance: float
    learned: float


@dataclass(frozen=True)
class MAP(Estimator):
    """Maximum a posteriori: normal noise, and a normal prior around the inertias of the robot model.

    The posterior (R'R + P0)^-1 (R'z + P0 beta0) of Bayesian linear regression (Lindley and Smith 1972), each joint's
    rows weighed by its residual deviation and by what rows that hang together are worth. The prior's deviation is a
    share of the natural size of each parameter: the mass m of its link, m L for first moments and m L^2 for inertias
    with the radius of gyration L about the frame's origin. Friction, offset and rotor inertia have no prior, nor have
    base parameters that contain them. The covariance is that of the noise, coloured as it is, and of the prior's error
    about the truth; for noise that is as coloured in all directions it is that of the posterior. It is right if the
    prior is.

    Attributes:
        share: Deviation of the prior in natural sizes; 0.2 says that inertias are known to a fifth of a link's size.
        on: standard: the prior is on each standard parameter, and base parameters inherit its correlations; base: on
            each base parameter, of the same variance, with no correlations.
    """

    share: float = 0.2
    on: Literal["standard", "base"] = "standard"

    def __post_init__(self) -> None:
        if not 0 < self.share < np.inf:
            raise BadOption("share", self.share, "give a share of the natural size above 0, such as 0.2")
        if self.on not in ("standard", "base"):
            raise BadOption("on", self.on, "choose standard or base")

    def solve(self, problem: Problem) -> Solution:
        """Return the estimate.

        Raises:
            SolverFailed: The robot model states no usable inertia for a link.
        """
        start = WLS().solve(problem)
        passes = RowPasses(problem)
        weights = 1.0 / np.sqrt(residual_factors(passes, start.beta)) / problem.joint_deviations(start.beta)
        centre, root, mine = self._prior(problem)
        reduced = problem.reduced(weights)
        rows = np.zeros((len(root), len(centre)))
        rows[:, mine] = root
        stacked = np.vstack([reduced.r, rows])
        target = np.concatenate([reduced.z, root @ centre[mine]])
        scale = np.linalg.norm(stacked, axis=0)
        u, values, directions = np.linalg.svd(stacked / scale, full_matrices=False)
        inverse = (directions.T / values) / scale[:, None]
        beta = inverse @ (u.T @ target)
        covariance = inverse @ inverse.T
        away = root @ (beta - centre)[mine]
        kept = float(np.trace(root @ covariance[np.ix_(mine, mine)] @ root.T))
        found = pulled_uncertainty(passes, start, covariance, weights).with_prior(
            covariance @ rows.T @ rows @ covariance
        )
        run = MapRun(
            prior_distance=float(np.sqrt(np.mean(away**2))) if len(away) else 0.0,
            learned=1.0 - kept / len(away) if len(away) else 1.0,
        )
        return Solution(beta, weights, covariance=found.covariance, degrees=found.degrees, run=run)

    def _prior(self, problem: Problem) -> tuple[Array, Array, BoolArray]:
        """Return the centre beta0, shape (b,), the root of the precision, and on which base parameters it is."""
        model, base = problem.model, problem.base
        size = prior_sizes(model)
        nominal = model.nominal()
        assert nominal is not None  # prior_sizes has refused it
        inertial = base.matrix[:, : model.inertial_count]
        alone = ~np.any(base.matters[:, model.inertial_count :], axis=1)
        mine = alone & (base.independent < model.inertial_count)
        factor = inertial[mine] * (self.share * size)
        variance = np.sum(factor**2, axis=1)
        if self.on == "base":
            return base.from_standard(nominal), np.diag(1.0 / np.sqrt(variance)), mine
        unit = np.sqrt(variance)
        values, vectors = np.linalg.eigh((factor / unit[:, None]) @ (factor / unit[:, None]).T)
        root = (vectors / np.sqrt(np.maximum(values, 1e-12 * values.max(initial=0.0)))).T / unit
        return base.from_standard(nominal), root, mine


def prior_sizes(model: DynamicModel) -> Array:
    """Return the natural size of each inertial standard parameter from the robot model, shape (10 l,).

    Raises:
        SolverFailed: A link without inertia, or none with a mass.
    """
    step = "complete the robot model, or use wls or ridge"
    masses, lengths = [], []
    for link in model.robot.links:
        if link.inertia is None:
            raise SolverFailed("the fit with a prior", f"the robot model states no inertia of {link.name}", step)
        masses.append(max(link.inertia.mass, 0.0))
        second = max(float(np.trace(link.inertia.rotational)) / 2, 0.0)
        lengths.append(np.sqrt(second / link.inertia.mass) if link.inertia.mass > 0 else 0.0)
    heaviest, longest = max(masses, default=0.0), max(lengths, default=0.0)
    if not heaviest * longest > 0:
        raise SolverFailed("the fit with a prior", "no link of the robot model has mass and extent", step)
    mass = np.maximum(masses, 1e-2 * heaviest)
    length = np.maximum(lengths, 1e-1 * longest)
    return np.concatenate(
        [np.r_[np.full(6, m * s**2), np.full(3, m * s), m] for m, s in zip(mass, length, strict=True)]
    )
