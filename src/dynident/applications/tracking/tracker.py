"""A tracker: base parameters that follow a robot as it warms up, wears or takes up loads, with their intervals.

Rows of the last moments stand in a window, older ones in a memory that fades, and what the estimate knew in a triangle
that does not. So the parameters go with what the robot shows and, where it shows nothing, back to the estimate.

A memory lags behind a steady drift by the drift times the mean age of its rows. A second memory, three times as long,
lags more; from how far the two are apart follows the lag of the first, which counts as a deviation beside the noise.

What may have changed is tested against what the last rows say.
The rows of the last moments, reduced to [R, z] with unit noise, are compared with what was known before them, beta with
covariance P: the innovation z - R beta has covariance I + R P R', and a change D x adds R D x to it. The part of the
whitened innovation that D explains has a chi-square square where nothing has changed (Willsky and Jones 1976); the
change whose square is furthest above its own threshold is the one that is named.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg
import scipy.stats

from dynident.arrays import Array, IntArray
from dynident.diagnosis.earlier import noise_of
from dynident.errors import BadOption
from dynident.excitation.design.prior import prior_of_covariance
from dynident.identification.estimate.estimate import Estimate
from dynident.identification.problem.prior import parameter_sizes
from dynident.identification.recursive import RecursiveLeastSquares
from dynident.model.base_parameters import BaseParameters
from dynident.model.dynamic_model import DynamicModel
from dynident.model.reduction import Reduced, least_squares, triangle_of

#: Time constant of the slow memory over that of the memory.
SLOWER = 3.0

#: Largest factor by which the two may be extrapolated, while both are young.
FURTHEST = 5.0


@dataclass(frozen=True)
class Pace:
    """How a tracker forgets.

    Attributes:
        memory: Time constant in s after which a row counts 1 / e.
        window: Length in s of the last moments, in which changes are looked for.
        loosen: By how much the deviations of what is known beforehand are larger than those of the estimate.
    """

    memory: float = 10.0
    window: float = 1.0
    loosen: float = 30.0

    def __post_init__(self) -> None:
        for name, least in (("memory", 0.0), ("window", 0.0), ("loosen", 1.0)):
            value = getattr(self, name)
            if not least < value < np.inf:
                unit = "seconds" if least == 0 else "a factor"
                raise BadOption(name, value, f"give {unit} above {least:g}")
        if self.window >= self.memory:
            raise BadOption("window", self.window, f"give less than the memory of {self.memory:g} s")


class Tracker:
    """Base parameters that follow the rows of a robot.

    Attributes:
        estimate: What is known beforehand.
        rate: Samples a second.
        pace: How it forgets.
        changes: What may change at once.
    """

    def __init__(self, estimate: Estimate, rate: float, pace: Pace, changes: Sequence[Change]) -> None:
        self.estimate, self.rate, self.pace, self.changes = estimate, rate, pace, tuple(changes)
        stated = estimate.train.filter.get("rate_hz")
        denser = rate / float(stated) if isinstance(stated, int | float) and stated > 0 else 1.0
        self._weights = 1.0 / (noise_of(estimate) * np.sqrt(max(denser, 1.0)))
        size = estimate.base.count
        samples = max(2, round(pace.window * rate))
        self._recent = RecursiveLeastSquares(size, window=samples)
        self._past = RecursiveLeastSquares(size, float(np.exp(-1.0 / (pace.memory * rate))))
        self._slow = RecursiveLeastSquares(size, float(np.exp(-1.0 / (SLOWER * pace.memory * rate))))
        self.know(estimate.beta, pace.loosen**2 * estimate.covariance)

    def know(self, beta: Array, covariance: Array) -> None:
        """Set what is known beforehand and forget all rows; shapes (b,) and (b, b).

        Raises:
            BadOption: The covariance is singular.
        """
        self._known = covariance
        information = prior_of_covariance(covariance, beta, self.estimate.model.robot.name).information
        scale = 1.0 / np.sqrt(np.diag(information))
        root = np.linalg.cholesky(information * np.outer(scale, scale)).T / scale
        prior = Reduced(root, root @ beta, 0.0, 0)
        for memory in (self._past, self._slow):
            memory.prior = prior
            memory.clear()
        self._weight, self._age = np.zeros(2), np.zeros(2)  # of the rows of both memories
        self._recent.clear()
        self._held = False

    def hold(self) -> None:
        """Let the memory take no more rows until :meth:`restart`: those from now on may be of a changed robot."""
        self._held = True

    @property
    def full(self) -> bool:
        """Whether the window is full."""
        return self._recent.held == self._recent.window

    def update(self, matrix: Array, torque: Array) -> None:
        """Take the rows of one sample, not weighted: W (n, b) and measured less known torque (n,).

        Raises:
            ValueError: A shape is wrong, or a value is no number.
        """
        if self.full and not self._held:
            oldest = self._recent.oldest
            for memory in (self._past, self._slow):
                memory.update(oldest[:, :-1], oldest[:, -1])
            left = np.array([self._past.forgetting, self._slow.forgetting])
            self._age = left * (self._age + self._weight)
            self._weight = left * self._weight + 1.0
        self._recent.update(matrix * self._weights[:, None], torque * self._weights)

    def now(self) -> tuple[Array, Array]:
        """Return the base parameters and their covariance, with that by the lag, shapes (b,) and (b, b)."""
        found = least_squares(self._merged(self._past.reduced, self._recent.rows_alone))
        return found.beta, found.unscaled_covariance + self._lag(self._past.estimate())

    def evidence(self) -> tuple[ChangeEvidence, ...]:
        """Return what the window says about each change against all before it."""
        before = least_squares(self._past.reduced)
        covariance = before.unscaled_covariance + self._lag(before.beta)
        return evidence_of(self.changes, self._recent.rows_alone, before.beta, covariance)

    def _lag(self, beta: Array) -> Array:
        """Return what the lag of the memory, whose estimate is ``beta`` (b,), adds to its covariance, shape (b, b)."""
        young, old = self._age / np.maximum(self._weight, 1.0)
        lag = (beta - self._slow.estimate()) * min(young / max(old - young, 1e-9), FURTHEST)
        return np.outer(lag, lag)

    def restart(self, change: Change) -> None:
        """Forget what was before the window, and what was known beforehand about a change; the window's rows stay."""
        beta = least_squares(self._past.reduced).beta
        rows = self._recent.rows_alone
        self.know(beta, self._known + change.columns @ change.columns.T)
        for memory in (self._past, self._slow):
            memory.update(rows.r, rows.z)

    def _merged(self, first: Reduced, second: Reduced) -> Reduced:
        size = self.estimate.base.count
        stacked = [np.column_stack([one.r, one.z]) for one in (first, second)]
        factor = triangle_of(np.concatenate(stacked))
        return Reduced(factor[:size, :size], factor[:size, size], 0.0, second.rows)


#: Singular value, of unknowns in natural sizes, below this share of the largest: the rows do not show it.
_OPEN = 1e-6

#: Share of an unknown in what the rows do not show from which on no value is stated.
_HIDDEN = 1e-4


@dataclass(frozen=True)
class Change:
    """Something that may change.

    Attributes:
        kind: ``load`` or ``friction``.
        owner: The link that carries the load, or the joint.
        columns: D, what a natural size of each unknown adds to the base parameters, shape (b, k).
        sizes: Natural sizes of the unknowns, shape (k,).
    """

    kind: str
    owner: str
    columns: Array
    sizes: Array

    @property
    def name(self) -> str:
        """In words."""
        return f"{'load on' if self.kind == 'load' else 'friction of'} {self.owner}"


@dataclass(frozen=True)
class ChangeEvidence:
    """What the last rows say about a change.

    Attributes:
        square: Part of the squared innovation that it explains.
        rank: Unknowns that the rows show.
        x: Unknowns in their units, NaN where they are not shown, shape (k,).
        deviations: Their standard deviations, shape (k,).
    """

    square: float
    rank: int
    x: Array
    deviations: Array


def changes_of(model: DynamicModel, base: BaseParameters, torque: Array) -> tuple[Change, ...]:
    """Return what is looked for: a load on each link that carries no other, and the friction of each joint.

    Args:
        model: Robot, drives and friction.
        base: Its base parameters.
        torque: Root mean square torque of each joint, shape (n,).
    """
    robot = model.robot
    links = len(robot.links)
    sizes = parameter_sizes(model, np.ones(links), np.full(links, 0.1), torque)
    found = []
    for link in robot.tips:
        found.append(_change("load", robot.links[link].name, base, np.arange(10 * link, 10 * link + 10), sizes))
    for joint in robot.joint_names:
        own = [k for k, p in enumerate(model.parameters) if p.kind == "friction" and p.owner == joint]
        found.append(_change("friction", joint, base, np.array(own, dtype=int), sizes))
    return tuple(change for change in found if change.columns.any())


def _change(kind: str, owner: str, base: BaseParameters, own: IntArray, sizes: Array) -> Change:
    return Change(kind, owner, base.matrix[:, own] * sizes[own], sizes[own])


def evidence_of(
    changes: Sequence[Change], recent: Reduced, beta: Array, covariance: Array
) -> tuple[ChangeEvidence, ...]:
    """Return what rows say about each change.

    Args:
        changes: The changes.
        recent: The rows, with unit noise.
        beta: Base parameters as they were known before, shape (b,).
        covariance: Of these, shape (b, b).
    """
    size = len(beta)
    spread = np.eye(size) + recent.r @ covariance @ recent.r.T
    factor = np.linalg.cholesky(0.5 * (spread + spread.T))
    white = scipy.linalg.solve_triangular(factor, np.column_stack([recent.z - recent.r @ beta, recent.r]), lower=True)
    return tuple(_evidence(change, white[:, 0], white[:, 1:] @ change.columns) for change in changes)


def _evidence(change: Change, innovation: Array, shown: Array) -> ChangeEvidence:
    u, s, vt = np.linalg.svd(shown, full_matrices=False)
    kept = s > _OPEN * max(float(s[0]), 1e-300)
    explained = u[:, kept].T @ innovation
    x = vt[kept].T @ (explained / s[kept]) * change.sizes
    deviations = np.sqrt(np.sum((vt[kept] / s[kept, None]) ** 2, axis=0)) * change.sizes
    hidden = 1.0 - np.sum(vt[kept] ** 2, axis=0) > _HIDDEN
    x[hidden], deviations[hidden] = np.nan, np.inf
    return ChangeEvidence(float(explained @ explained), int(kept.sum()), x, deviations)


def threshold(squares: Array, rank: int, independent: float, chance: float) -> float:
    """Return the square that is exceeded by chance with a stated probability at one look.

    Args:
        squares: Those of looks at clean runs, shape (m,).
        rank: Unknowns behind them.
        independent: How many of the looks are independent.
        chance: Probability.
    """
    middle, high = float(np.mean(squares)) / rank, float(np.quantile(squares, 0.95) / scipy.stats.chi2.ppf(0.95, rank))
    scale = max(1.0, middle, high)  # residuals hang together and the model is not exact, so more than noise alone
    return rank * scale * float(scipy.stats.f.isf(chance, rank, max(rank * independent, 1.0)))
