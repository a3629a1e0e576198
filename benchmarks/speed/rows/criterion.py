"""Value and exact gradient of an excitation criterion, beside forward differences over a loop in Pinocchio.

UR10, 66 free numbers, 200 samples, 48 base columns, condition number of SI columns. The differences take 67 values.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from benchmarks.speed.designs import Loop, ur10_design
from benchmarks.speed.harness import Line, Record
from dynident.arrays import Array
from dynident.excitation.design.design_problem import DesignProblem
from dynident.excitation.design.feasibility import feasible_start

REPEATS, SHARPNESS, STEP = 9, 4.0, 1e-6
HERE, POINT, DIFFERENCES = "value and gradient", "with all bounds and their gradients", "67 values, Pinocchio loop"


def value_and_gradient(problem: DesignProblem, x: Array) -> tuple[float, Array]:
    """Return the smoothed criterion and its derivative by the free numbers, (n m,), without any bound."""
    observation, motion = problem.observation, problem.motion(x)
    rows = observation.rows(motion)
    objective, slope = problem.criterion.objective(observation.information(rows, problem.noise), SHARPNESS)
    by_motion = observation.pullback(motion, observation.by_rows(rows, problem.noise, slope))
    free = sum(part.T @ problem.basis[k] for k, part in enumerate(by_motion))
    return objective, (np.asarray(free) * problem.unit[:, None]).ravel()


def measure() -> Record:
    found = Record("criterion", "UR10, 66 free numbers, 200 samples, 48 base columns, condition number")
    problem = ur10_design()
    x = feasible_start(problem, np.random.default_rng(0))
    calls: dict[str, Callable[[], object]] = {
        HERE: lambda: value_and_gradient(problem, x),
        POINT: lambda: problem.point(x, SHARPNESS),
    }
    if pinocchio := found.peer("pinocchio", "pin"):
        loop = Loop(pinocchio, problem)
        value = problem.figure(problem.motion(x))
        found.agree("condition number, relative", abs(loop.cost(x) / value - 1), 1e-6)
        apart = np.abs(_directions(problem, loop, x)).max()
        found.agree("slopes along 3 directions beside central differences of Pinocchio, relative", apart, 1e-6)
        calls[DIFFERENCES] = lambda: [loop.cost(x + STEP * unit) for unit in np.vstack([0 * x, np.eye(len(x))])]
    found.time(calls, REPEATS)
    found.facts |= {"free numbers": problem.size, "base columns": problem.observation.base.count}
    found.lines = [
        Line("value and exact gradient of the condition number, 200 samples", HERE, DIFFERENCES, 150.0),
        Line("the same, in time", HERE, reach=1e-3),
        Line("the same with 18 bounds and their gradients, as the search asks", POINT, DIFFERENCES),
    ]
    return found


def _directions(problem: DesignProblem, loop: Loop, x: Array) -> Array:
    """Return how far our slopes along random directions are from central differences, relative."""

    def smoothed(at: Array) -> float:
        matrix = loop.matrix(problem.motion(at)).reshape(-1, loop.base.count)
        return problem.criterion.objective(matrix.T @ matrix / problem.samples, SHARPNESS)[0]

    _, gradient = value_and_gradient(problem, x)
    ways = np.random.default_rng(1).normal(size=(3, len(x)))
    ways /= np.linalg.norm(ways, axis=1)[:, None]
    slopes = [(smoothed(x + 1e-5 * way) - smoothed(x - 1e-5 * way)) / 2e-5 for way in ways]
    return (ways @ gradient - slopes) / np.linalg.norm(gradient)
