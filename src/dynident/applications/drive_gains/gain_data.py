"""The reduced rows of all runs, and what every method of this room shares: linearised rows, stacked and solved."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dynident.applications.drive_gains.drive_rows import DriveGroup, DriveRows
from dynident.applications.drive_gains.unknowns import Unknowns
from dynident.arrays import Array
from dynident.model.reduction import Triangle

#: A direction with unit columns below this share of the strongest is not determined at all.
NULL = 1e-8


@dataclass(frozen=True)
class GainData:
    """What the gains are found from.

    Attributes:
        rows: The rows of each run.
        triangles: The same reduced, by run and group.
        unknowns: What is known and what is not about the base parameters.
    """

    rows: tuple[DriveRows, ...]
    triangles: tuple[tuple[Triangle, ...], ...]
    unknowns: Unknowns

    @classmethod
    def of(cls, rows: Sequence[DriveRows], unknowns: Unknowns) -> GainData:
        """Return the data of some runs."""
        found = tuple(each.triangles(np.ones(each.counting.shape)) for each in rows)
        return cls(tuple(rows), found, unknowns)

    @property
    def groups(self) -> tuple[DriveGroup, ...]:
        """The G groups of rows that share a gain."""
        return self.rows[0].groups

    @property
    def counts(self) -> Array:
        """Number of rows of each group in all runs, shape (G,)."""
        return np.array([[t.rows for t in run] for run in self.triangles], dtype=float).sum(axis=0)

    @property
    def current_squares(self) -> Array:
        """Sum of squared currents of each group in all runs, shape (G,)."""
        return np.array([[t.torque_square for t in run] for run in self.triangles]).sum(axis=0)


@dataclass(frozen=True)
class Linearised:
    """Rows linear in the coordinates x = (one for each group, then z), as maps on the rows of the drives.

    The residual of a row e with target i is i - e vector, and its slopes with respect to x are e map.

    Attributes:
        maps: By run, shape (G, b + 2, P).
        vectors: By run, shape (G, b + 2).
        inverse: Whether the first G coordinates are the inverses of the gains, in A/N m, or the gains.
    """

    maps: tuple[Array, ...]
    vectors: tuple[Array, ...]
    inverse: bool


def current_rows(data: GainData, inverse_gains: Array, z: Array) -> Linearised:
    """Return the rows i = a (W beta + known), residuals in A, about inverse gains a (G,) and z (Z,)."""
    groups, unknowns = len(data.groups), data.unknowns
    maps, vectors = [], []
    for run in range(len(data.rows)):
        torque = np.append(unknowns.beta(run, z), [1.0, 0.0])
        slope = np.zeros((groups, len(torque), groups + unknowns.count))
        slope[np.arange(groups), :, np.arange(groups)] = torque
        slope[:, :-2, groups:] = inverse_gains[:, None, None] * unknowns.slopes(run, z)
        maps.append(slope)
        vectors.append(np.outer(inverse_gains, torque))
    return Linearised(tuple(maps), tuple(vectors), True)


def torque_rows(data: GainData, gains: Array, z: Array) -> Linearised:
    """Return the rows W known_s + known = K i - W slopes_s z, residuals in N m, at gains K (G,) and z (Z,)."""
    groups, unknowns = len(data.groups), data.unknowns
    maps, vectors = [], []
    for run in range(len(data.rows)):
        beta = unknowns.beta(run, z)
        slope = np.zeros((groups, len(beta) + 2, groups + unknowns.count))
        slope[np.arange(groups), -1, np.arange(groups)] = 1.0
        slope[:, :-2, groups:] = -unknowns.slopes(run, z)
        maps.append(slope)
        vectors.append(np.column_stack([np.tile(np.append(-beta, -1.0), (groups, 1)), 1.0 + gains]))
    return Linearised(tuple(maps), tuple(vectors), False)


def stacked(data: GainData, rows: Linearised, weights: Array) -> tuple[Array, Array]:
    """Return the weighted slopes and residuals of all reduced rows, what is known of z among them."""
    slopes, residuals = [], []
    for run, triangles in enumerate(data.triangles):
        for g, triangle in enumerate(triangles):
            own, factor = triangle.columns, triangle.factor
            slopes.append(weights[g] * factor[:, :-1] @ rows.maps[run][g, own])
            residuals.append(weights[g] * (factor[:, -1] - factor[:, :-1] @ rows.vectors[run][g, own]))
    return np.concatenate(slopes), np.concatenate(residuals)


def with_prior(data: GainData, slopes: Array, residuals: Array, z: Array) -> tuple[Array, Array]:
    """Return slopes and residuals with the rows z / deviation = 0 of what is known of z."""
    known = np.flatnonzero(np.isfinite(data.unknowns.deviations))
    if not len(known):
        return slopes, residuals
    deviations = data.unknowns.deviations[known]
    rows = np.zeros((len(known), slopes.shape[1]))
    rows[np.arange(len(known)), slopes.shape[1] - data.unknowns.count + known] = 1.0 / deviations
    return np.concatenate([slopes, rows]), np.concatenate([residuals, -z[known] / deviations])


def group_squares(data: GainData, rows: Linearised) -> Array:
    """Return the sum of squared residuals of each group over all runs, shape (G,)."""
    found = np.zeros(len(data.groups))
    for run, triangles in enumerate(data.triangles):
        for g, triangle in enumerate(triangles):
            own, factor = triangle.columns, triangle.factor
            found[g] += np.sum((factor[:, -1] - factor[:, :-1] @ rows.vectors[run][g, own]) ** 2)
    return found


def solved(slopes: Array, residuals: Array) -> Array:
    """Return the least-squares step of smallest norm with unit columns; directions that are null stay zero."""
    norms = np.linalg.norm(slopes, axis=0)
    scale = np.where(norms > 0, norms, 1.0)
    return np.linalg.lstsq(slopes / scale, residuals, rcond=NULL)[0] / scale
