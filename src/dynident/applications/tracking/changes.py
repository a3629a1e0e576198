"""What may have changed in a robot while it moves, and a test of each against what the last rows say.

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
from dynident.identification.problem.prior import parameter_sizes
from dynident.model.base_parameters import BaseParameters
from dynident.model.dynamic_model import DynamicModel
from dynident.model.reduction import Reduced

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
