"""The search for the best motion: SLSQP with exact gradients from each start, the best iterates kept."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from dynident.arrays import Array
from dynident.experiment.design_problem import GUARD, DesignProblem, Point

#: An iterate may pass a bound on the grid by this share; it is shrunk before it is judged.
_SLACK = 2e-3

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
