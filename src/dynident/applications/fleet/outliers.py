"""Robots that do not belong: each is compared with the population of the others, at a stated family-wise rate.

The robot furthest out leaves, the population is found anew without it, and so on for a third of the fleet at most; out
are all up to the last one whose distance is significant (generalised extreme Studentised deviates, Rosner 1983), so
that several of them do not hide each other. A robot's distance is judged twice, each at half the rate: over all
parameters (chi-square of the whitened distances), for a little of everything, and at the parameter that is furthest
out, for one fault. Distances are in units of the spread of the others, of the doubt of their mean and of what the
robot's own log leaves open; as the spread is known from few robots, they are compared with Student's t.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.special
import scipy.stats

from dynident.applications.fleet.population import Member, Population, expected_squares, population_of, population_with
from dynident.arrays import Array

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
