"""M-estimators: residuals far out count less, joint by joint on a scale that outliers do not move.

The fit solves sum_i W_i' psi(u_i) / s = 0 with u = residual / s and the scale s of the row's joint (Huber 1981, chapter
7). The step is that of modified residuals, (W'W)^-1 W'psi (Huber 1981, section 7.8): the criterion falls with every
step for any psi with slope <= 1, and the one triangle of the problem serves all steps. Memory: see
:mod:`dynident.identification.residuals.row_passes`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dynident.arrays import Array, BoolArray
from dynident.errors import SolverFailed
from dynident.identification.problem.estimator import Solution
from dynident.identification.problem.method_run import MethodRun
from dynident.identification.problem.problem import Problem, check_rank
from dynident.identification.residuals.bands import bands
from dynident.identification.residuals.coloured import Influence, Uncertainty, uncertainty_of
from dynident.identification.residuals.row_passes import RowPasses
from dynident.model.reduction import least_squares

#: The median of |u| times this is the standard deviation of normal u.
NORMAL = 1.482602218505602

#: Smallest scale in root mean square torques of the joint: no drive is known better, and exact data need one.
FINEST = 1e-9


@dataclass(frozen=True)
class Loss:
    """What a residual of u scales counts.

    Attributes:
        psi: Derivative of the loss, odd, slope 1 at zero, of an array elementwise.
        slope: Derivative of psi.
        weight: psi(u) / u, 1 at zero.
    """

    psi: Callable[[Array], Array]
    slope: Callable[[Array], Array]
    weight: Callable[[Array], Array]


def huber_loss(bound: float) -> Loss:
    """Return Huber's loss, psi(u) = max(-k, min(k, u)) (Huber 1964); k = 1.345 is 95 % efficient on normal data."""
    return Loss(
        lambda u: np.clip(u, -bound, bound),
        lambda u: (np.abs(u) <= bound).astype(float),
        lambda u: bound / np.maximum(np.abs(u), bound),
    )


def biweight_loss(bound: float) -> Loss:
    """Return Tukey's biweight, psi(u) = u (1 - (u/c)^2)^2 up to c, 0 beyond (Beaton and Tukey 1974).

    c = 4.685 is 95 % efficient on normal data.
    """

    def inside(u: Array) -> Array:
        return np.maximum(1.0 - (u / bound) ** 2, 0.0)

    return Loss(
        lambda u: u * inside(u) ** 2, lambda u: inside(u) * (1.0 - 5.0 * (u / bound) ** 2), lambda u: inside(u) ** 2
    )


@dataclass(frozen=True)
class RobustFit:
    """An M-estimate.

    Attributes:
        beta: Shape (b,).
        scale: Scale of each joint's residuals, shape (n,), in N m or N.
        standard: Residuals in scales, zero where a row does not count, shape (N, n).
        iterations: Steps taken.
    """

    beta: Array
    scale: Array
    standard: Array
    iterations: int


def robust_scales(problem: Problem, residual: Array, counting: BoolArray) -> Array:
    """Return the median absolute deviation about zero of each joint as a standard deviation, shape (n,), never zero.

    The degrees of freedom that beta takes are shared among the joints by their rows.

    Args:
        problem: The problem.
        residual: Shape (N, n).
        counting: Which of the rows count, shape (N, n).
    """
    free = max(1.0 - problem.base.count / max(int(counting.sum()), 1), 1e-3)
    columns = zip(residual.T, counting.T, strict=True)
    middle = np.array([np.median(np.abs(column[keep])) if keep.any() else 0.0 for column, keep in columns])
    torque = np.array([np.sqrt(t.torque_square / max(t.rows, 1)) for t in problem.triangles])
    return np.maximum(NORMAL * middle / np.sqrt(free), np.maximum(FINEST * torque, 1e-300))


def robust_fit(
    passes: RowPasses, loss: Loss, beta: Array, scale: Array | None, iterations: int, tolerance: float
) -> RobustFit:
    """Return the M-estimate reached from ``beta``.

    Args:
        passes: The rows.
        loss: What a residual counts.
        beta: Where to begin, shape (b,).
        scale: Scale of each joint, shape (n,), held; None: renewed from the residuals with every step.
        iterations: Steps at most.
        tolerance: Step, in standard deviations of the fit, and relative change of the scales that end it.

    Raises:
        PoorExcitation: The rows do not determine all base parameters.
        SolverFailed: Not settled after so many steps.
    """
    problem = passes.problem
    residual = passes.residuals(beta)
    spread = robust_scales(problem, residual, passes.counting) if scale is None else scale
    change, done = np.inf, 0
    for done in range(1, iterations + 1):
        reduced = problem.reduced(1.0 / spread)
        if done == 1:
            check_rank(reduced, problem.base)
        score = passes.products(loss.psi(residual / spread) / spread)
        step = least_squares(reduced).unscaled_covariance @ score
        beta = beta + step
        residual = passes.residuals(beta)
        renewed = robust_scales(problem, residual, passes.counting) if scale is None else scale
        change = float(np.linalg.norm(reduced.r @ step) / np.sqrt(len(beta)))
        moved = float(np.max(np.abs(renewed / spread - 1.0)))
        spread = renewed
        if not np.all(np.isfinite(spread)):
            break
        if change <= tolerance and moved <= tolerance:
            return RobustFit(beta, spread, residual / spread, done)
    raise SolverFailed(
        "the robust fit",
        f"the last of {done} steps was still {change:.2g} standard deviations long",
        "allow more iterations, or look for a joint whose torque the model does not explain",
    )


def robust_uncertainty(passes: RowPasses, loss: Loss, fit: RobustFit) -> Uncertainty:
    """Return the covariance of an M-estimate with the scales taken as known.

    A joint's rows have the curvature mean psi' / s^2 (Huber 1981, section 7.6) and the scores x psi / s, whose
    covariance is taken by frequency.

    Raises:
        SolverFailed: So many rows lie far out that the criterion has no curvature.
    """
    problem, counting = passes.problem, passes.counting
    counts = np.maximum(problem.counts, 1)
    psi = np.where(counting, loss.psi(fit.standard), 0.0)
    curvature = np.where(counting, loss.slope(fit.standard), 0.0).sum(axis=0) / counts
    if np.any((curvature <= 0) & (problem.counts > 0)):
        name = problem.model.robot.joint_names[int(np.argmin(curvature))]
        evidence = f"more rows of {name} lie far out than near"
        raise SolverFailed("the robust fit", evidence, "check the torque of that joint, or use huber")
    curvature = np.where(problem.counts > 0, curvature, 1.0)
    inverse = least_squares(problem.reduced(np.sqrt(curvature) / fit.scale)).unscaled_covariance
    influence = Influence.of_rows(problem, psi, inverse, 1.0 / fit.scale, curvature / fit.scale)
    return uncertainty_of(bands(passes), psi, influence)


def robust_solution(passes: RowPasses, loss: Loss, fit: RobustFit, iterations: int) -> Solution:
    """Return a fit with its covariance and what a robust method states of its run.

    Raises:
        SolverFailed: As :func:`robust_uncertainty`.
    """
    weights = np.where(passes.counting, loss.weight(fit.standard), 1.0)
    low, none = weights < 0.5, weights == 0.0
    counts = {"down_weighted": low.sum(axis=0).tolist(), "rejected": none.sum(axis=0).tolist()}
    run = MethodRun(iterations=iterations, scale=fit.scale.tolist(), **counts)
    found = robust_uncertainty(passes, loss, fit)
    return Solution(fit.beta, 1.0 / fit.scale, covariance=found.covariance, degrees=found.degrees, run=run)
