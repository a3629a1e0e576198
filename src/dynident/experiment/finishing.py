"""From free numbers to a plan: the run-in that starts it from rest, the dense check, the figures of all criteria."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from dynident.arrays import Array
from dynident.errors import SolverFailed
from dynident.experiment.criteria import CRITERIA
from dynident.experiment.design_problem import DesignProblem
from dynident.experiment.limits import MotionLimits, check_limits
from dynident.experiment.plan import Plan
from dynident.experiment.rest_to_rest import RestToRest
from dynident.experiment.trajectories.fourier import FourierSeries
from dynident.experiment.trajectories.rest_fourier import RestFourier
from dynident.model.friction import Motion

#: The check before a plan is made is this much finer than the grid of the search.
FINER = 10

#: Run-ins in s that are tried, and phases of the period at which a motion may begin.
RUN_INS, PHASES = (0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0), 24


@dataclass(frozen=True)
class Candidate:
    """Free numbers that keep all bounds within the period, their figure and the start they come from."""

    free: Array
    figure: float
    start: int
    trajectory: FourierSeries | RestFourier | None = None
    run_in: float = 0.0


def first_that_starts(problem: DesignProblem, found: list[Candidate]) -> Candidate:
    """Return the best candidate that can be driven from rest to rest, with its phase and run-in."""
    for candidate in found:
        motion = problem.parametrisation.trajectory(problem.free(candidate.free))
        if isinstance(motion, RestFourier):
            return replace(candidate, trajectory=motion)
        limits = _no_harsher(problem.limits, motion, FINER * problem.samples)
        for run_in in RUN_INS:
            for phase in np.arange(PHASES) / PHASES * motion.period:
                turned = shifted(motion, float(phase))
                if _is_kept(problem, limits, turned, run_in):
                    return replace(candidate, trajectory=turned, run_in=run_in)
    step = "design a rest_fourier, which needs no run-in"
    raise SolverFailed("excitation design", f"no run-in of up to {RUN_INS[-1]:g} s keeps the limits", step)


def shifted(motion: FourierSeries, phase: float) -> FourierSeries:
    """Return the series that begins ``phase`` seconds later in its period: q(t + phase)."""
    angle = 2 * np.pi / motion.period * phase * np.arange(1, motion.harmonics + 1)
    cosine, sine = np.cos(angle), np.sin(angle)
    a, b = motion.sine, motion.cosine
    return FourierSeries(motion.offset, a * cosine - b * sine, a * sine + b * cosine, motion.period)


def _no_harsher(limits: MotionLimits, motion: FourierSeries, samples: int) -> MotionLimits:
    """Return the limits with the motion's own largest acceleration and jerk where none are stated."""
    time = np.arange(samples) * motion.period / samples
    acceleration, jerk = (np.abs(s).max(axis=0) * 1.001 for s in (motion.evaluate(time)[2], motion.jerk(time)))
    return replace(
        limits,
        acceleration=np.where(np.isfinite(limits.acceleration), limits.acceleration, acceleration),
        jerk=np.where(np.isfinite(limits.jerk), limits.jerk, jerk),
    )


def _is_kept(problem: DesignProblem, limits: MotionLimits, motion: FourierSeries, run_in: float) -> bool:
    driven = RestToRest(motion, run_in)
    samples = _check_samples(problem, driven)
    if not all(row.kept for row in check_limits(driven, limits, samples)):
        return False
    return all(row.kept for row in check_limits(driven, limits, samples, _torque(problem)))


def _check_samples(problem: DesignProblem, driven: RestToRest) -> int:
    """Return the number of samples of the check, both ends included."""
    return int(np.ceil(driven.duration * FINER * problem.samples / driven.core.duration)) + 1


def checked_plan(problem: DesignProblem, best: Candidate, noise: Array) -> Plan:
    """Check the motion densely from rest to rest and put the plan together, settings left empty."""
    motion = best.trajectory
    assert motion is not None
    driven = RestToRest(motion, best.run_in)
    samples = _check_samples(problem, driven)
    rows = check_limits(driven, problem.limits, samples, _torque(problem))
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
    values[chosen] = problem.criterion.value(triangles[problem.criterion.weighted])
    robot = problem.observation.model.robot.name
    return Plan(robot, motion, best.run_in, chosen, values, problem.limits, rows, samples, {})


def _torque(problem: DesignProblem) -> Callable[[Motion], Array] | None:
    theta, model = problem.theta, problem.observation.model
    return None if theta is None else lambda motion: model.torque(motion, theta)
