"""design_excitation: from a model and its limits to a plan that keeps them and excites every base parameter."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import asdict, is_dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt
from threadpoolctl import threadpool_limits

from dynident.arrays import Array
from dynident.errors import BadOption, SolverFailed
from dynident.experiment.criteria import CRITERIA, Criterion
from dynident.experiment.design_problem import DesignProblem, Point
from dynident.experiment.design_search import SearchState, candidates
from dynident.experiment.feasibility import feasible_start, shrunk
from dynident.experiment.finishing import FINER, Candidate, checked_plan, first_that_starts
from dynident.experiment.limits import MotionLimits, limits_of
from dynident.experiment.observation import Observation
from dynident.experiment.parametrisation import parametrise
from dynident.experiment.plan import Plan
from dynident.model.base_parameters import base_parameters
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import FRICTION

#: Noise of a joint's torque where none is given, as a share of its effort limit.
NOISE_SHARE = 0.01


def design_excitation(
    model: DynamicModel,
    limits: MotionLimits | None = None,
    criterion: str | Criterion = "d_optimal",
    *,
    trajectory: str = "rest_fourier",
    period: float = 10.0,
    harmonics: int = 5,
    starts: int = 4,
    seed: int = 0,
    samples: int = 200,
    noise: npt.ArrayLike | None = None,
    theta: npt.ArrayLike | None = None,
    time_limit: float = 60.0,
    progress: Callable[[SearchState], None] = lambda state: None,
) -> Plan:
    """Design a motion that determines the base parameters as well as the limits allow.

    Several random starts, each made feasible, go through sequential quadratic programming (SLSQP, Kraft 1988) with
    exact gradients; the best iterate that keeps all bounds on a ten times finer grid becomes the plan.

    Args:
        model: Robot, drives and friction.
        limits: What the motion must keep; None for the limits of the robot's description less 5 % (torque 20 %).
        criterion: Name or part.
        trajectory: ``rest_fourier``, or ``fourier`` (14) with a run-in from rest.
        period: Period in s.
        harmonics: Number of sine and cosine pairs per joint.
        starts: Number of random starts.
        seed: Of the starts; start k of a seed is the same whatever their number.
        samples: Samples of one period that the search looks at.
        noise: Standard deviation of each joint's torque, one number or shape (n,), for the criteria that weigh by it;
            None for 1 % of the effort limits, or the same for all joints where one has none.
        theta: Parameters for the torque limits, shape (p,); None for those of the description.
        time_limit: Time in s after which the best motion so far is taken.
        progress: Told about every evaluation.

    Raises:
        BadOption: An option out of range, or a joint that has no speed limit.
        SolverFailed: No motion that keeps the limits.
        UnknownChoice: No such criterion or trajectory.
    """
    _check_options(model, limits, starts, time_limit)
    part = CRITERIA.make(criterion)
    bounds = limits or limits_of(model.robot)
    levels, source = _noise(model, noise)
    values = model.nominal() if theta is None else _parameters(model, theta)
    shape = parametrise(trajectory, period, harmonics)
    begun = time.perf_counter()
    with threadpool_limits(1, user_api="blas"):
        observation = Observation(model, base_parameters(model))
        weights = levels if part.weighted else np.ones(len(levels))
        problem = DesignProblem(observation, shape, part, bounds, weights, values, samples)
        found, evaluations = _search(problem, starts, seed, begun + time_limit, progress)
        best = first_that_starts(problem, found)
        plan = checked_plan(problem, best, levels)
    effort = {"starts": starts, "seed": seed, "best_start": best.start, "evaluations": evaluations}
    facts = {**effort, "noise": levels.tolist(), "noise_source": source, "seconds": time.perf_counter() - begun}
    given = {} if theta is None else {"torque_limits": "parameters given"}
    return replace(plan, settings={**_settings(problem), **facts, **given})


def _settings(problem: DesignProblem) -> dict[str, Any]:
    """Return the plain facts of a problem that go with its plan."""
    part, shape = problem.criterion, problem.parametrisation
    return {
        "trajectory": shape.kind,
        "period": shape.period,
        "harmonics": shape.harmonics,
        "samples": problem.samples,
        "torque_limits": "not checked: no nominal inertias" if problem.theta is None else "nominal model",
        "criterion_options": asdict(part) if is_dataclass(part) else {},
        "friction": [FRICTION.name_of(item) for item in problem.observation.model.friction],
        "base_parameters": problem.observation.base.count,
    }


def _search(
    problem: DesignProblem, starts: int, seed: int, deadline: float, progress: Callable[[SearchState], None]
) -> tuple[list[Candidate], int]:
    """Return what the starts found, the best first, and the number of evaluations."""
    dense = replace(problem, samples=FINER * problem.samples)
    sign = -1.0 if problem.criterion.larger_is_better else 1.0
    found: list[Candidate] = []
    evaluations, begun = 0, time.perf_counter()
    for k, one in enumerate(np.random.SeedSequence(seed).spawn(starts)):
        now = time.perf_counter()
        if found and now >= deadline:
            break
        start = feasible_start(problem, np.random.default_rng(one))

        def report(point: Point, k: int = k) -> None:
            nonlocal evaluations
            evaluations += 1
            seconds = time.perf_counter() - begun
            progress(SearchState(k + 1, starts, evaluations, point.objective, float(point.used.max()), seconds))

        for x in candidates(problem, start, now + max(deadline - now, 0.0) / (starts - k), report):
            kept = shrunk(dense, x)
            if kept is not None:
                figure = sign * problem.criterion.value(problem.observation.triangle(dense.motion(kept), problem.noise))
                found.append(Candidate(kept, figure, k + 1))
    found = [candidate for candidate in found if np.isfinite(candidate.figure)]
    if not found:
        evidence = f"none of {starts} starts keeps the limits between samples and excites all parameters"
        raise SolverFailed("excitation design", evidence, "give more harmonics, more starts or a longer period")
    return sorted(found, key=lambda candidate: candidate.figure), evaluations


def _check_options(model: DynamicModel, limits: MotionLimits | None, starts: int, time_limit: float) -> None:
    if starts < 1:
        raise BadOption("starts", starts, "give 1 or more")
    if not 0 < time_limit:
        raise BadOption("time_limit", time_limit, "give seconds, above 0")
    if limits is not None and limits.joints != model.robot.joint_names:
        step = f"give those of the robot's joints: {', '.join(model.robot.joint_names)}"
        raise BadOption("limits", f"of {', '.join(limits.joints)}", step)


def _parameters(model: DynamicModel, theta: npt.ArrayLike) -> Array:
    values = np.array(theta, dtype=np.float64)
    if values.shape != (len(model.parameters),) or not np.all(np.isfinite(values)):
        step = f"give {len(model.parameters)} finite numbers, one for each parameter of the model"
        raise BadOption("theta", f"of shape {values.shape}", step)
    return values


def _noise(model: DynamicModel, given: npt.ArrayLike | None) -> tuple[Array, str]:
    """Return the standard deviation of each joint's torque, shape (n,), and where it comes from."""
    if given is not None:
        levels = np.array(given, dtype=np.float64)
        if levels.shape not in ((), (model.robot.dof,)) or not np.all((levels > 0) & np.isfinite(levels)):
            step = f"give one number above 0, or one for each of the {model.robot.dof} joints, in N m or N"
            raise BadOption("noise", levels.tolist(), step)
        return np.broadcast_to(levels, (model.robot.dof,)).copy(), "given"
    efforts = np.array([joint.limits.effort for joint in model.robot.active])
    if np.all(np.isfinite(efforts) & (efforts > 0)):
        return NOISE_SHARE * efforts, f"{100 * NOISE_SHARE:g} % of the effort limits"
    return np.ones(model.robot.dof), "1 N m or N for every joint: not every effort limit is stated"
