"""One start of an excitation design: from its random numbers to the motions that keep all bounds, with its news."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from dynident.arrays import Array
from dynident.errors import DynidentError, InfeasibleTrajectory, SolverFailed
from dynident.excitation.design.design_problem import DesignProblem, Point
from dynident.excitation.design.design_search import Trail, candidates
from dynident.excitation.design.feasibility import feasible_start, shrunk
from dynident.excitation.design.finishing import FINER, FinishingCandidate

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
