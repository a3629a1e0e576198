"""Instrumental variables on triangles: rows of instruments, regressor and torque reduced together, never squared.

The triangle of [Z, W, tau] = Q T holds Z = Q1 Tzz, Q1' W = Tzw and Q1' tau = tz, so the estimate
(Z' W)^-1 Z' tau is Tzw^-1 tz: no product of two matrices of rows is ever formed.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg

from dynident.arrays import Array, BoolArray
from dynident.errors import SolverFailed
from dynident.estimation.problem import Observer, Problem
from dynident.estimation.uncertainty.covariance import FEWEST_FREE
from dynident.estimation.uncertainty.spectral import score_triangle
from dynident.experiment.preprocessing import Prepared
from dynident.model.reduction import CHUNK, absorb, least_squares, triangle_of
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
        inverse = scipy.linalg.solve_triangular(factor[:size, :size], np.eye(size), trans=1)
        return np.linalg.solve(_projection(factor, size), inverse)

    def quick_covariance(self, weights: Array) -> Array:
        """Return (Z' W)^-1 Z' Z (W' Z)^-1 of the weighted rows, shape (b, b): for residuals of one, all independent."""
        size = self.problem.base.count
        spread = self.stacked(weights)[:size, :size] @ self.influence(weights).T
        return spread.T @ spread

    def scores(self, weights: Array, beta: Array) -> Array:
        """Return S with S'S the covariance of [Z, W]' e, the weighted rows times their residuals, shape (s, 2 b)."""
        size = self.problem.base.count
        observer = Observer(self.problem.model, self.problem.base)
        columns = [np.r_[own, size + own] for own in observer.columns]
        return score_triangle(self._parts(observer, beta), columns, 2 * size, weights) * np.sqrt(_free(self.problem))

    def covariance(self, weights: Array, beta: Array) -> Array:
        """Return (Z' W)^-1 Z' S Z (W' Z)^-1, shape (b, b), with S the covariance of the residuals at ``beta``.

        Args:
            weights: Weight of each joint's rows in the fit, shape (n,).
            beta: The estimate, shape (b,).
        """
        spread = self.scores(weights, beta)[:, : self.problem.base.count] @ self.influence(weights).T
        return spread.T @ spread

    def _parts(self, observer: Observer, beta: Array) -> Iterator[tuple[list[Array], Array, BoolArray]]:
        for simulated, measured, mask in zip(self.logs, self.problem.logs, self.problem.masks, strict=True):
            pairs = zip(observer.segments(simulated), observer.segments(measured), strict=True)
            for (part, ours), (_, theirs) in pairs:
                both = [np.concatenate([first[:-1], second[:-1]]) for first, second in zip(ours, theirs, strict=True)]
                yield both, _residuals(observer, theirs, beta), mask[part]


def instruments(problem: Problem, logs: Sequence[Prepared]) -> Instruments:
    """Return the instruments that logs with other states make, filtered and chosen as the problem's own rows.

    Args:
        problem: The problem.
        logs: Its logs, in the same order, with the same rows, and states free of the noise of the measured ones.
    """
    observer = Observer(problem.model, problem.base)
    sizes = [2 * len(columns) + 1 for columns in observer.columns]
    factors: list[Array] = [np.zeros((size, size), order="F") for size in sizes]
    for simulated, measured, mask in zip(logs, problem.logs, problem.masks, strict=True):
        pairs = zip(observer.segments(simulated), observer.segments(measured), strict=True)
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
    observer = Observer(problem.model, problem.base)
    parts = [observer.triangles(log, mask) for log, mask in zip(logs, problem.masks, strict=True)]
    triangles = tuple(first.merged(rest) for first, *rest in zip(*parts, strict=True))
    return replace(problem, logs=tuple(logs), triangles=triangles)


def spectral_covariance(problem: Problem, weights: Array, beta: Array) -> Array:
    """Return the covariance of least squares with one weight a joint, residuals coloured as they are, shape (b, b).

    Args:
        problem: The problem.
        weights: Weight of each joint's rows in the fit, shape (n,).
        beta: The estimate, shape (b,).
    """
    observer, size = Observer(problem.model, problem.base), problem.base.count

    def parts() -> Iterator[tuple[list[Array], Array, BoolArray]]:
        for log, mask in zip(problem.logs, problem.masks, strict=True):
            for part, blocks in observer.segments(log):
                yield [block[:-1] for block in blocks], _residuals(observer, blocks, beta), mask[part]

    rows = score_triangle(parts(), observer.columns, size, weights)
    spread = rows @ least_squares(problem.reduced(weights)).unscaled_covariance
    return spread.T @ spread * _free(problem)


def _residuals(observer: Observer, blocks: Sequence[Array], beta: Array) -> Array:
    """Return the residuals of blocks of rows, shape (N, n)."""
    pairs = zip(observer.columns, blocks, strict=True)
    return np.stack([block[-1] - beta[columns] @ block[:-1] for columns, block in pairs], axis=1)


def _free(problem: Problem) -> float:
    """Return by how much residuals of a fit are smaller than those at the truth, squared and turned round."""
    return 1.0 / max(1.0 - problem.base.count / max(int(problem.counts.sum()), 1), FEWEST_FREE)


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
