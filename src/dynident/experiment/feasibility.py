"""Free numbers that keep all bounds: random start points by construction, and iterates shrunk until they do."""

from __future__ import annotations

import numpy as np

from dynident.arrays import Array
from dynident.errors import SolverFailed
from dynident.experiment.design_problem import GUARD, DesignProblem

#: Share of its bounds that each joint uses at a start point.
START_USE = 0.8


def feasible_start(problem: DesignProblem, generator: np.random.Generator, attempts: int = 40) -> Array:
    """Return random free numbers (n m,) that keep all bounds, by construction: amplitudes shrink until they do.

    Raises:
        SolverFailed: The torque bounds cannot hold the arm anywhere that was tried.
    """
    count = problem.parametrisation.count
    worst = np.inf
    for _ in range(attempts):
        x = generator.normal(size=(problem.joints, count))
        x[:, 0] = generator.uniform(-0.5, 0.5, problem.joints) * np.where(np.isfinite(problem.limits.reach), 1.0, 0.0)
        flat = (x * (START_USE / problem.kinematic_uses(x.ravel()))[:, None]).ravel()
        for _ in range(12):
            use = problem.torque_use(flat)
            worst = min(worst, use)
            if use <= 1.0 - GUARD:
                return flat
            flat = 0.7 * flat
    evidence = f"every one of {attempts} start points needs at least {worst:.3g} times the torque that is allowed"
    raise SolverFailed("excitation design", evidence, "check masses and effort limits, or give a smaller torque margin")


def shrunk(dense: DesignProblem, x: Array) -> Array | None:
    """Return ``x`` with its amplitudes shrunk until all bounds are kept; None where that fails.

    Position to jerk are trigonometric polynomials of degree H: on N even samples of a period their largest value is at
    least cos(pi H / N) times the true one (Ehlich and Zeller 1964), so these bounds hold between the samples as well.
    The torque keeps :data:`GUARD` free on the grid.

    Args:
        dense: The problem on a fine grid.
        x: Scaled free numbers, shape (n m,).
    """
    between = np.cos(np.pi * dense.parametrisation.harmonics / dense.samples)
    found = x * min(1.0, between / ((1.0 + 1e-12) * float(dense.kinematic_uses(x).max())))
    for _ in range(30):
        if dense.torque_use(found) <= 1.0 - GUARD:
            return found
        found = 0.995 * found
    return None
