"""What doubt about drive gains does to base parameters: a gain that is 2 % off moves all that its drive determines.

Of weighted least squares beta = A^-1 sum_j w_j^2 X_j' tau_j with tau = C' K i, the slope by the relative error of gain
k is A^-1 sum_j w_j^2 X_j' C_kj K_k i_k. No residual shows such errors, so they are stated beside the covariance.
"""

from __future__ import annotations

import numpy as np

from dynident.arrays import Array
from dynident.identification.problem.choices import GainUncertainty
from dynident.identification.problem.problem import Problem
from dynident.identification.residuals.row_passes import RowPasses
from dynident.model.reduction import least_squares


def gain_slopes(problem: Problem, weights: Array, passes: RowPasses | None = None) -> Array:
    """Return the slopes of weighted least squares by the relative errors of the gains, shape (b, n).

    Args:
        problem: The problem; its torques are gains times currents.
        weights: Weight of each joint's rows, shape (n,).
        passes: The rows, where they are there already.
    """
    passes = passes or RowPasses(problem)
    coupling = np.asarray(problem.model.robot.coupling)
    torque = np.concatenate([np.asarray(log.log.torque)[log.keep] for log in problem.logs])
    drives = torque @ np.linalg.inv(coupling)
    products = [
        passes.products(drives[:, [k]] * (coupling[k] * np.asarray(weights) ** 2)) for k in range(len(coupling))
    ]
    return least_squares(problem.reduced(weights)).unscaled_covariance @ np.column_stack(products)


def gain_uncertainty(problem: Problem, weights: Array) -> GainUncertainty | None:
    """Return what the stated deviations of the gains add to each base parameter, for the estimate; None without any."""
    joints = problem.model.robot.active
    stated = np.array([joint.drive.gain_deviation for joint in joints])
    if not np.any(stated):
        return None
    added = np.sqrt(np.sum((gain_slopes(problem, weights) * stated) ** 2, axis=1))
    relative = {joint.name: float(value) for joint, value in zip(joints, stated, strict=True)}
    return GainUncertainty(relative, tuple(added.tolist()))
