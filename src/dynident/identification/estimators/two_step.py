"""Friction first, then the rigid bodies."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dynident.arrays import Array, BoolArray
from dynident.errors import BadOption, PoorExcitation, SolverFailed
from dynident.identification.estimators.wls import WLS
from dynident.identification.problem.estimator import Estimator, Solution
from dynident.identification.problem.method_run import MethodRun
from dynident.identification.problem.problem import Problem
from dynident.identification.residuals.bands import bands_beside
from dynident.identification.residuals.coloured import Influence, Uncertainty, uncertainty_of
from dynident.identification.residuals.row_passes import RowPasses
from dynident.model.reduction import Triangle, least_squares, reduce

#: Directions of the first step that are weaker than this share of the strongest are left open.
WEAK = 1e-6

#: Rows of the first step for each base parameter, at least: of fewer, its residual says nothing of its errors.
ROWS_A_PARAMETER = 2


@dataclass(frozen=True, kw_only=True)
class TwoStepRun(MethodRun):
    """The first step: samples, largest acceleration in root mean squares of the joint, parameters."""

    slow_samples: int
    largest_acceleration: float
    friction: Sequence[str]


@dataclass(frozen=True)
class TwoStep(Estimator):
    """Two steps: friction from samples with low acceleration, then rigid bodies from all samples with fixed friction.

    Groups of parameters are found one after the other, as by Grotjahn, Daemi and Heimann 2001; in place of their
    special motions the first step takes those samples of the log where every joint accelerates least. It fits the whole
    model there, by ``wls``, and keeps friction and offset; what else stays open there (inertia) is left to the second
    step, ``wls`` on the torque less that friction. The covariance carries the error of the first step into the second.

    Attributes:
        share: Share of the samples that the first step takes, those with the smallest largest acceleration, each
            joint's in units of its root mean square.
    """

    share: float = 0.5

    def __post_init__(self) -> None:
        if not 0 < self.share <= 1:
            raise BadOption("share", self.share, "give a share of the samples above 0, up to 1, such as 0.5")

    def solve(self, problem: Problem) -> Solution:
        """Return the estimate.

        Raises:
            PoorExcitation: The rows of the first step do not determine friction.
            SolverFailed: The model has no friction, or the first step fewer than two rows for each base parameter.
        """
        held = problem.base.is_friction
        if not held.any():
            step = "add friction parts to the model, or use wls"
            raise SolverFailed("the two-step fit", "the model has no friction parameter", step)
        passes = RowPasses(problem)
        slow, largest = slow_samples(problem, self.share)
        first = passes.triangles(np.repeat(slow[:, None].astype(float), len(problem.triangles), axis=1))
        slow_problem = replace(problem, triangles=first)
        early = WLS().solve(slow_problem)
        self._check(slow_problem, early.weights, held)
        beta = np.where(held, early.beta, 0.0)
        weights, free = early.weights, np.flatnonzero(~held)
        for _ in range(10 if len(free) else 0):
            known = tuple(without(triangle, beta, held) for triangle in problem.triangles)
            found = least_squares(reduce(known, problem.base.count, weights)).beta
            beta = np.where(held, beta, found)
            renewed = 1.0 / problem.joint_deviations(beta)
            settled = bool(np.all(np.abs(renewed - weights) <= 1e-3 * weights))
            weights = renewed
            if settled:
                break
        run = TwoStepRun(
            slow_samples=int(slow.sum()),
            largest_acceleration=largest,
            friction=[name for name, mine in zip(problem.base.names, held, strict=True) if mine],
        )
        sure = self._uncertainty(passes, (slow, first), beta, (early.weights, weights), held)
        return Solution(beta, weights, covariance=sure.covariance, degrees=sure.degrees, run=run)

    def _check(self, problem: Problem, weights: Array, held: BoolArray) -> None:
        """Refuse a first step that leaves friction open, or has too few rows to tell its errors."""
        reduced = problem.reduced(weights)
        norms = reduced.column_norms
        _, values, directions = np.linalg.svd(reduced.r / np.where(norms > 0, norms, 1.0))
        weak = directions[values <= WEAK * values[0]]
        open_parts = held & ((np.abs(weak).max(axis=0, initial=0.0) > WEAK**0.5) | (norms == 0.0))
        if open_parts.any():
            names = [name for name, mine in zip(problem.base.names, open_parts, strict=True) if mine]
            raise PoorExcitation(
                int(held.sum() - open_parts.sum()),
                int(held.sum()),
                f"friction in the samples with little acceleration, undetermined: {'; '.join(names[:3])}",
                "give a larger share, or add stretches of constant velocity in both directions",
            )
        rows, wanted = int(problem.counts.sum()), problem.base.count
        if rows < ROWS_A_PARAMETER * wanted:
            evidence = f"{rows} samples with little acceleration are too few for {wanted} parameters"
            raise SolverFailed("the two-step fit", evidence, "record a longer log, or give a larger share")

    def _uncertainty(
        self,
        passes: RowPasses,
        slow: tuple[BoolArray, tuple[Triangle, ...]],
        beta: Array,
        weights: tuple[Array, Array],
        held: BoolArray,
    ) -> Uncertainty:
        """Return the covariance of both steps from the rows that both, or only the second, use.

        With S1 = W1'W1 over the slow rows and S2 over all, both weighted, the errors are M1 W1'e for friction and
        S2rr^-1 (W2r'e - S2rf M1 W1'e) for the rest.
        """
        problem, count = passes.problem, passes.problem.base.count
        early, late = weights
        samples, early_rows = slow
        deviations = problem.joint_deviations(beta)
        first = least_squares(reduce(early_rows, count, early), WEAK).unscaled_covariance[held]
        second = problem.reduced(late)
        gram = second.r.T @ second.r
        rest = np.flatnonzero(~held)
        inverse = np.zeros((count, count))
        inverse[np.ix_(rest, rest)] = np.linalg.pinv(gram[np.ix_(rest, rest)], hermitian=True)
        from_first = np.zeros((count, count))
        from_first[held] = first
        from_first[rest] = -(inverse @ gram[:, held] @ first)[rest]
        # e enters by the score of the first step (slow rows, weights squared) and by that of the second (all rows).
        spread1 = reduce(early_rows, count, early**2 * deviations).r @ from_first.T
        spread2 = problem.reduced(late**2 * deviations).r @ inverse
        mixed = reduce(early_rows, count, early * late * deviations)
        both = from_first @ (mixed.r.T @ mixed.r) @ inverse
        plain = spread1.T @ spread1 + spread2.T @ spread2 + both + both.T
        pairs = zip(early**2, late**2, strict=True)
        gains = np.stack([np.hstack([a * from_first, b * inverse]) for a, b in pairs])
        influence = Influence(gains, plain, np.eye(len(early)))
        return uncertainty_of(bands_beside(passes, samples.astype(float)), passes.residuals(beta), influence)


def slow_samples(problem: Problem, share: float) -> tuple[BoolArray, float]:
    """Return which samples accelerate least, over all logs, shape (N,), and the largest acceleration among them.

    Args:
        problem: The problem.
        share: Share of the samples.
    """
    acceleration = np.concatenate([np.asarray(log.kept.ddq) for log in problem.logs])
    size = np.sqrt(np.mean(acceleration**2, axis=0))
    relative = np.max(np.abs(acceleration) / np.where(size > 0, size, 1.0), axis=1)
    bound = float(np.quantile(relative, share, method="inverted_cdf"))
    return relative <= bound, bound


def without(triangle: Triangle, beta: Array, held: BoolArray) -> Triangle:
    """Return the rows of a joint with the torque of the held parameters taken from the right-hand side."""
    mine = held[triangle.columns]
    factor = np.array(triangle.factor)
    factor[:, -1] -= factor[:, :-1][:, mine] @ beta[triangle.columns[mine]]
    keep = np.append(~mine, True)
    return Triangle(triangle.columns[~mine], factor[:, keep], triangle.rows)
