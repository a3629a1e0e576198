"""The search for the best motion: feasible start points, SLSQP with exact gradients, the best iterate kept."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from dynident.arrays import Array
from dynident.errors import SolverFailed
from dynident.experiment.design_problem import GUARD, DesignProblem, Point

#: An iterate may pass a bound on the grid by this share; it is shrunk before it is judged.
_SLACK = 2e-3

#: Share of its bounds that each joint uses at a start point.
START_USE = 0.8

#: Iterations of one stage at most, and the share of the objective below which a stage has converged.
ITERATIONS, CONVERGED = 150, 1e-6


@dataclass(frozen=True)
class SearchState:
    """How far a search is.

    Attributes:
        start: Number of the start, counted from 1.
        starts: Number of starts.
        evaluations: Evaluations so far, over all starts.
        objective: Smoothed objective of the last iterate.
        used: Greatest share of a bound that it uses.
        seconds: Time since the search began.
    """

    start: int
    starts: int
    evaluations: int
    objective: float
    used: float
    seconds: float


class _Stopped(Exception):
    """The time is over, or the solver has lost its way."""


class _Trail:
    """Memory of one search: the last point (SLSQP asks for value and limits apart), and the best near-feasible one."""

    def __init__(self, problem: DesignProblem, deadline: float, report: Callable[[Point], None]) -> None:
        self._problem, self._deadline, self._report = problem, deadline, report
        self.renew(1.0)

    def renew(self, sharpness: float) -> None:
        """Begin a stage."""
        self._sharpness = sharpness
        self._at: Array | None = None
        self._point: Point | None = None
        self.best: Array | None = None
        self._best_objective = np.inf

    def evaluate(self, x: Array) -> Point:
        """Return the point at ``x``, computed once."""
        if self._point is None or self._at is None or not np.array_equal(x, self._at):
            if time.perf_counter() > self._deadline or not np.all(np.isfinite(x)):
                raise _Stopped
            self._at, self._point = x.copy(), self._problem.point(x, self._sharpness)
            self._report(self._point)
            if self._point.used.max() <= 1.0 + _SLACK and self._point.objective < self._best_objective:
                self.best, self._best_objective = self._at, self._point.objective
        return self._point


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


def candidates(
    problem: DesignProblem, start: Array, deadline: float, report: Callable[[Point], None]
) -> Iterator[Array]:
    """Yield free numbers worth a dense look: the start, then the best of each stage; ends early at the deadline."""
    from scipy.optimize import minimize  # loads slowly

    yield start
    trail, x = _Trail(problem, deadline, report), start
    limits: dict[str, Any] = {
        "type": "ineq",
        "fun": lambda x: 1.0 - GUARD - trail.evaluate(x).used,
        "jac": lambda x: -trail.evaluate(x).slopes,
    }
    for sharpness in problem.criterion.stages:
        trail.renew(sharpness)

        def objective(x: Array) -> tuple[float, Array]:
            point = trail.evaluate(x)
            return point.objective, point.gradient

        try:
            found = minimize(
                objective,
                x,
                jac=True,
                method="SLSQP",
                constraints=limits,
                options={"maxiter": ITERATIONS, "ftol": CONVERGED},
            )
        except _Stopped:
            if trail.best is not None:
                yield trail.best
            return
        x = np.asarray(found.x) if trail.best is None else trail.best
        yield x


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
