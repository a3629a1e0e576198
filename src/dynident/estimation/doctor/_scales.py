"""Another scale for the torque of one joint, and how much better the rows agree under it."""

from __future__ import annotations

import numpy as np

from dynident.estimation.doctor._quick_fit import QuickFit

#: Factors that are tried on the torque of one joint, 1/155 to 155.
FACTORS = 1.4 ** np.arange(-15.0, 16.0)


def best_scale(fit: QuickFit) -> tuple[float, float, str]:
    """Return the gain of the score, the factor and the joint whose torque fits the others best with another scale."""
    best = (0.0, 1.0, "")
    for i, name in enumerate(fit.model.robot.joint_names):
        gain, factor = max(((_gain(fit, i, factor), factor) for factor in FACTORS[::2]), key=lambda trial: trial[0])
        if gain > 0:
            near = FACTORS[np.abs(np.log(FACTORS / factor)) < 0.5]
            gain, factor = max(((_gain(fit, i, factor), factor) for factor in near), key=lambda trial: trial[0])
        best = max(best, (gain, float(factor), name))
    return best


def _gain(fit: QuickFit, joint: int, factor: float) -> float:
    """Return by how much another scale of one torque betters the score, its residual counted in the old scale."""
    mixing = np.eye(fit.model.robot.dof)
    mixing[joint, joint] = factor
    return fit.plain.score - (fit.solve(fit.triangles, mixing).score - 2 * float(np.log(factor)))
