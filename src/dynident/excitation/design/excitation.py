"""design_excitation: from a model and its limits to a plan that keeps them and excites every base parameter."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, is_dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from dynident.arrays import Array
from dynident.errors import BadOption, InfeasibleTrajectory, check_kind
from dynident.excitation.criteria import CRITERIA, Criterion
from dynident.excitation.design.design_problem import DesignProblem
from dynident.excitation.design.finishing import FINER, FinishingCandidate, checked_plan, first_that_starts
from dynident.excitation.design.limits import MotionLimits, limits_of
from dynident.excitation.design.multistart import (
    DesignCheckpoint,
    MultistartSearch,
    SearchState,
    problem_facts,
    run_starts,
)
from dynident.excitation.design.observation import Observation
from dynident.excitation.design.options import DesignKnowledge, SearchOptions, SpaceLimits, TrajectoryOptions
from dynident.excitation.design.parametrisation import parametrise
from dynident.excitation.design.plan import Plan
from dynident.excitation.design.prior import Prior, outlook_of, prior_of_nominal
from dynident.excitation.design.start import StartResult
from dynident.model.base_parameters import base_parameters
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import FRICTION, Motion
from dynident.model.threads import one_blas_thread

#: Noise of a joint's torque where none is given, as a share of its effort limit.
NOISE_SHARE = 0.01

#: Independent samples a second that a run gives where nothing else is said; that of the default preprocessing.
ROWS_A_SECOND = 200.0


def design_excitation(
    model: DynamicModel,
    limits: MotionLimits | None = None,
    criterion: str | Criterion = "d_optimal",
    *,
    trajectory: TrajectoryOptions | None = None,
    knowledge: DesignKnowledge | None = None,
    space: SpaceLimits | None = None,
    search: SearchOptions | None = None,
    progress: Callable[[SearchState], None] = lambda state: None,
) -> Plan:
    """Design a motion that determines the base parameters as well as the limits allow; see docs/excitation.md.

    Args:
        model: Robot, drives and friction.
        limits: What the motion must keep; None for those of the robot model less 5 % (torque 20 %).
        criterion: Name or part.
        trajectory: The family of motions; None for the default one.
        knowledge: What is known before the run; None for the robot model alone.
        space: What the motion keeps in space; None for nothing.
        search: How it is searched; None for the default.
        progress: Called about five times a second and start, and when a start is done.

    Raises:
        BadOption: An option out of range, or a joint that has no speed limit.
        DynidentError: An unknown part, a checkpoint of another problem, or a worker process that died.
        InfeasibleTrajectory: No motion that keeps the limits.
    """
    trajectory, knowledge = trajectory or TrajectoryOptions(), knowledge or DesignKnowledge()
    search, space = search or SearchOptions(), space or SpaceLimits()
    _check_options(model, limits, search)
    rows = _rows(knowledge.rows, trajectory.period)
    request = _Request(model, CRITERIA.make(criterion), knowledge, rows)
    with one_blas_thread():
        problem = request.problem(trajectory, limits or limits_of(model.robot), space)
        starts = MultistartSearch(problem, search.starts, search.seed, search.time_limit, search.jobs, {}, search.pool)
        return request.plan(starts, search.checkpoint, progress)


@dataclass(frozen=True)
class _Request:
    """What is asked, apart from the motion and its limits."""

    model: DynamicModel
    part: Criterion
    knowledge: DesignKnowledge
    rows: float

    @cached_property
    def levels(self) -> tuple[Array, str]:
        """Standard deviation of each joint's torque, shape (n,), and where it comes from."""
        return _noise(self.model, self.knowledge.noise)

    @cached_property
    def observation(self) -> Observation:
        """Observation matrix of the model."""
        return Observation(self.model, base_parameters(self.model))

    @cached_property
    def prior(self) -> Prior | None:
        """What counts as known before the run."""
        return _prior(self.observation, self.part, self.knowledge.earlier)

    def problem(self, trajectory: TrajectoryOptions, limits: MotionLimits, space: SpaceLimits) -> DesignProblem:
        """Return the optimisation problem."""
        levels, _ = self.levels
        given = self.knowledge.theta
        theta = self.model.nominal() if given is None else _parameters(self.model, given)
        weights = levels if self.part.weighted else np.ones(len(levels))
        return DesignProblem(
            self.observation,
            parametrise(trajectory.kind, trajectory.period, trajectory.harmonics),
            self.part,
            limits,
            weights,
            theta,
            trajectory.samples,
            uncertainty=self.knowledge.uncertainty,
            clearance=space.clearance,
            earlier=None if self.prior is None else self.prior.triangle(self.rows),
            tool=space.tool,
        )

    def plan(
        self, search: MultistartSearch, checkpoint: str | Path | None, progress: Callable[[SearchState], None]
    ) -> Plan:
        """Run the starts and return the plan with its settings."""
        begun = time.perf_counter()
        problem, (levels, source) = search.problem, self.levels
        results = _run(search, checkpoint, progress)
        best = first_that_starts(problem, _sorted(results, search.starts))
        plan = checked_plan(problem, best, levels)
        facts = {
            "starts": search.starts,
            "seed": search.seed,
            "best_start": best.start,
            "evaluations": sum(result.evaluations for result in results),
            "noise": levels.tolist(),
            "noise_source": source,
            "seconds": time.perf_counter() - begun,
            "outlook": _outlook(problem, plan, levels, self.prior, self.rows),
        }
        given = {} if self.knowledge.theta is None else {"torque_limits": "parameters given"}
        return replace(plan, settings={**_settings(problem), **facts, **given})


def _run(
    search: MultistartSearch, checkpoint: str | Path | None, progress: Callable[[SearchState], None]
) -> list[StartResult]:
    """Run the starts that no checkpoint has, and keep those that end."""
    if checkpoint is None:
        return run_starts(search, progress, lambda result: None)
    file = DesignCheckpoint(checkpoint, problem_facts(search.problem, search.seed), search.problem.size)
    done = file.read()

    def keep(result: StartResult) -> None:
        if result.failure is None:
            done[result.start] = result
            file.write(done)

    return run_starts(replace(search, done=dict(done)), progress, keep)


def _sorted(results: list[StartResult], starts: int) -> list[FinishingCandidate]:
    """Return what all starts found, the best first.

    Raises:
        DynidentError: Why there is none.
    """
    found = [candidate for result in results for candidate in result.candidates]
    if found:
        return sorted(found, key=lambda candidate: candidate.figure)
    failures = [result.failure for result in results if result.failure is not None]
    if failures:
        raise failures[0]
    evidence = f"none of {starts} starts keeps them between the samples and excites all parameters"
    step = "give more harmonics, more starts or a longer period"
    raise InfeasibleTrajectory("all of them together", evidence, step)


def _prior(observation: Observation, part: Criterion, earlier: Prior | None) -> Prior | None:
    """Return what counts as known before the run.

    Raises:
        BadOption: A criterion that does not weigh by the noise beside earlier runs, or those of another model.
    """
    if earlier is not None and not part.weighted:
        names = ", ".join(name for name in CRITERIA.names() if CRITERIA.get(name).weighted)
        step = f"it does not weigh by the noise, so earlier runs cannot be added; choose one of: {names}"
        raise BadOption("criterion", CRITERIA.name_of(part), step)
    if earlier is not None and len(earlier.information) != observation.base.count:
        evidence = f"of {len(earlier.information)} base parameters"
        raise BadOption("earlier", evidence, f"the model has {observation.base.count}; use the same robot and friction")
    if part.nominal_deviation is None:
        return earlier
    nominal = prior_of_nominal(observation.model, observation.base, part.nominal_deviation)
    return nominal if earlier is None else earlier.plus(nominal)


def _outlook(problem: DesignProblem, plan: Plan, levels: Array, prior: Prior | None, rows: float) -> dict[str, Any]:
    """Return as plain data what the run would buy."""
    motion, count = plan.trajectory, FINER * problem.samples
    grid = Motion(*motion.evaluate(np.arange(count) * motion.period / count))
    triangle = problem.observation.triangle(grid, levels)
    return outlook_of(problem.observation.base, prior, triangle, rows, problem.beta).data()


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


def _check_options(model: DynamicModel, limits: MotionLimits | None, search: SearchOptions) -> None:
    check_kind("model", model, DynamicModel, 'di.DynamicModel(robot, ["coulomb", "viscous"]), or di.excite(robot)')
    if limits is not None:
        check_kind("limits", limits, MotionLimits, "limits=di.limits_of(robot, margin=0.1)")
    if search.starts < 1:
        raise BadOption("starts", search.starts, "give 1 or more")
    if not 0 < search.time_limit:
        raise BadOption("time_limit", search.time_limit, "give seconds, above 0")
    if limits is not None and limits.joints != model.robot.joint_names:
        step = f"give those of the robot's joints: {', '.join(model.robot.joint_names)}"
        raise BadOption("limits", f"of {', '.join(limits.joints)}", step)


def _rows(rows: float | None, period: float) -> float:
    if rows is not None and not 0 < rows < np.inf:
        raise BadOption("rows", rows, "give the number of rows of a joint that the run gives, above 0")
    return ROWS_A_SECOND * period if rows is None else float(rows)


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
