"""From free numbers to a plan: the run-in that starts it from rest, the dense check, the figures of all criteria."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from dynident.arrays import Array
from dynident.errors import InfeasibleTrajectory
from dynident.excitation.criteria import CRITERIA
from dynident.excitation.design.bounds import BoundLabel
from dynident.excitation.design.design_problem import GUARD, DesignProblem
from dynident.excitation.design.limits import LimitRow, MotionLimits, check_limits, worst_row
from dynident.excitation.design.plan import Plan
from dynident.excitation.design.rest_to_rest import RestToRest
from dynident.excitation.trajectories.base import Designable
from dynident.model.friction import Motion

#: The check before a plan is made is this much finer than the grid of the search.
FINER = 10

#: Run-ins in s that are tried, and phases of the period at which a motion may begin.
RUN_INS, PHASES = (0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0), 24


#: Samples of a run-in: a quintic rises between them by less than GUARD above the larger one.
_RUN_IN_SAMPLES = 201


@dataclass(frozen=True)
class FinishingCandidate:
    """Free numbers that keep all bounds within the period, their figure and the start they come from."""

    free: Array
    figure: float
    start: int
    trajectory: Designable | None = None
    run_in: float = 0.0


def first_that_starts(problem: DesignProblem, found: list[FinishingCandidate]) -> FinishingCandidate:
    """Return the best candidate that can be driven from rest to rest, with its phase and run-in.

    Raises:
        InfeasibleTrajectory: No run-in keeps the limits.
    """
    broken: list[LimitRow] = []
    for candidate in found:
        motion = problem.parametrisation.trajectory(problem.free(candidate.free))
        if motion.at_rest:
            return replace(candidate, trajectory=motion)
        limits = _no_harsher(problem.limits, motion, FINER * problem.samples)
        for run_in in RUN_INS:
            for phase in np.arange(PHASES) / PHASES * motion.period:
                turned = motion.shifted(float(phase))
                worst = _broken(problem, limits, RestToRest(turned, run_in))
                if worst is None:
                    return replace(candidate, trajectory=turned, run_in=run_in)
                broken.append(worst)
    worst = min(broken, key=lambda row: row.used)
    evidence = f"no run-in of up to {RUN_INS[-1]:g} s keeps it; the best one uses {100 * worst.used:.4g} % of it"
    step = "design a rest_fourier or a bspline, which need no run-in"
    raise InfeasibleTrajectory(f"the {BoundLabel(worst.joint, worst.quantity).text}", evidence, step)


def _no_harsher(limits: MotionLimits, motion: Designable, samples: int) -> MotionLimits:
    """Return the limits with the motion's own largest acceleration and jerk where none are stated."""
    time = np.arange(samples) * motion.period / samples
    acceleration, jerk = (np.abs(s).max(axis=0) * 1.001 for s in (motion.evaluate(time)[2], motion.jerk(time)))
    return replace(
        limits,
        acceleration=np.where(np.isfinite(limits.acceleration), limits.acceleration, acceleration),
        jerk=np.where(np.isfinite(limits.jerk), limits.jerk, jerk),
    )


def _broken(problem: DesignProblem, limits: MotionLimits, driven: RestToRest) -> LimitRow | None:
    """Return the worst row of a motion that breaks its limits; what needs no model is looked at first.

    Run-in and run-out keep :data:`GUARD` free, for what happens between their samples; the motion has been shrunk so
    that it keeps its bounds at every time.
    """
    tight = _tightened(limits, 1.0 - GUARD)
    for part in (driven.enter, driven.leave):
        worst = worst_row(check_limits(part, tight, _RUN_IN_SAMPLES))
        if not worst.kept:
            return worst
    samples = _check_samples(problem, driven)
    for model in ({}, _model_checks(problem)):
        worst = worst_row(check_limits(driven, limits, samples, **model))
        if not worst.kept:
            return worst
    return None


def _tightened(limits: MotionLimits, share: float) -> MotionLimits:
    """Return the limits on position to jerk, multiplied by a share about the middle of the ranges."""
    spare = np.where(np.isfinite(limits.reach), (1.0 - share) * limits.reach, 0.0)
    largest = {name: share * getattr(limits, name) for name in ("velocity", "acceleration", "jerk")}
    return replace(limits, lower=limits.lower + spare, upper=limits.upper - spare, **largest)


def _check_samples(problem: DesignProblem, driven: RestToRest) -> int:
    """Return the number of samples of the check, both ends included."""
    return int(np.ceil(driven.duration * FINER * problem.samples / driven.core.duration)) + 1


def checked_plan(problem: DesignProblem, best: FinishingCandidate, noise: Array) -> Plan:
    """Check the motion densely from rest to rest and put the plan together, settings left empty."""
    motion = best.trajectory
    assert motion is not None
    driven = RestToRest(motion, best.run_in)
    samples = _check_samples(problem, driven)
    rows = check_limits(driven, problem.limits, samples, **_model_checks(problem))
    grid = Motion(*motion.evaluate(np.arange(FINER * problem.samples) * motion.period / (FINER * problem.samples)))
    triangles = {
        weighted: problem.observation.triangle(grid, noise if weighted else np.ones(len(noise)))
        for weighted in (False, True)
    }
    values: dict[str, float] = {}
    for name in CRITERIA.names():
        part = CRITERIA.make(name)
        values[name] = part.value(triangles[part.weighted])
    chosen = CRITERIA.name_of(problem.criterion)
    values[chosen] = problem.figure(grid)
    robot = problem.observation.model.robot.name
    return Plan(robot, motion, best.run_in, chosen, values, problem.limits, rows, samples, {})


def _model_checks(problem: DesignProblem) -> dict[str, Any]:
    """Return the arguments of the check that come from the model and the workspace."""
    found: dict[str, Any] = {"distances": problem.clearance, "tool": problem.tool}
    if problem.theta is None:
        return found
    found["torque"] = _torque(problem, problem.theta)
    if np.any(np.isfinite(problem.limits.torque_rate)) and problem.smooth_theta is not None:
        found["smooth_torque"] = _torque(problem, problem.smooth_theta)
    if (factors := problem.spread_factors) is not None:
        found["spread"] = lambda motion: problem.observation.spread(motion, factors)
    return found


def _torque(problem: DesignProblem, theta: Array) -> Callable[[Motion], Array]:
    return lambda motion: problem.observation.model.torque(motion, theta)
