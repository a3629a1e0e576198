"""How sure a payload is of the drive gains: stated deviations, or how far the joints disagree about the payload.

A gain that is off by a share d scales the payload's torque g_k at its drive. Joints whose gains are off differently
find different payloads, and the residual of the common one shows it: with S the covariance of the rows as
:mod:`dynident.applications.payload.difference_fit` has it, A = G' (S^-1 - S^-1 D H^-1 D' S^-1) G and s = G' S^-1 r
of the residual, s ~ (0, A + v A^2) where the shares d are independent with variance v. v is that of largest restricted
likelihood (Patterson and Thompson 1971); its degrees of freedom are 2 v^2 times its information (Satterthwaite 1946).
What all gains have in common scales the payload unseen: the interval holds it as far as the errors are independent.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.optimize

from dynident.applications.payload.difference_fit import DifferenceSolution, RunPrior
from dynident.arrays import Array
from dynident.identification.problem.problem import Problem
from dynident.identification.residuals.row_passes import RowPasses

#: Largest share by which a gain is taken to be off.
LARGEST = 1.0

#: Below this share of the largest, what the joints say of their gains is nothing.
NOTHING = 1e-9


@dataclass(frozen=True)
class GainDoubt:
    """Doubt about drive gains.

    Attributes:
        deviations: Relative standard deviation of each, shape (n,).
        degrees: Degrees of freedom of their variance; infinite where they were stated.
        covariance: What they add to the unknowns, shape (k, k).
    """

    deviations: Array
    degrees: float
    covariance: Array


@dataclass(frozen=True)
class Scaled:
    """What a larger gain of each drive would add to the rows.

    Attributes:
        products: P = R' W^2 G, shape (b, n).
        inner: G' W^2 G, shape (n, n).
        residual: G' W^2 r of the residual of the fit, shape (n,).
    """

    products: Array
    inner: Array
    residual: Array


def scaled_rows(problem: Problem, passes: RowPasses, weights: Array, torque: Array, residual: Array) -> Scaled:
    """Return what a larger gain of each drive would add, by the payload's own torque.

    The robot's parameters carry the same error as the run, which takes most of the rest away.

    Args:
        problem: The run with the payload.
        passes: Its rows.
        weights: Those of the fit, shape (n,).
        torque: Base parameters of the payload alone, shape (b,).
        residual: What the fit leaves, shape (N, n).
    """
    rows = np.zeros(passes.counting.shape)
    for segment in passes:
        for i, (own, block) in enumerate(zip(passes.columns, segment.blocks, strict=True)):
            rows[segment.samples, i] = torque[own] @ block[:-1]
    rows *= passes.counting
    coupling = np.asarray(problem.model.robot.coupling)
    drives = rows @ np.linalg.inv(coupling)
    added = [drives[:, [k]] * coupling[k] * weights for k in range(len(coupling))]
    products = np.column_stack([passes.products(one * weights) for one in added])
    inner = np.array([[float(np.sum(one * other)) for other in added] for one in added])
    return Scaled(products, inner, np.array([float(np.sum(one * weights * residual)) for one in added]))


def gain_doubt(
    problem: Problem, weights: Array, known: RunPrior, found: DifferenceSolution, scaled: Scaled, stated: Array | None
) -> GainDoubt:
    """Return the doubt about drive gains and what it adds to the unknowns.

    Args:
        problem: The run with the payload.
        weights: Those of the fit, shape (n,).
        known: What was known before.
        found: The fit.
        scaled: What a larger gain would add.
        stated: Relative standard deviations, shape (n,); None: as far as the joints disagree.
    """
    slopes = found.transfer @ scaled.products
    if stated is not None:
        return GainDoubt(stated, np.inf, (slopes * stated**2) @ slopes.T)
    reduced = problem.reduced(weights)
    gram = reduced.r.T @ reduced.r
    share = np.linalg.inv(np.eye(len(gram)) + gram @ known.covariance)
    own = scaled.products.T @ known.covariance @ share @ scaled.products
    met = known.columns.T @ share @ scaled.products
    matrix = scaled.inner - own - met.T @ slopes
    variance, degrees = variance_of_shares(0.5 * (matrix + matrix.T), scaled.residual)
    return GainDoubt(np.full(len(matrix), np.sqrt(variance)), degrees, variance * slopes @ slopes.T)


def variance_of_shares(matrix: Array, score: Array) -> tuple[float, float]:
    """Return v of largest likelihood with s ~ (0, A + v A^2), and its degrees of freedom.

    Args:
        matrix: A, shape (n, n), symmetric; what it does not see counts for nothing.
        score: s, shape (n,).
    """
    values, vectors = np.linalg.eigh(matrix)
    kept = values > NOTHING * max(float(values[-1]), 1e-300)
    values, turned = values[kept], vectors[:, kept].T @ score
    if not len(values):
        return 0.0, np.inf

    def against(root: float) -> float:
        spread = values + root**2 * values**2
        return 0.5 * float(np.sum(np.log(spread) + turned**2 / spread))

    roots = np.r_[0.0, np.geomspace(1e-4, LARGEST, 60)]
    best = int(np.argmin([against(float(root)) for root in roots]))
    ends = (float(roots[max(best - 1, 0)]), float(roots[min(best + 1, len(roots) - 1)]))
    closer: Any = scipy.optimize.minimize_scalar(against, bounds=ends, method="bounded")
    root = float(closer.x)
    root = root if against(root) < against(0.0) else 0.0
    if root == 0.0:
        return 0.0, np.inf
    return root**2, float(np.sum((root**2 / (root**2 + 1.0 / values)) ** 2))
