"""Samples of logs reduced block by block of time: fits of all blocks or of some, and how far blocks disagree.

The covariance is that of scores summed over blocks (Liang and Zeger 1986, without a working correlation): whatever
hangs together within a block, in time, between joints or with the motion, is taken in. It needs blocks longer than
residuals remember.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from dynident.arrays import Array
from dynident.identification.problem.problem import Problem, check_rank
from dynident.identification.problem.regressor_stream import RegressorStream
from dynident.identification.residuals.row_passes import RowPasses
from dynident.model.lapack import solve_upper
from dynident.model.reduction import Reduced, Triangle, reduce
from dynident.model.threads import one_blas_thread

#: Passes of weighting.
PASSES = 4


@dataclass(frozen=True)
class BlockTriangles:
    """Unweighted triangles of each joint, block after block of time.

    Attributes:
        blocks: One triangle a joint, shape (n,), of each block.
        regressor: What made the rows.
    """

    blocks: tuple[tuple[Triangle, ...], ...]
    regressor: RegressorStream

    @cached_property
    def total(self) -> tuple[Triangle, ...]:
        """Triangle of each joint over all blocks."""
        return merged(self.blocks)

    @cached_property
    def fit(self) -> tuple[Array, Array]:
        """Weighted least squares over all blocks: beta (b,) and the weight of each joint (n,).

        Raises:
            PoorExcitation: The rows do not determine all base parameters.
        """
        return self._fitted(self.total)

    @cached_property
    def reduced(self) -> Reduced:
        """The weighted triangle over all joints."""
        return reduce(self.total, self.regressor.base.count, self.fit[1])

    @cached_property
    def influences(self) -> Array:
        """By how much each block moves the estimate, shape (B, b); zero in sum."""
        beta, weights = self.fit
        scores = np.array([scores_of(block, weights, beta) for block in self.blocks])
        with one_blas_thread():
            half = solve_upper(self.reduced.r, scores.T, transposed=True)
            return solve_upper(self.reduced.r, half).T

    @property
    def covariance(self) -> Array:
        """Covariance of the estimate, shape (b, b), of rank below the number of blocks."""
        count = len(self.blocks)
        return self.influences.T @ self.influences * count / max(count - 1, 1)

    def without(self, left_out: Sequence[int]) -> Array:
        """Return the estimate (b,) of all blocks but some; raises as :attr:`fit` does."""
        return self._fitted(merged([block for k, block in enumerate(self.blocks) if k not in left_out]))[0]

    def _fitted(self, triangles: tuple[Triangle, ...]) -> tuple[Array, Array]:
        with one_blas_thread():
            check_rank(reduce(triangles, self.regressor.base.count, np.ones(len(triangles))), self.regressor.base)
        return weighted_fit(triangles, self.regressor.base.count)


def block_triangles(problem: Problem, shortest_s: float, most: int) -> BlockTriangles:
    """Return the triangles of blocks of time of the logs of a problem.

    Args:
        problem: The logs and what makes their rows; its own triangles are not asked for.
        shortest_s: Length of a block in s at least.
        most: Number of blocks at most, over all logs; a log has one at least.
    """
    length, edges = max(shortest_s, sum(log.kept.duration for log in problem.logs) / most, 1e-9), [0]
    for log in problem.logs:
        count = max(1, int(log.kept.duration / length))
        edges += (edges[-1] + np.linspace(0, len(log.keep), count + 1)[1:].round()).astype(int).tolist()
    return BlockTriangles(tuple(RowPasses(problem).intervals(edges)), problem.regressor)


def merged(blocks: Sequence[tuple[Triangle, ...]]) -> tuple[Triangle, ...]:
    """Return the triangle of each joint over several blocks."""
    return tuple(first.merged(rest) for first, *rest in zip(*blocks, strict=True))


def weighted_fit(triangles: Sequence[Triangle], size: int) -> tuple[Array, Array]:
    """Return beta (b,) and the weight of each joint (n,), one over its residual deviation; rows of full rank."""
    weights = np.ones(len(triangles))
    beta = np.zeros(size)
    floors = np.array([1e-12 * t.torque_square / max(t.rows, 1) + 1e-300 for t in triangles])
    with one_blas_thread():
        for _ in range(PASSES):
            reduced = reduce(triangles, size, weights)
            beta = solve_upper(reduced.r, reduced.z)
            squares = np.array([t.residual_square(beta) / max(t.rows, 1) for t in triangles])
            weights = 1.0 / np.sqrt(squares + floors)
    return beta, weights


def scores_of(block: Sequence[Triangle], weights: Array, beta: Array) -> Array:
    """Return the weighted products of the columns with the residuals of a block, shape (b,)."""
    score = np.zeros(len(beta))
    for triangle, weight in zip(block, weights.tolist(), strict=True):
        residual = triangle.factor @ np.append(-beta[triangle.columns], 1.0)
        score[triangle.columns] += weight**2 * (triangle.factor[:, :-1].T @ residual)
    return score
