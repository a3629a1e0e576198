"""Robots of one type as draws from a population: its mean and spread by restricted maximum likelihood.

Robot i has base parameters theta_i ~ N(mu, S), S = diag(s_k^2), and its log gives theta_i with information A_i, whose
rank may be less than b, and A_i y_i. mu is marginalised over; the variances s_k^2 maximise the restricted likelihood
(Patterson and Thompson 1971) by EM (Laird and Ware 1982), with the weak penalty log s_k of Chung, Rabe-Hesketh, Dorie,
Gelman and Liu (2013), which keeps the spread of a small fleet from collapsing to 0. Only a diagonal S is fitted: a full
one has b (b + 1) / 2 entries, and a fleet has a few robots.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from dynident.arrays import Array, frozen
from dynident.errors import BadOption
from dynident.model.threads import one_blas_thread

#: Rounds of EM at most, and the change of a variance, as a share of it and of what logs leave open, that ends them.
ROUNDS, SETTLED = 2000, 1e-5

#: Furthest that the logarithm of a variance is extrapolated at once.
_LEAP = 2.0

#: Share of a parameter that may lie in directions that no robot's log determines.
_OPEN = 1e-8


@dataclass(frozen=True)
class Member:
    """What the log of one robot says about its base parameters.

    Attributes:
        name: Of the robot.
        information: A, the inverse of their covariance, singular where the log leaves them open, shape (b, b).
        vector: A y with the robot's own estimate y, shape (b,).
    """

    name: str
    information: Array
    vector: Array

    def __post_init__(self) -> None:
        size = len(self.vector)
        object.__setattr__(self, "information", frozen(self.information, (size, size), "information"))
        object.__setattr__(self, "vector", frozen(self.vector, (size,), "vector"))


@dataclass(frozen=True)
class Population:
    """Mean and spread of a type of robot.

    Attributes:
        members: The robots that it was found from.
        mean: mu, shape (b,).
        mean_covariance: Of mu, shape (b, b).
        variances: s_k^2, shape (b,).
        seen: M_i = A_i (I + S A_i)^-1, the inverse of what y_i scatters by about mu, shape (N, b, b).
        scores: M_i (y_i - mu), shape (N, b).
        settled: Whether the rounds have ended by themselves.
    """

    members: tuple[Member, ...]
    mean: Array
    mean_covariance: Array
    variances: Array
    seen: Array
    scores: Array
    settled: bool

    @property
    def deviations(self) -> Array:
        """Standard deviation of the robots about the mean, shape (b,)."""
        return np.sqrt(self.variances)

    @cached_property
    def variance_covariance(self) -> Array:
        """Covariance of the variances by their expected information 1/2 sum_i M_i,kl^2, shape (b, b)."""
        information = 0.5 * np.sum(np.asarray(self.seen) ** 2, axis=0)
        scale = np.sqrt(np.diag(information))
        return np.linalg.pinv(information / np.outer(scale, scale), hermitian=True) / np.outer(scale, scale)

    def member(self, robot: Member, widened: float = 1.0) -> tuple[Array, Array]:
        """Return the base parameters of a robot and their covariance, shapes (b,) and (b, b).

        E(theta | y) = mu + S M (y - mu). The covariance is that of known variances, with that of mu, plus what the
        doubt of the variances adds to first order (Kass and Steffey 1989).

        Args:
            robot: One of the members, or another one.
            widened: By how much the variances of the population are larger for this robot.
        """
        spread = widened * np.asarray(self.variances)
        seen, product = _seen(np.asarray(robot.information)[None], np.asarray(robot.vector)[None], np.sqrt(spread))
        score = product[0] - seen[0] @ self.mean
        left = np.eye(len(spread)) - spread[:, None] * seen[0]  # of mu, what the log leaves
        found = self.mean + spread * score
        own = left * spread
        slopes = left * score * widened  # of the estimate by the variances
        covariance = own + left @ self.mean_covariance @ left.T + slopes @ self.variance_covariance @ slopes.T
        return found, 0.5 * (covariance + covariance.T)


def population_of(members: Sequence[Member], start: Array | None = None) -> Population:
    """Return mean and spread of a fleet.

    Args:
        members: Two robots or more.
        start: Standard deviations to start from, shape (b,).

    Raises:
        BadOption: Fewer than two robots, or a parameter that no log determines.
    """
    if len(members) < 2:
        raise BadOption("robots", len(members), "a fleet has two or more; one alone is what 'dynident identify' is for")
    information = np.array([one.information for one in members])
    vectors = np.array([one.vector for one in members])
    scale = 1.0 / np.sqrt(_positive(np.einsum("ikk->k", information) / len(members), members))
    scaled = information * np.outer(scale, scale)
    _check_open(scaled)
    with one_blas_thread():
        found = _fitted(members, scaled, vectors * scale, None if start is None else start / scale)
    return Population(
        found.members,
        found.mean * scale,
        found.mean_covariance * np.outer(scale, scale),
        found.variances * scale**2,
        found.seen / np.outer(scale, scale),
        found.scores / scale,
        found.settled,
    )


def population_with(members: Sequence[Member], variances: Array) -> Population:
    """Return the population whose variances (b,) are known."""
    information = np.array([one.information for one in members])
    vectors = np.array([one.vector for one in members])
    return _round(members, information, vectors, variances)[0]


def _fitted(members: Sequence[Member], information: Array, vectors: Array, start: Array | None) -> Population:
    """Return the population of scaled parameters, unit information on average."""
    variances = _first(information, vectors) if start is None else np.maximum(start**2, 1e-12)
    noise = 1.0 / np.maximum(np.einsum("ikk->k", information) / len(members), 1e-300)
    for _ in range(ROUNDS // 3):
        found, first = _round(members, information, vectors, variances)
        if np.all(np.abs(first - variances) < SETTLED * (variances + noise)):
            return found
        _, second = _round(members, information, vectors, first)
        variances = _extrapolated(*np.log(np.maximum([variances, first, second], 1e-12 * noise)))
        variances = np.maximum(_round(members, information, vectors, variances)[1], 1e-12 * noise)
    return replace(_round(members, information, vectors, variances)[0], settled=False)


def _round(members: Sequence[Member], information: Array, vectors: Array, variances: Array) -> tuple[Population, Array]:
    """Return the population with some variances, and those of the next round of EM, shape (b,)."""
    seen, products = _seen(information, vectors, np.sqrt(variances))
    total = seen.sum(axis=0)
    mean_covariance = np.linalg.inv(0.5 * (total + total.T))
    mean = mean_covariance @ products.sum(axis=0)
    scores = products - seen @ mean
    squares = expected_squares(variances, seen, scores, mean_covariance)
    found = Population(tuple(members), mean, mean_covariance, variances, seen, scores, True)
    return found, squares.sum(axis=0) / divisor(len(members))


def expected_squares(variances: Array, seen: Array, scores: Array, mean_covariance: Array) -> Array:
    """Return what robots are expected to lie from the mean, squared, given their logs, shape (N, b)."""
    moved = variances[:, None] * seen
    squares = (variances * scores) ** 2 + variances - variances**2 * np.einsum("ikk->ik", seen)
    return squares + np.einsum("ikl,lm,ikm->ik", moved, mean_covariance, moved)


def _extrapolated(start: Array, first: Array, second: Array) -> Array:
    """Return variances beyond two rounds of EM from the logarithms of all (SQUAREM, Varadhan and Roland 2008, S3)."""
    step, bend = first - start, second - 2.0 * first + start
    length = -max(1.0, float(np.linalg.norm(step)) / max(float(np.linalg.norm(bend)), 1e-300))
    return np.exp(start + np.clip(-2.0 * length * step + length**2 * bend, -_LEAP, _LEAP))


def divisor(count: int) -> int:
    """Return by what the squares of a round are divided: one less for the penalty, which two robots cannot bear."""
    return max(count - 1, 2)


def _seen(information: Array, vectors: Array, spread: Array) -> tuple[Array, Array]:
    """Return M_i (N, b, b) and M_i y_i (N, b) of robots whose parameters have the deviations ``spread`` (b,)."""
    inner = np.eye(len(spread)) + information * np.outer(spread, spread)
    share = np.linalg.inv(inner) * (spread[:, None] / spread)  # D W / D
    seen = information @ share
    return 0.5 * (seen + np.swapaxes(seen, 1, 2)), np.einsum("ikl,ik->il", share, vectors)


def _first(information: Array, vectors: Array) -> Array:
    """Return variances to start from: those of the robots' own estimates, noise included, shape (b,)."""
    own = np.array([np.linalg.lstsq(a, v, rcond=1e-10)[0] for a, v in zip(information, vectors, strict=True)])
    return np.maximum(np.var(own, axis=0, ddof=1), 1e-6)


def _positive(diagonal: Array, members: Sequence[Member]) -> Array:
    if np.all(np.isfinite(diagonal)) and np.all(diagonal > 0):
        return diagonal
    number = int(np.argmin(np.where(np.isfinite(diagonal), diagonal, -1.0)))
    step = "record motions that determine it on one robot at least"
    raise BadOption("robots", f"{len(members)} whose logs do not show base parameter {number + 1}", step)


def _check_open(scaled: Array) -> None:
    total = scaled.sum(axis=0)
    values, vectors = np.linalg.eigh(total)
    weak = values < _OPEN * values[-1]
    if np.any(weak):
        number = int(np.argmax(np.sum(vectors[:, weak] ** 2, axis=1)))
        step = "record a motion that determines all base parameters on one robot at least"
        raise BadOption("robots", f"whose logs together leave base parameter {number + 1} open", step)
