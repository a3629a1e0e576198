"""A fleet: each robot's estimate drawn to the mean of its type as far as the fleet's spread and its own log allow."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from dynident.applications.fleet.outliers import Distance, Screening, screened
from dynident.applications.fleet.robots import FleetRobot, check_alike
from dynident.arrays import Array
from dynident.errors import BadOption
from dynident.excitation.design.prior import prior_of_covariance
from dynident.identification.consistency.consistent_fit import consistent_fit, run_of
from dynident.identification.consistency.verdicts import judge
from dynident.identification.estimate.estimate import Estimate
from dynident.identification.problem.method_run import recorded_run
from dynident.model.base_parameters import BaseParameters
from dynident.model.reduction import Reduced

#: Factor of the variances with which a robot is next to its own estimate.
_FREE = 1e6


@dataclass(frozen=True)
class FleetPlace:
    """Where a robot stands in its fleet.

    Attributes:
        robots: Names of all robots.
        out: Whether its parameters are unlike those of the others.
        rate: Share of sound robots that are called unlike.
        widened: By how much the variances are larger for it.
        p: p-value of its distance from the others.
    """

    robots: Sequence[str]
    out: bool
    rate: float
    widened: float
    p: float


@dataclass(frozen=True)
class Fleet:
    """Robots of one type, and what they have in common.

    Attributes:
        robots: As given.
        screening: Mean and spread of those that belong, and how far each lies from the others.
        estimates: Of each robot, physically consistent, in their order.
        shares: How much of each base parameter of each robot comes from its own log, 0 to 1, shape (N, b).
    """

    robots: tuple[FleetRobot, ...]
    screening: Screening
    estimates: tuple[Estimate, ...]
    shares: Array

    @property
    def base(self) -> BaseParameters:
        """Base parameters of the type."""
        return self.robots[0].base

    def joint_of(self, parameter: int) -> str:
        """Return the joint or the link that a base parameter is named after."""
        return self.base.parameters[int(self.base.independent[parameter])].owner

    def evidence(self, distance: Distance) -> dict[str, Any]:
        """Return where a robot is furthest out, as plain data."""
        population, k = self.screening.population, distance.parameter
        place = [robot.name for robot in self.robots].index(distance.name)
        return {
            "parameter": self.base.names[k],
            "owner": self.joint_of(k),
            "unit": self.base.units[k],
            "value": float(self.estimates[place].beta[k]),
            "std": float(self.estimates[place].std[k]),
            "mean": float(population.mean[k]),
            "spread": float(population.deviations[k]),
            "score": float(distance.scores[k]),
        }

    def figures(self) -> dict[str, Any]:
        """Return the fleet as plain data."""
        found, population = self.screening, self.screening.population
        return {
            "robot": self.robots[0].model.robot.name,
            "robots": [
                {
                    "name": robot.name,
                    "from": "estimate" if robot.own is not None else "QR factors",
                    "outlier": robot.name in found.out,
                    "p": distance.p,
                    "adjusted_p": found.adjusted.get(robot.name),
                    "chi_square": distance.chi_square,
                    "rank": distance.rank,
                    "furthest": self.evidence(distance),
                    "own_share": float(np.median(share)),
                    "physically_consistent": estimate.consistency.consistent,
                    "beta": estimate.beta.tolist(),
                    "std": estimate.std.tolist(),
                }
                for robot, distance, estimate, share in zip(
                    self.robots, found.distances, self.estimates, self.shares, strict=True
                )
            ],
            "parameters": [
                {"name": name, "unit": unit, "mean": float(mean), "std": float(std), "spread": float(spread)}
                for name, unit, mean, std, spread in zip(
                    self.base.names,
                    self.base.units,
                    population.mean,
                    np.sqrt(np.diag(population.mean_covariance)),
                    population.deviations,
                    strict=True,
                )
            ],
            "family_wise_rate": found.rate,
            "outliers_tested": found.tested,
            "outliers": list(found.out),
            "converged": population.settled,
        }


def fleet_of(
    robots: Sequence[FleetRobot],
    rate: float = 0.05,
    provenance: Mapping[str, Any] | None = None,
    progress: Callable[[str], None] = lambda step: None,
) -> Fleet:
    """Return the estimates of a fleet.

    A robot that is out does not count for mean and spread; its own estimate is drawn to them with a spread as much
    larger as it lies further out than robots of the type do.

    Args:
        robots: Two or more of one type.
        rate: Family-wise rate of the test for robots that do not belong.
        provenance: Facts to keep with each estimate, such as the command.
        progress: Called with each step in words.

    Raises:
        BadOption: Robots of different types, a robot twice, too few, a rate that is none, or an open parameter.
        SolverFailed: No possible robot was found.
    """
    if not 0 < rate < 1:
        raise BadOption("rate", rate, "give a probability between 0 and 1, such as 0.05")
    check_alike(robots)
    progress("mean and spread")
    found = screened([robot.member for robot in robots], rate)
    estimates, shares = [], []
    for robot, distance in zip(robots, found.distances, strict=True):
        progress(f"physically consistent fit: {robot.name}")
        out = robot.name in found.out
        widened = _widened(robot, found, distance) if out else 1.0
        place = FleetPlace([one.name for one in robots], out, rate, widened, distance.p)
        estimate, share = _estimate(robot, found, place)
        told = {"fleet": [one.name for one in robots], **(provenance or {})}
        estimates.append(replace(estimate, provenance={**estimate.provenance, **told}))
        shares.append(share)
    return Fleet(tuple(robots), found, tuple(estimates), np.array(shares))


def _widened(robot: FleetRobot, found: Screening, distance: Distance) -> float:
    """Return by how much the variances must be larger for a robot's furthest parameter to lie one deviation out."""
    k, population = distance.parameter, found.population
    free, _ = population.member(robot.member, _FREE)
    return max(1.0, float((free[k] - population.mean[k]) ** 2 / population.variances[k]))


def _estimate(robot: FleetRobot, found: Screening, place: FleetPlace) -> tuple[Estimate, Array]:
    """Return the estimate of one robot, and how much of each parameter comes from its own log, shape (b,)."""
    model, base, scale = robot.model, robot.base, robot.scale
    beta, covariance = found.population.member(robot.member, place.widened)
    known = prior_of_covariance(covariance, beta, robot.name)
    deviations = np.sqrt(np.diag(covariance))
    root = np.linalg.cholesky(known.information * np.outer(deviations, deviations)).T / deviations
    rows = robot.rows
    reduced = Reduced(root, root @ beta, float(rows), rows)  # rows of unit noise
    fit = consistent_fit(model, base, reduced, scale)
    possible = base.from_standard(fit.theta)
    estimate = robot.estimate(possible, covariance, fit.theta)
    spread = place.widened * found.population.variances
    stated = {**estimate.run.data(), **run_of(fit, scale, reduced, possible).data(), "fleet": asdict(place)}
    return replace(
        estimate,
        estimator="fleet",
        options={"rate": found.rate},
        consistency=judge(model, base, possible, fit.theta),
        run=recorded_run(stated),
    ), np.clip(1.0 - np.diag(covariance) / (spread + np.diag(found.population.mean_covariance)), 0.0, 1.0)
