"""Total least squares."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from dynident.arrays import Array, BoolArray
from dynident.errors import BadOption, SolverFailed
from dynident.identification.estimators.wls import WLS
from dynident.identification.problem.estimator import Estimator, Solution
from dynident.identification.problem.method_run import MethodRun
from dynident.identification.problem.problem import Problem, check_rank
from dynident.identification.residuals.bands import bands
from dynident.identification.residuals.coloured import Influence, uncertainty_of
from dynident.identification.residuals.row_passes import RowPasses
from dynident.model.reduction import triangle_of


@dataclass(frozen=True, kw_only=True)
class TotalLeastSquaresRun(MethodRun):
    """Error of the torque; error as a share of the weakest columns, useless near 1; columns without error."""

    relative_error: float
    removed: float
    exact: Sequence[str]


@dataclass(frozen=True)
class TLS(Estimator):
    """Total least squares: errors in the regressor as well as in the torques (Golub and Van Loan 1980).

    Columns that stay the same at every row, those of ``offset``, are exact: mixed LS-TLS (Van Huffel and Vandewalle
    1991, section 3.6.3). Rows are weighed as by ``wls``, columns and torque are scaled to unit norm, and each is taken
    to have an error of a share of its norm, the same for all noisy columns, independent of each other and from row to
    row. Columns made of filtered positions are not like that: their errors hang together across columns and time. With
    a ratio too large the estimate is worse than that of ``wls``; instruments (``iv``) need no such assumption.

    Attributes:
        ratio: Relative error of the columns over that of the torque; 0 is weighted least squares.
    """

    allows_for_noise: ClassVar[bool] = True

    ratio: float = 1.0

    def __post_init__(self) -> None:
        if not 0 <= self.ratio <= 1e3:
            raise BadOption(
                "ratio", self.ratio, "give a relative error of the columns over that of the torque, 0 to 1000"
            )

    def solve(self, problem: Problem) -> Solution:
        """Return the estimate.

        Raises:
            PoorExcitation: The rows do not determine all base parameters.
            SolverFailed: The smallest singular value belongs to the columns, not to the torque (nongeneric).
        """
        weights = WLS().solve(problem).weights
        reduced = problem.reduced(weights)
        check_rank(reduced, problem.base)
        exact = constant_columns(problem)
        norms = reduced.column_norms
        size = float(np.sqrt(reduced.z @ reduced.z + reduced.rest))
        scaled, target = reduced.r / norms, reduced.z / size
        share = smallest_error(scaled, target, np.sqrt(reduced.rest) / size, exact, self.ratio)
        removed = np.where(exact, 0.0, (self.ratio * share) ** 2)
        gram = scaled.T @ scaled
        inverse = np.linalg.inv(gram - np.diag(removed))
        lost = float(1.0 - np.linalg.eigvalsh(gram - np.diag(removed))[0] / np.linalg.eigvalsh(gram)[0])
        beta = inverse @ (scaled.T @ target) * size / norms
        passes = RowPasses(problem)
        residual = passes.residuals(beta)  # first order of the corrected normal equations: Fuller 1987, section 2.2
        influence = Influence.of_rows(problem, residual, inverse / norms / norms[:, None], weights**2)
        found = uncertainty_of(bands(passes), residual, influence)
        names = [name for name, known in zip(problem.base.names, exact, strict=True) if known]
        run = TotalLeastSquaresRun(relative_error=share, removed=lost, exact=names)
        return Solution(beta, weights, covariance=found.covariance, degrees=found.degrees, run=run)


def constant_columns(problem: Problem) -> BoolArray:
    """Return which base parameters belong to a friction part whose column never changes, shape (b,)."""
    model, base = problem.model, problem.base
    values = model.friction_values(model.random_motion(20)).reshape(20, -1)
    constant = np.concatenate([np.zeros(model.inertial_count, bool), np.ptp(values, axis=0) == 0.0])
    return constant[base.independent]


def smallest_error(scaled: Array, target: Array, rest: float, exact: BoolArray, ratio: float) -> float:
    """Return the smallest relative error s of the torque such that columns off by ratio s times their norm fit it.

    It is the smallest singular value of [W2 / ratio, tau2], the noisy columns and the torque less what the exact
    columns explain of them.

    Args:
        scaled: R with unit columns, shape (b, b).
        target: z over the norm of the torque, shape (b,).
        rest: Norm of the residual over that of the torque.
        exact: Which columns have no error, shape (b,).
        ratio: Relative error of the columns over that of the torque.
    """
    order = np.concatenate([np.flatnonzero(exact), np.flatnonzero(~exact)])
    known = int(exact.sum())
    full = np.zeros((len(target) + 1,) * 2)
    full[:-1, :-1], full[:-1, -1], full[-1, -1] = scaled[:, order], target, rest
    left = triangle_of(full)[known:, known:]
    if ratio == 0.0 or left.shape[1] == 1:
        return abs(float(left[-1, -1]))
    noisy = left[:, :-1] / ratio
    own = np.linalg.svd(noisy, compute_uv=False)[-1]
    smallest = float(np.linalg.svd(np.column_stack([noisy, left[:, -1]]), compute_uv=False)[-1])
    if not smallest < 0.999 * own:
        raise SolverFailed(
            "total least squares",
            f"a combination of columns is as small ({own:.2g} of their norm) as the residual ({smallest:.2g})",
            "give a smaller ratio, record a motion with a lower condition number, or use wls",
        )
    return smallest
