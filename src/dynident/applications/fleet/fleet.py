"""A fleet: each robot's estimate drawn to the mean of its type as far as the fleet's spread and its own log allow.

Robots that do not belong are found by comparing each with the population of the others, at a stated family-wise rate.
The robot furthest out leaves, the population is found anew without it, and so on for a third of the fleet at most; out
are all up to the last one whose distance is significant (generalised extreme Studentised deviates, Rosner 1983), so
that several of them do not hide each other. A robot's distance is judged twice, each at half the rate: over all
parameters (chi-square of the whitened distances), for a little of everything, and at the parameter that is furthest
out, for one fault. Distances are in units of the spread of the others, of the doubt of their mean and of what the
robot's own log leaves open; as the spread is known from few robots, they are compared with Student's t.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
import scipy.special
import scipy.stats

from dynident.applications.fleet.population import Member, Population, expected_squares, population_of, population_with
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


#: Fewest robots of which one can be told to be out.
FEWEST = 4

#: Share of the fleet that may be out.
SHARE = 3

#: By how much the variance of a small fleet may have been found too small, for the degrees of freedom.
DOUBT = 3.0

#: Eigenvalue of a correlation below which a direction does not count: the log leaves it open.
_FLAT = 1e-9


@dataclass(frozen=True)
class Distance:
    """How far a robot lies from the population of others.

    Attributes:
        name: Of the robot.
        scores: Standard score of each parameter, shape (b,): normal where the robot belongs; 0 where its log is silent.
        chi_square: Sum of the squared whitened scores.
        rank: How many they are.
        p: Probability of such a distance, or a larger one, for this robot alone.
    """

    name: str
    scores: Array
    chi_square: float
    rank: int
    p: float

    @property
    def parameter(self) -> int:
        """Number of the parameter that is furthest out."""
        return int(np.argmax(np.abs(self.scores)))


@dataclass(frozen=True)
class Screening:
    """The fleet without the robots that are out.

    Attributes:
        population: Of the robots that belong.
        distances: Of every robot from the population of the others that belong, in the order of the members.
        out: Names of the robots that are out, the furthest first.
        adjusted: Probability of each of these findings in a fleet where all belong, by name: that of its own step, or
            of a later one, times the number of robots that were compared.
        rate: Family-wise rate.
        tested: Whether the fleet is large enough to tell.
    """

    population: Population
    distances: tuple[Distance, ...]
    out: tuple[str, ...]
    adjusted: dict[str, float]
    rate: float
    tested: bool


def screened(members: Sequence[Member], rate: float) -> Screening:
    """Return the population of the robots that belong, and those that do not.

    Args:
        members: Two robots or more.
        rate: Probability that any robot is called out where all belong.

    Raises:
        BadOption: Fewer than two robots, or a parameter that no log determines.
    """
    whole = population_of(members)
    left, populations, removed = list(members), [whole], list[tuple[str, float]]()
    tested = len(members) >= FEWEST
    for _ in range(len(members) // SHARE if tested else 0):
        current = populations[-1]
        furthest = min(range(len(left)), key=lambda k: distance(left[k], _without(current, k)).p)
        robot = left[furthest]
        rest = left[:furthest] + left[furthest + 1 :]
        following = population_of(rest, current.deviations)
        found = distance(robot, following)
        removed.append((robot.name, min(1.0, found.p * len(left))))
        left = rest
        populations.append(following)
    count = max((k + 1 for k, (_, p) in enumerate(removed) if p < rate), default=0)
    population = populations[count]
    out = tuple(name for name, _ in removed[:count])
    place = {one.name: k for k, one in enumerate(population.members)}
    distances = tuple(
        distance(one, population if one.name in out or len(members) < 3 else _without(population, place[one.name]))
        for one in members
    )
    adjusted = {name: min(p for _, p in removed[k:count]) for k, (name, _) in enumerate(removed[:count])}
    return Screening(population, distances, out, adjusted, rate, tested)


def distance(robot: Member, others: Population) -> Distance:
    """Return how far a robot lies from a population that it is no member of."""
    size, count = len(robot.vector), len(others.members)
    prior = np.diag(others.variances) + others.mean_covariance
    root = np.linalg.cholesky(prior)
    information = np.asarray(robot.information)
    inner = np.eye(size) + root.T @ information @ root
    gap = robot.vector - information @ others.mean
    # E(theta - mu | y) and its covariance over robots, in root units
    moved = np.linalg.solve(inner, root.T @ gap)
    scatter = np.eye(size) - np.linalg.inv(inner)
    shift, covariance = root @ moved, root @ (0.5 * (scatter + scatter.T)) @ root.T
    variance = np.maximum(np.diag(covariance), 0.0)
    known = variance > _FLAT * np.diag(prior)
    deviations = np.sqrt(np.where(known, variance, 1.0))
    scores = np.where(known, shift / deviations, 0.0)
    freedom = _freedom(covariance, prior, count)
    scores = _as_normal(scores, freedom)
    correlation = covariance / np.outer(deviations, deviations)
    values, vectors = np.linalg.eigh(correlation[np.ix_(known, known)])
    kept = values > _FLAT * max(values[-1], 1.0) if len(values) else np.zeros(0, bool)
    turned = vectors[:, kept]
    white = (turned / np.sqrt(values[kept])) @ turned.T @ (shift / deviations)[known]
    white = _as_normal(white, freedom[known])
    total, rank = float(white @ white), int(kept.sum())
    every = float(scipy.stats.chi2.sf(total, max(rank, 1)))
    single = 2.0 * float(scipy.stats.norm.sf(np.abs(scores).max(initial=0.0))) * max(int(known.sum()), 1)
    return Distance(robot.name, scores, total, rank, min(1.0, 2.0 * min(every, single)))


def _freedom(covariance: Array, prior: Array, count: int) -> Array:
    """Return the degrees of freedom of each variance: those of a spread from ``count`` robots, more by the log's noise.

    The shift of a robot by its log alone has the variance prior^2 / (prior + noise): its share of the prior is what the
    spread has of all that it was divided by (Satterthwaite 1946). A spread found too small, as happens with few robots,
    would also lower that share, so it is taken ``DOUBT`` times as large here.
    """
    share = np.clip(np.diag(covariance) / np.diag(prior), 1e-6, 1.0)
    share = DOUBT * share / (1.0 + (DOUBT - 1.0) * share)
    return max(count - 1, 1) / share**2


def _as_normal(scores: Array, freedom: Array) -> Array:
    """Return what a normal variable would be at the probabilities of Student's t."""
    tail = scipy.stats.t.logsf(np.abs(scores), freedom)
    return np.sign(scores) * -scipy.special.ndtri_exp(np.minimum(tail, np.log(0.5)))


def _without(population: Population, k: int) -> Population:
    """Return the population of all members but one, from what all of them tell of its spread; nothing is fitted anew.

    The squares of the others about their own mean are those of one round but for the doubt of the mean, which would
    still be that of a spread with the robot; one less than their number makes up for it.
    """
    keep = np.arange(len(population.members)) != k
    rest = tuple(one for one, kept in zip(population.members, keep, strict=True) if kept)
    variances, seen = np.asarray(population.variances), np.asarray(population.seen)[keep]
    scores = (population.scores + np.asarray(population.seen) @ population.mean)[keep]
    scores = scores - seen @ np.linalg.solve(seen.sum(axis=0), scores.sum(axis=0))
    squares = expected_squares(variances, seen, scores, np.zeros_like(seen[0]))
    found = np.maximum(squares.sum(axis=0) / max(len(rest) - 2, 1), 1e-12 * variances)
    return population_with(rest, found)
