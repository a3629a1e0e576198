"""The search for an excitation: a UR10 to a condition number of 30 (SI columns) within limits to q, dq and ddq.

Beside it: SLSQP on the condition number itself with forward differences over a loop in Pinocchio, one constraint for
each bound (the literature's route), from the same start. The time is that of the processor until an iterate is first as
good and keeps its bounds, both judged on 2000 samples. One start in four ends above the goal here, so that the next one
is taken, as the tool does, and the time goes on; the peer is still at its first when its time is over.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Iterable
from dataclasses import replace

import numpy as np
from scipy.optimize import minimize

from benchmarks.speed.designs import Loop, ur10_design
from benchmarks.speed.harness import Line, Record, Times
from dynident.arrays import Array
from dynident.excitation.design.design_problem import GUARD, DesignProblem
from dynident.excitation.design.feasibility import feasible_start
from dynident.excitation.design.start import Trail, candidates

SEEDS, GOAL, SLACK, CAP = (0, 1), 30.0, 2e-3, 60.0
HERE, DIFFERENCES = "SLSQP, exact gradients, p-norm", "SLSQP, differences over a Pinocchio loop"


class _Enough(Exception):
    """The goal is reached, or the time is over."""


def measure() -> Record:
    found = Record("excitation", f"UR10, 66 free numbers, 10 s, to a condition number of {GOAL:g}, {len(SEEDS)} seeds")
    problem = ur10_design()
    dense = replace(problem, samples=10 * problem.samples)
    starts = {seed: feasible_start(problem, np.random.default_rng(seed)) for seed in SEEDS}
    list(candidates(problem, starts[0], Trail(time.perf_counter() + 1.0, lambda *_: None)))  # compiles
    pinocchio = found.peer("pinocchio", "pin")
    reached: dict[str, list[float]] = {HERE: [], DIFFERENCES: []}
    outcome = []
    for seed, start in starts.items():
        moment, best, taken = until_reached(problem, dense, seed)
        reached[HERE].append(moment)
        line = {"seed": seed, "here_reached_s": moment, "here_best": best, "here_starts": taken}
        if pinocchio:
            moment, best, whole = _differences(Loop(pinocchio, problem), dense, start)
            reached[DIFFERENCES].append(moment)
            line |= {"peer_reached_s": moment, "peer_best": best, "peer_whole_s": whole}
        outcome.append(line)
    found.facts["seeds"] = [{key: _known(value) for key, value in line.items()} for line in outcome]
    found.agree("here: seeds that do not reach the goal", sum(not np.isfinite(t) for t in reached[HERE]), 0)
    # A peer that had not reached the goal counts with the time it was given: a lower bound of the ratio.
    for name, values in reached.items():
        if values:
            given = [line["peer_whole_s"] if np.isinf(t) else t for t, line in zip(values, outcome, strict=True)]
            found.times[name] = Times(given, given)
    found.facts["here_median_best"] = statistics.median(line["here_best"] for line in outcome)
    never = pinocchio and not np.isfinite(reached[DIFFERENCES]).any()
    word = f", where the peer did not get in {CAP:g} s" if never else ""
    work = f"excitation of a UR10 to a condition number of {GOAL:g}{word}"
    found.lines = [Line(work, HERE, DIFFERENCES, 100.0)]
    return found


def _known(value: float) -> float | None:
    return value if np.isfinite(value) else None


def until_reached(problem: DesignProblem, dense: DesignProblem, seed: int) -> tuple[float, float, int]:
    """Return when the goal was reached, the best condition number of that start, and how many starts were taken.

    The starts of a seed are drawn one after another, and the first is the one that the peer has.
    """
    generator, spent, taken = np.random.default_rng(seed), 0.0, 0
    while spent < CAP:
        taken += 1
        moment, best, whole = design(problem, dense, feasible_start(problem, generator))
        if np.isfinite(moment):
            return spent + moment, best, taken
        spent += whole
    return np.inf, np.inf, taken


def design(problem: DesignProblem, dense: DesignProblem, start: Array) -> tuple[float, float, float]:
    """Return when the goal was reached, the best condition number and the whole time."""
    seen: list[tuple[float, Array]] = []
    began = time.process_time()
    trail = Trail(np.inf, lambda x, point: seen.append((time.process_time() - began, x)))
    list(candidates(problem, start, trail))
    whole = time.process_time() - began
    return (*_judged(dense, seen), whole)


def _differences(loop: Loop, dense: DesignProblem, start: Array) -> tuple[float, float, float]:
    """Return the same of the literature's route, which is stopped at the goal or after CAP seconds."""
    seen: list[tuple[float, Array]] = []
    began = time.process_time()

    def room(x: Array) -> Array:
        grid = loop.problem.grid(x)
        return 1.0 - GUARD - np.concatenate([bound.shares(grid).max(axis=1) for bound in loop.problem.bounds])

    def note(x: Array) -> None:
        seen.append((time.process_time() - began, x.copy()))
        if time.process_time() - began > CAP or (loop.cost(x) <= 0.98 * GOAL and room(x).min() >= 0.0):
            raise _Enough

    limits = {"type": "ineq", "fun": room}
    try:
        minimize(loop.cost, start, method="SLSQP", constraints=limits, callback=note, options={"maxiter": 300})
    except _Enough:
        pass
    whole = time.process_time() - began
    return (*_judged(dense, seen), whole)


def _judged(dense: DesignProblem, seen: Iterable[tuple[float, Array]]) -> tuple[float, float]:
    """Return when an iterate first kept its bounds and the goal, infinite if never, and the best one's figure."""
    moment, best = np.inf, np.inf
    for when, x in seen:
        grid = dense.grid(x)
        if max(bound.shares(grid).max() for bound in dense.bounds) > 1.0 + SLACK:
            continue
        value = dense.figure(dense.motion(x))
        best = min(best, value)
        if value <= GOAL:
            moment = min(moment, when)
    return moment, best
