"""The payload as a difference: torques of a run with it less what the robot without it is known to need.

With beta and C the robot's parameters and their covariance, z - R beta (R'R = N of the weighted rows) is
R (D x + e) + noise: D = [B, F] carries the payload's ten and the change of friction x, e ~ (0, C) is the robot's own
error. Generalised least squares with S = I + R C R' gives x = H^-1 D' E (R'z - N beta), E = (I + N C)^-1 and
H = D' E N D. Its error is T (sum_j w_j^2 X_j' v_j - N e) with T = H^-1 D' E: noise as coloured as it is, and the
robot's covariance (Swevers, Verdonck and De Schutter 2007 state the difference; the weights are those of Aitken).

C is an estimate, and T is the best for it: T N C N T' is too small by 2 E[T N d Q d N T'] with d the error of C and
Q = E N (I - D T N) (Kenward and Roger 1997). For a Wishart covariance of f degrees of freedom that is
2 (T N C Q C N T' + tr(Q C) T N C N T') / f.

A payload that is not there all along: parts of the logs have loads of their own beside the one that is found of all.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dynident.arrays import Array, BoolArray
from dynident.identification.problem.problem import Problem
from dynident.identification.residuals.bands import bands
from dynident.identification.residuals.coloured import Influence, uncertainty_of
from dynident.identification.residuals.row_passes import RowPasses

#: Singular value, of unknowns in natural sizes, below this share of the largest: not determined.
NULL = 1e-7

#: Share of an unknown that may lie in what the rows do not determine before it counts as not determined.
OPEN = 1e-6


@dataclass(frozen=True)
class RunPrior:
    """What is known before the run with the payload.

    Attributes:
        beta: Base parameters of the robot without it, shape (b,).
        covariance: Their covariance, shape (b, b).
        degrees: Its degrees of freedom; infinite where it is no estimate.
        columns: D, what a unit of each unknown adds to the base parameters, shape (b, k).
        sizes: Natural size of each unknown, shape (k,).
        means: What is known of the unknowns, shape (k,).
        deviations: How well, shape (k,); infinite where nothing is known.
    """

    beta: Array
    covariance: Array
    degrees: float
    columns: Array
    sizes: Array
    means: Array
    deviations: Array


@dataclass(frozen=True)
class DifferenceSolution:
    """The unknowns of a run and how sure they are.

    Attributes:
        x: Shape (k,); 0 where open.
        open: Which the rows do not determine, shape (k,).
        transfer: T, shape (k, b).
        change: What the run adds to the robot's base parameters by the best judgement, shape (b,).
        respond: Q with change = Q (R'z - N beta) but for what is known beforehand, shape (b, b).
        gain: By how much the unknowns lower the weighted squares, those of the robot's own error among them.
        by_robot: Covariance by the robot's own, with what weights made of an estimate of it miss, shape (k, k).
        by_known: By what is known beforehand, one part per unknown, shape (k, k, k): the first index is the unknown.
    """

    x: Array
    open: BoolArray
    transfer: Array
    change: Array
    respond: Array
    gain: float
    by_robot: Array
    by_known: Array


def fit_difference(problem: Problem, weights: Array, known: RunPrior) -> DifferenceSolution:
    """Return the unknowns of a run with one weight a joint.

    Args:
        problem: The run; its rows need not determine the robot.
        weights: Of each joint's rows, so that they count as what they are worth, shape (n,).
        known: What is known before.
    """
    reduced = problem.reduced(weights)
    gram = reduced.r.T @ reduced.r
    size = len(gram)
    share = np.linalg.inv(np.eye(size) + gram @ known.covariance)
    product = reduced.r.T @ reduced.z - gram @ known.beta
    informed = np.where(np.isfinite(known.deviations), known.deviations, np.inf) ** -2.0
    scaled = known.columns * known.sizes
    inner = scaled.T @ share @ gram @ scaled
    matrix = 0.5 * (inner + inner.T) + np.diag(informed * known.sizes**2)
    values, vectors = np.linalg.eigh(matrix)
    kept = values > NULL**2 * values[-1]
    turned = vectors[:, kept]
    open_ = np.sum(vectors[:, ~kept] ** 2, axis=1) > OPEN
    inverse = (turned / values[kept]) @ turned.T * known.sizes * known.sizes[:, None]
    transfer = inverse @ known.columns.T @ share
    x = transfer @ product + inverse @ (informed * known.means)
    gain = float((known.columns.T @ share @ product + informed * known.means) @ x)
    own = known.covariance @ share
    respond = known.columns @ transfer + own @ (np.eye(size) - gram @ known.columns @ transfer)
    change = known.columns @ x + own @ (product - gram @ known.columns @ x)
    told = np.einsum("ik,jk,k->kij", inverse, inverse, informed)
    lever = transfer @ gram
    spread, left = lever @ known.covariance, share @ gram @ (np.eye(size) - known.columns @ lever)
    by_robot = spread @ lever.T
    missed = spread @ left @ spread.T + float(np.sum(left * known.covariance)) * by_robot
    by_robot = by_robot + (missed + missed.T) / known.degrees
    return DifferenceSolution(np.where(open_, 0.0, x), open_, transfer, change, respond, gain, by_robot, told)


def noise_covariance(
    problem: Problem, passes: RowPasses, weights: Array, found: DifferenceSolution, residual: Array
) -> tuple[Array, Array]:
    """Return the covariance of the unknowns by the noise of a motion, (k, k), and its degrees of freedom, (k,).

    Args:
        problem: The run.
        passes: Its rows.
        weights: Those of the fit, shape (n,).
        found: The fit.
        residual: What it leaves, shape (N, n).
    """
    influence = Influence.of_rows(problem, residual, found.respond, weights**2)
    asked = (weights**2)[:, None, None] * found.transfer
    noise = uncertainty_of(bands(passes), residual, influence, asked)
    return noise.covariance, noise.degrees


def independent_covariance(problem: Problem, weights: Array, found: DifferenceSolution, deviations: Array) -> Array:
    """Return the covariance of the unknowns by noise of rows that are independent, as those of postures are, (k, k).

    Args:
        problem: The run.
        weights: Those of the fit, shape (n,).
        found: The fit.
        deviations: Standard deviation of each joint's rows, shape (n,).
    """
    root = problem.reduced(weights**2 * deviations).r @ found.transfer.T
    return root.T @ root


#: Parts of each log that are compared.
_PARTS = 16

#: Standard deviation of the load of a part, as a share of the load, from which the part does not count.
_TOO_VAGUE = 0.25

#: Difference between two parts as a share of the load from which it is one: a load that is put down makes at least the
#: whole of what is found; and in standard deviations.
_LEAST, _CERTAIN = 0.75, 6.0


def load_of_parts(
    mass: float, carried: Sequence[Array], left: Sequence[Array], weights: Array
) -> tuple[float, float] | None:
    """Return the least and the largest load of parts of some logs, where these differ by as much as a load put down.

    Of each part the share of the torque of the payload is found that the residual has beside it, by weighted least
    squares; with all other parameters as found of all logs.

    Args:
        mass: Mass of the payload of all logs, in kg.
        carried: Torque of that payload along each log, shape (N, n), in N m or N; 0 where a row does not count.
        left: What is left of the torques with it, shape (N, n).
        weights: One over the standard deviation of independent rows of each joint, shape (n,).

    Returns:
        Both in kg, below 0 as noise has it; None where the load may be one.
    """
    parts = [
        (torque[part], rest[part])
        for torque, rest in zip(carried, left, strict=True)
        for part in np.array_split(np.arange(len(torque)), _PARTS)
    ]
    shares, _ = _shares(parts, weights)
    before = sum(np.sum(rest**2, axis=0) for _, rest in parts)
    after = sum(np.sum((rest - k * own) ** 2, axis=0) for k, (own, rest) in zip(shares, parts, strict=True))
    # what the change itself has left is no noise
    shares, deviations = _shares(parts, weights * np.sqrt(before / np.maximum(after, 1e-6 * before + 1e-300)))
    counts = np.flatnonzero(deviations < _TOO_VAGUE)
    if len(counts) < 2 or mass <= 0:
        return None
    low, high = counts[np.argmin(shares[counts])], counts[np.argmax(shares[counts])]
    apart, deviation = shares[high] - shares[low], np.hypot(deviations[low], deviations[high])
    loads = (mass * (1.0 + float(shares[low])), mass * (1.0 + float(shares[high])))
    return loads if apart > max(_LEAST, _CERTAIN * deviation) else None


def _shares(parts: Sequence[tuple[Array, Array]], weights: Array) -> tuple[Array, Array]:
    """Return the share of the payload that each part has beside it, and its standard deviation."""
    sizes = np.array([np.sum((weights * own) ** 2) for own, _ in parts])
    sizes = np.maximum(sizes, 1e-300)
    return np.array([np.sum(weights**2 * own * rest) for own, rest in parts]) / sizes, 1.0 / np.sqrt(sizes)
