"""The objective of a bounded fit, from a problem: absolute errors over the rows, or squares over the triangle.

Both are convex, so the smallest value in a box can be computed and proven, which is what any search is judged by.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dynident.arrays import Array, BoolArray, IntArray
from dynident.errors import SolverFailed
from dynident.identification.problem.problem import Problem
from dynident.identification.search.least_absolute import GAP, least_absolute


@dataclass(frozen=True)
class Landscape:
    """The objective F(x) = constant + sum_i weight_i sum_{rows of block i} |target - columns' x|^power.

    Attributes:
        columns: Observation matrix, each column contiguous, shape (b, r).
        target: Shape (r,).
        edges: First row of each block (joint), then r, shape (n + 1,).
        present: Whether a column is not zero throughout a block, shape (b, n).
        weights: Shape (n,).
        power: 1 or 2.
        constant: See above.
    """

    columns: Array
    target: Array
    edges: IntArray
    present: BoolArray
    weights: Array
    power: int
    constant: float = 0.0

    def sums(self, residual: Array) -> Array:
        """Return sum |residual|^power of each block, shape (n,)."""
        size = np.abs(residual) if self.power == 1 else residual**2
        return np.array([size[a:b].sum() for a, b in zip(self.edges[:-1], self.edges[1:], strict=True)])

    def value(self, x: Array) -> float:
        """Return F(x)."""
        return float(self.weights @ self.sums(self.target - x @ self.columns)) + self.constant


@dataclass(frozen=True)
class Optimum:
    """The smallest value of a landscape in a box.

    Attributes:
        x: Where it is, shape (b,).
        objective: F(x).
        lower_bound: No point of the box has a smaller value; within 1e-6 of the objective.
    """

    x: Array
    objective: float
    lower_bound: float


def absolute_landscape(problem: Problem, delta: Array) -> Landscape:
    """Return the article's objective (9), 1/N sum_i sum_j delta_j |tau_ji - tau_pji|, over the rows that count.

    Args:
        problem: The problem; N is the number of its time samples.
        delta: Weight of each joint, shape (n,).
    """
    regressor = problem.regressor
    edges = np.concatenate([[0], np.cumsum(problem.counts)]).astype(np.int64)
    columns = np.zeros((problem.base.count, int(edges[-1])))
    target = np.empty(int(edges[-1]))
    place = edges[:-1].copy()
    for log, mask in zip(problem.logs, problem.masks, strict=True):
        for i, block in enumerate(regressor.rows(log)):
            part = block if mask[:, i].all() else block[:, mask[:, i]]
            rows = slice(int(place[i]), int(place[i]) + part.shape[1])
            for column, values in zip(regressor.columns[i], part[:-1], strict=True):
                columns[column, rows] = values
            target[rows] = part[-1]
            place[i] = rows.stop
    present = np.zeros((len(columns), len(delta)), bool)
    for i, found in enumerate(regressor.columns):
        present[found, i] = True
    return Landscape(columns, target, edges, present, delta / problem.samples, power=1)


def square_landscape(problem: Problem, delta: Array) -> Landscape:
    """Return 1/N sum_i sum_j delta_j (tau_ji - tau_pji)^2 on the reduced triangle: b rows, however long the logs.

    Args:
        problem: The problem; N is the number of its time samples.
        delta: Weight of each joint, shape (n,).
    """
    reduced = problem.reduced(np.sqrt(delta))
    size, share = len(reduced.z), 1.0 / problem.samples
    edges, present = np.array([0, size], dtype=np.int64), np.ones((size, 1), bool)
    columns = np.ascontiguousarray(reduced.r.T)
    return Landscape(columns, reduced.z, edges, present, np.array([share]), 2, reduced.rest * share)


def box_optimum(land: Landscape, lower: Array, upper: Array) -> Optimum:
    """Return the certified smallest value in the box lower < upper.

    Raises:
        SolverFailed: The proven lower bound is not within 1e-6 of the objective.
    """
    if land.power == 1:
        weights = np.repeat(land.weights, np.diff(land.edges))
        found = least_absolute(land.columns.T, land.target, weights, lower, upper)
        return Optimum(found.beta, found.objective + land.constant, found.lower_bound + land.constant)
    return _box_least_squares(land, lower, upper)


def _box_least_squares(land: Landscape, lower: Array, upper: Array) -> Optimum:
    """Solve by active sets (Stark and Parker 1995); the bound is the lowest point of the tangent plane in the box."""
    from scipy.optimize import lsq_linear

    root = np.sqrt(np.repeat(land.weights, np.diff(land.edges)))
    columns, target = land.columns * root, land.target * root
    norms = np.linalg.norm(columns, axis=1)
    scale = np.where(norms > 0, norms, 1.0)
    found = lsq_linear((columns / scale[:, None]).T, target, (lower * scale, upper * scale), method="bvls", tol=1e-14)
    x = np.clip(found.x / scale, lower, upper)
    objective, slope = land.value(x), 2.0 * columns @ (x @ columns - target)
    bound = objective - float(np.sum(np.maximum(slope * (x - lower), slope * (x - upper))))
    bound = min(max(bound, land.constant), objective)
    gap = (objective - bound) / max(objective, 1e-6 * land.value(np.zeros(len(x))), np.finfo(float).tiny)
    if not gap <= GAP:
        raise SolverFailed(
            "the least squares fit in a box",
            f"objective {objective:.6g}, proven lower bound {bound:.6g}, relative gap {gap:.2g}",
            "check the units of the log and the width of the box",
        )
    return Optimum(x, objective, bound)
