"""One start of an excitation design: SLSQP from random numbers to the motions that keep all bounds."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from dynident.arrays import Array
from dynident.errors import DynidentError, InfeasibleTrajectory, SolverFailed
from dynident.excitation.design.design_problem import GUARD, DesignProblem, Point
from dynident.excitation.design.feasibility import feasible_start, shrunk
from dynident.excitation.design.finishing import FINER, FinishingCandidate
from dynident.model.threads import one_blas_thread

#: Time in s between two news of one start.
PAUSE = 0.2

#: The bounds of a motion do not depend on how sharp the objective is.
_ANY_SHARPNESS = 4.0


@dataclass(frozen=True)
class News:
    """How far one start is.

    Attributes:
        start: Number of the start, counted from 1.
        evaluations: Evaluations of this start so far.
        objective: Smoothed objective of the last iterate.
        used: Greatest share of a bound that the last iterate uses.
        worst: What that bound is about, such as ``torque of joint2``.
        figure: The criterion itself at the best iterate of this start so far that keeps its bounds on the grid; NaN
            before there is one.
    """

    start: int
    evaluations: int
    objective: float
    used: float
    worst: str
    figure: float


@dataclass(frozen=True)
class StartResult:
    """What one start found.

    Attributes:
        start: Number of the start, counted from 1.
        candidates: Motions that keep all bounds, as they were found.
        evaluations: Evaluations of objective and bounds.
        whole: Whether it ended by itself; a time limit did not cut it.
        failure: Why it found no feasible motion to begin with; None where it did.
        used: Greatest share of a bound that the best candidate uses on the fine grid; 0 where that is not known.
        worst: What that bound is about; empty where that is not known.
    """

    start: int
    candidates: tuple[FinishingCandidate, ...]
    evaluations: int
    whole: bool
    failure: DynidentError | None = None
    used: float = 0.0
    worst: str = ""


def run_start(
    problem: DesignProblem, number: int, seed: int, seconds: float, tell: Callable[[News], None]
) -> StartResult:
    """Return what start ``number`` of a seed finds; the same whatever the other starts do and wherever it runs.

    Args:
        problem: Criterion and limits.
        number: Number of the start, counted from 1.
        seed: Of all starts.
        seconds: Time after which the best so far is taken; the start point itself is always found.
        tell: Called with the news now and then; what it raises ends the start.
    """
    deadline = time.perf_counter() + seconds
    generator = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(number - 1,)))
    try:
        start = feasible_start(problem, generator)
    except (InfeasibleTrajectory, SolverFailed) as error:
        return StartResult(number, (), 0, True, error)
    reporter = _Reporter(problem, number, tell)
    trail = Trail(deadline, reporter)
    dense = replace(problem, samples=FINER * problem.samples)
    sign = -1.0 if problem.criterion.larger_is_better else 1.0
    found = []
    for x in candidates(problem, start, trail):
        kept = shrunk(dense, x)
        figure = np.inf if kept is None else sign * dense.figure(dense.motion(kept))
        if kept is not None and np.isfinite(figure):
            found.append(FinishingCandidate(kept, figure, number))
            reporter.keep(sign * figure)
    result = StartResult(number, tuple(found), reporter.evaluations, not trail.cut)
    if not found:
        return result
    used, words = _nearest_bound(dense, min(found, key=lambda one: one.figure).free)
    return replace(result, used=used, worst=words)


def _nearest_bound(problem: DesignProblem, x: Array) -> tuple[float, str]:
    """Return the greatest share of a bound that a motion uses, and what that bound is about."""
    return _worst(problem, problem.point(x, _ANY_SHARPNESS))


def _worst(problem: DesignProblem, point: Point) -> tuple[float, str]:
    worst = int(np.argmax(point.used))
    label = problem.labels[worst]
    return float(point.used[worst]), f"{label.quantity} of {label.owner}"


class _Reporter:
    """Counts evaluations and tells the news of a start, not too often."""

    def __init__(self, problem: DesignProblem, number: int, tell: Callable[[News], None]) -> None:
        self._problem, self._number, self._tell = problem, number, tell
        self.evaluations, self._figure, self._next = 0, np.nan, 0.0

    def __call__(self, x: Array, point: Point) -> None:
        self.evaluations += 1
        now = time.perf_counter()
        if now < self._next:
            return
        self._next = now + PAUSE
        if point.used.max() <= 1.0:
            self.keep(self._problem.figure(self._problem.motion(x)))
        used, words = _worst(self._problem, point)
        self._tell(News(self._number, self.evaluations, point.objective, used, words, self._figure))

    def keep(self, figure: float) -> None:
        """Keep the better of two figures."""
        best = max if self._problem.criterion.larger_is_better else min
        if np.isfinite(figure):
            self._figure = figure if np.isnan(self._figure) else best(self._figure, figure)


#: Free numbers beyond this size are no motion, and the squares of what they make overflow.
BEYOND = 1e8

#: An iterate may pass a bound on the grid by this share; it is shrunk before it is judged.
_SLACK = 2e-3

#: Iterations of one stage at most.
ITERATIONS = 200

#: A stage has converged when the objective changes by less: the first one, those between, the last one.
CONVERGED = (1e-3, 1e-4, 1e-5)

#: Length of the gradient at the first point of a stage, which is the length of the first step that SLSQP tries: longer
#: ones leave the neighbourhood in which slopes of torques and clearances mean something, and some never come back. The
#: next one is for runs that did not.
FIRST_STEPS = (0.2, 0.05, 0.01)

#: After so many evaluations in a row that use more than this share of a bound a run is given up.
PATIENCE, FAR = 20, 3.0

#: What a search reports at every evaluation: the free numbers and their point.
Report = Callable[[Array, Point], None]


class _Stopped(Exception):
    """The time is over, or the solver has lost its way."""


class _Lost(Exception):
    """The solver has left the neighbourhood of all that is allowed."""


class Trail:
    """Memory of one search: the last point (SLSQP asks for value and limits apart), and the best near-feasible one.

    Attributes:
        best: The best free numbers of the stage, shape (n m,); None before there are any.
        best_objective: Their objective.
        cut: Whether the time ended the search.
    """

    def __init__(self, deadline: float, report: Report) -> None:
        self._deadline, self._report = deadline, report
        self.cut = False

    def renew(self, problem: DesignProblem, sharpness: float) -> None:
        """Begin a stage."""
        self._problem, self._sharpness, self._away = problem, sharpness, 0
        self._at: Array | None = None
        self._point: Point | None = None
        self.best: Array | None = None
        self.best_objective = np.inf

    def evaluate(self, x: Array) -> Point:
        """Return the point at ``x``, computed once."""
        if self._point is None or self._at is None or not np.array_equal(x, self._at):
            self.cut = time.perf_counter() > self._deadline
            if self.cut or not np.all(np.isfinite(x)):
                raise _Stopped
            if np.abs(x).max(initial=0.0) > BEYOND:
                raise _Lost
            self._at, self._point = x.copy(), self._problem.point(x, self._sharpness)
            self._report(self._at, self._point)
            self._away = self._away + 1 if self._point.used.max() > FAR else 0
            if self._away > PATIENCE:
                self._away, self._at = 0, None
                raise _Lost
            if self._point.used.max() <= 1.0 + _SLACK and self._point.objective < self.best_objective:
                self.best, self.best_objective = self._at, self._point.objective
        return self._point


def candidates(problem: DesignProblem, start: Array, trail: Trail) -> Iterator[Array]:
    """Yield free numbers worth a dense look: the start, then the best of each stage; ends early at the deadline.

    The stages before the last one look at half the samples: they only lead to the valley. A criterion of one stage has
    one such stage before it.
    """
    yield start
    x, size = start, authority(problem)
    for grid, sharpness, converged in _stages(problem):
        trail.renew(grid, sharpness)
        try:
            x = _descend(trail, x, size, converged)
        except _Stopped:
            if trail.best is not None:
                yield trail.best
            return
        yield x


def authority(problem: DesignProblem) -> Array:
    """Return how far each scaled free number alone can go within position to jerk, shape (n m,): the unit of SLSQP.

    Without it the high harmonics, which reach their bounds first, set the length of every step.
    """
    peaks = np.abs(problem.basis).max(axis=1)
    moves = peaks > 1e-9 * peaks.max(axis=1, keepdims=True)  # the constant has no speed
    shares = problem.limits.bounds()[:, :, None] / np.where(moves, peaks, 1.0)[:, None, :]
    reach = np.where(moves[:, None, :], shares, np.inf).min(axis=0)
    return (np.where(np.isfinite(reach), reach, problem.unit[:, None]) / problem.unit[:, None]).ravel()


def _stages(problem: DesignProblem) -> Iterator[tuple[DesignProblem, float, float]]:
    """Yield the problem, the sharpness and the change that ends the stage."""
    given = problem.criterion.stages
    sharpness = given if len(given) > 1 else given * 2
    coarse = replace(problem, samples=max(problem.samples // 2, 4 * problem.parametrisation.harmonics + 1))
    for k, one in enumerate(sharpness):
        last = k == len(sharpness) - 1
        yield problem if last else coarse, one, CONVERGED[2 if last else min(k, 1)]


def _descend(trail: Trail, start: Array, size: Array, converged: float) -> Array:
    """Return the best free numbers of a stage, from the first run of SLSQP that finds better ones than the start."""
    before = trail.evaluate(start).objective
    for step in FIRST_STEPS:
        try:
            _slsqp(trail, start if trail.best is None else trail.best, size, converged, step)
        except _Lost:
            continue
        if trail.best is not None and trail.best_objective < before:
            break
    return start if trail.best is None else trail.best


def _slsqp(trail: Trail, start: Array, size: Array, converged: float, step: float) -> None:
    """Run SLSQP; the trail keeps the best."""
    from scipy.optimize import minimize  # loads slowly

    length = float(np.linalg.norm(trail.evaluate(start).gradient * size))
    scale = min(1.0, step / length) if length > 0 else 1.0

    def objective(y: Array) -> tuple[float, Array]:
        point = trail.evaluate(y * size)
        return scale * point.objective, scale * point.gradient * size

    limits: dict[str, Any] = {
        "type": "ineq",
        "fun": lambda y: 1.0 - GUARD - trail.evaluate(y * size).used,
        "jac": lambda y: -trail.evaluate(y * size).slopes * size,
    }
    options = {"maxiter": ITERATIONS, "ftol": scale * converged}
    with one_blas_thread():  # SciPy may have been loaded just now; on several threads the search would go another way
        minimize(objective, start / size, jac=True, method="SLSQP", constraints=limits, options=options)
