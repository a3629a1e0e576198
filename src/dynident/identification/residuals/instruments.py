"""Instrumental variables on triangles: rows of instruments, regressor and torque reduced together, never squared.

The triangle of [Z, W, tau] = Q T holds Z = Q1 Tzz, Q1' W = Tzw and Q1' tau = tz, so the estimate
(Z' W)^-1 Z' tau is Tzw^-1 tz: no product of two matrices of rows is ever formed.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dynident.arrays import Array
from dynident.data.preprocessing import Prepared
from dynident.errors import SolverFailed
from dynident.identification.problem.problem import Problem
from dynident.identification.residuals.bands import Band, bands_of
from dynident.identification.residuals.coloured import Influence, Uncertainty, error_root, uncertainty_of
from dynident.identification.residuals.row_passes import RowPasses, Segment
from dynident.identification.residuals.stretches import stretches_of
from dynident.model.lapack import solve_upper
from dynident.model.reduction import CHUNK, absorb, triangle_of
from dynident.model.threads import one_blas_thread

#: Singular value of the instruments' projection with unit columns below which they say nothing of a direction.
WEAK = 1e-8


@dataclass(frozen=True)
class Instruments:
    """Instruments beside the regressor of a problem, reduced joint by joint, unweighted.

    Attributes:
        problem: The problem.
        logs: Its logs with the states that the instruments are made of.
        factors: Triangle of [Z_i, W_i, tau_i] of each joint, shape (2 K_i + 1, 2 K_i + 1) each.
    """

    problem: Problem
    logs: tuple[Prepared, ...]
    factors: tuple[Array, ...]

    def stacked(self, weights: Array) -> Array:
        """Return the triangle of [Z, W, tau] over all joints, rows of joint i times weights[i], (2 b + 1, 2 b + 1)."""
        size = self.problem.base.count
        parts = []
        for triangle, factor, weight in zip(self.problem.triangles, self.factors, weights, strict=True):
            part = np.zeros((len(factor), 2 * size + 1))
            part[:, np.r_[triangle.columns, size + triangle.columns, 2 * size]] = weight * factor
            parts.append(part)
        with one_blas_thread():
            return triangle_of(np.concatenate([*parts, np.zeros((2 * size + 1, 2 * size + 1))]))

    def solve(self, weights: Array) -> Array:
        """Return (Z' W)^-1 Z' tau with the weighted rows, shape (b,).

        Raises:
            SolverFailed: The instruments do not go with the regressor.
        """
        size = self.problem.base.count
        factor = self.stacked(weights)
        return np.linalg.solve(_projection(factor, size), factor[:size, 2 * size])

    def influence(self, weights: Array) -> Array:
        """Return (Z' W)^-1, shape (b, b): the estimate is this times Z' tau.

        Raises:
            SolverFailed: The instruments do not go with the regressor.
        """
        size = self.problem.base.count
        factor = self.stacked(weights)
        inverse = solve_upper(factor[:size, :size], np.eye(size), transposed=True)
        return np.linalg.solve(_projection(factor, size), inverse)

    def uncertainty(self, weights: Array, beta: Array) -> Uncertainty:
        """Return the covariance (Z' W)^-1 Z' S Z (W' Z)^-1 with S that of the residuals at ``beta``, by frequency.

        Args:
            weights: Weight of each joint's rows in the fit, shape (n,).
            beta: The estimate, shape (b,).
        """
        residual = RowPasses(self.problem).residuals(beta)
        return uncertainty_of(self._bands(), residual, self._influence(weights, residual))

    def difference_root(self, weights: Array, beta: Array, inverse: Array) -> Array:
        """Return S with S'S the covariance of the estimate less that of least squares, shape (s, b).

        Args:
            weights: Weight of each joint's rows in both fits, shape (n,).
            beta: The estimate, shape (b,).
            inverse: (W' W)^-1 of the weighted rows, shape (b, b).
        """
        residual = RowPasses(self.problem).residuals(beta)
        both = np.hstack([self.influence(weights), -inverse])
        asked = (weights**2)[:, None, None] * both
        return error_root(self._bands(), residual, self._influence(weights, residual), asked)

    def _influence(self, weights: Array, residual: Array) -> Influence:
        size, matrix = self.problem.base.count, self.influence(weights)
        gains = (weights**2)[:, None, None] * np.hstack([matrix, np.zeros_like(matrix)])
        noise = np.sqrt(np.sum(residual**2, axis=0) / np.maximum(self.problem.counts, 1))
        root = self.stacked(weights**2 * noise)[:size, :size] @ matrix.T
        return Influence(gains, root.T @ root, np.eye(len(weights)))

    def _bands(self) -> Iterator[Band]:
        size, columns = self.problem.base.count, self.problem.regressor.columns
        parts = stretches_of(self.problem.logs, self._segments(), np.concatenate(self.problem.masks))
        return bands_of(parts, [np.r_[own, size + own] for own in columns], 2 * size)

    def _segments(self) -> Iterator[Segment]:
        """Yield the rows of instruments and regressor, beside each other, with the torque last."""
        regressor = self.problem.regressor
        start = 0
        for simulated, measured in zip(self.logs, self.problem.logs, strict=True):
            pairs = zip(regressor.segments(simulated), regressor.segments(measured), strict=True)
            for (part, ours), (_, theirs) in pairs:
                both = tuple(np.concatenate([first[:-1], second]) for first, second in zip(ours, theirs, strict=True))
                yield Segment(slice(start + part.start, start + part.stop), both)
            start += len(measured.keep)


def instruments(problem: Problem, logs: Sequence[Prepared]) -> Instruments:
    """Return the instruments that logs with other states make, filtered and chosen as the problem's own rows.

    Args:
        problem: The problem.
        logs: Its logs, in the same order, with the same rows, and states free of the noise of the measured ones.
    """
    regressor = problem.regressor
    sizes = [2 * len(columns) + 1 for columns in regressor.columns]
    factors: list[Array] = [np.zeros((size, size), order="F") for size in sizes]
    for simulated, measured, mask in zip(logs, problem.logs, problem.masks, strict=True):
        pairs = zip(regressor.segments(simulated), regressor.segments(measured), strict=True)
        with one_blas_thread():
            for (part, ours), (_, theirs) in pairs:
                for i, (first, second) in enumerate(zip(ours, theirs, strict=True)):
                    chosen = np.concatenate([first[:-1], second])[:, mask[part, i]]
                    for start in range(0, chosen.shape[1], CHUNK):
                        panel = np.ascontiguousarray(chosen[:, start : start + CHUNK])
                        factors[i] = absorb(factors[i], panel.T)
    return Instruments(problem, tuple(logs), tuple(np.triu(factor) for factor in factors))


def with_states(problem: Problem, logs: Sequence[Prepared]) -> Problem:
    """Return the problem whose regressor is made of other states; torques and rows stay."""
    regressor = problem.regressor
    parts = [regressor.triangles(log, mask) for log, mask in zip(logs, problem.masks, strict=True)]
    triangles = tuple(first.merged(rest) for first, *rest in zip(*parts, strict=True))
    return replace(problem, logs=tuple(logs), triangles=triangles)


def _projection(factor: Array, size: int) -> Array:
    """Return Q1' W, shape (b, b), once it is found regular."""
    found = factor[:size, size : 2 * size]
    norms = np.linalg.norm(factor[: 2 * size, size : 2 * size], axis=0)
    values = np.linalg.svd(found / np.where(norms > 0, norms, 1.0), compute_uv=False)
    if not values[-1] > WEAK:
        evidence = f"in one direction they share {values[-1]:.2g} of the regressor"
        step = "choose another reference, or a bandwidth at which the simulated robot follows it"
        raise SolverFailed("the instrumental variables", evidence, step)
    return found
