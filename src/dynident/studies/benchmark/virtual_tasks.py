"""Tasks of a Monte Carlo benchmark: one method on one virtual log, measured against the truth behind it.

Motions are plans that the file of the benchmark names, or are designed once and kept beside the results.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, is_dataclass
from functools import lru_cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from dynident.arrays import Array, finite, plain
from dynident.data.log import Log
from dynident.errors import DynidentError, FileError
from dynident.excitation.design.excitation import design_excitation
from dynident.excitation.design.options import SearchOptions, TrajectoryOptions
from dynident.excitation.design.plan import Plan, read_plan, write_plan
from dynident.excitation.trajectories.base import Designable
from dynident.identification.build_problem import build_problem
from dynident.identification.estimators import ESTIMATORS
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import FRICTION, Motion
from dynident.model.robot import Robot
from dynident.simulation.cell_simulation import simulate_cell
from dynident.simulation.truth import true_parameters
from dynident.studies.benchmark.entrants import Entrant, Preparation
from dynident.studies.benchmark.experiment import Experiment, NoiseLevel
from dynident.studies.benchmark.possible_robots import described_truth, near, random_truth, told
from dynident.studies.benchmark.runner import failed
from dynident.studies.comparison.contest import Contest, Outcome

#: States of the test motion at which torques are compared.
STATES = 1000

#: Temperature of the drives there, in degrees Celsius, where friction depends on it.
TEMPERATURE = 25.0

#: Level of the intervals whose coverage is counted.
LEVEL = 0.95


@dataclass(frozen=True)
class Motions:
    """The motion that is recorded, and the one on which torques are compared."""

    train: Designable
    test: Designable

    def facts(self) -> dict[str, Any]:
        """Return both as plain data."""
        return {
            name: {"kind": type(m).__name__, **m.data()} for name, m in (("train", self.train), ("test", self.test))
        }


@dataclass(frozen=True)
class VirtualTask:
    """One method on one log.

    Attributes:
        robot: Name.
        noise: Of the log.
        rate: Samples a second, in Hz.
        entrant: Method and preparation.
        draw: Number of the log, from 0.
        facts: Everything that the result depends on.
    """

    robot: str
    noise: NoiseLevel
    rate: float
    entrant: Entrant
    draw: int
    facts: Mapping[str, Any]

    @property
    def label(self) -> str:
        """What it is called in progress."""
        return f"{self.robot}, noise {self.noise.name}, {self.rate:g} Hz, draw {self.draw + 1}: {self.entrant.label}"

    @property
    def condition(self) -> tuple[str, str, float]:
        """Robot, noise and samples a second."""
        return self.robot, self.noise.name, self.rate


@dataclass(frozen=True, eq=False)
class VirtualWork:
    """Does the tasks of an experiment; logs and problems of the last few tasks are kept in memory."""

    experiment: Experiment
    motions: Mapping[str, Motions]

    def tasks(self) -> tuple[VirtualTask, ...]:
        """Return all tasks, those of one log beside each other."""
        experiment = self.experiment
        common = {name: self._common(name) for name in experiment.models}
        found = []
        for name in experiment.models:
            for noise in experiment.noise:
                setup = experiment.cell(name, noise)
                made = {"cell": plain(setup.cell.data()), "cell_truth": _fields(setup.truth)}
                for draw in range(experiment.draws):
                    for entrant, rate in _in_order(experiment):
                        facts = {**common[name], **made, **_own_facts(rate, entrant, draw)}
                        found.append(VirtualTask(name, noise, rate, entrant, draw, facts))
        return tuple(found)

    def result(self, task: VirtualTask) -> dict[str, Any]:
        """Return the figures of a task as plain data; a method that fails is a result, and so is a log that does."""
        try:
            contest = _contest(self, task.robot, task.noise, task.draw, task.rate, task.entrant.preparation)
        except DynidentError as error:
            return failed(" ".join(str(error).split()), 0.0)
        outcome = contest.attempt(task.entrant.method)
        motion = self.motions[task.robot].test
        return figures_of(outcome, contest, motion)

    def truth(self, robot: str, noise: NoiseLevel, draw: int) -> Array:
        """Return the true parameters behind a log but for a payload, shape (p,)."""
        experiment, model = self.experiment, self.experiment.models[robot]
        if experiment.truth == "nominal":
            theta = described_truth(model, experiment.seed)
        else:
            theta = random_truth(model, experiment.seed + draw)
        return true_parameters(model, theta, experiment.cell(robot, noise).truth, experiment.seed + draw)

    def _common(self, robot: str) -> dict[str, Any]:
        """Return what all tasks of a robot depend on."""
        experiment, model = self.experiment, self.experiment.models[robot]
        friction = [{"part": FRICTION.name_of(part), **_fields(part)} for part in model.friction]
        described = {"robot": _digest(_robot_facts(model.robot)), "friction": friction}
        return {
            "version": version("dynident"),
            "name": robot,
            **described,
            "motions": _digest(self.motions[robot].facts()),
            "duration": experiment.duration,
            "truth": experiment.truth,
            "guess": experiment.guess,
            "seed": experiment.seed,
        }


def _in_order(experiment: Experiment) -> list[tuple[Entrant, float]]:
    """Return entrants and rates, those that share a problem beside each other."""
    preparations = list(dict.fromkeys(entrant.preparation.name for entrant in experiment.entrants))
    return [
        (entrant, rate)
        for rate in experiment.rates
        for name in preparations
        for entrant in experiment.entrants
        if entrant.preparation.name == name
    ]


def _own_facts(rate: float, entrant: Entrant, draw: int) -> dict[str, Any]:
    part = entrant.method.part
    return {
        "rate": rate,
        "preparation": plain(entrant.preparation.at(rate).statement()),
        "unfiltered": entrant.preparation.unfiltered,
        "method": ESTIMATORS.name_of(part),
        "options": _fields(part),
        "draw": draw,
    }


def _fields(part: object) -> dict[str, Any]:
    return plain(asdict(part)) if is_dataclass(part) and not isinstance(part, type) else {}


def _robot_facts(robot: Robot) -> dict[str, Any]:
    """Return everything about a robot that moves it."""
    chain = robot.chain
    nominal = robot.nominal
    joints = [[j.limits.effort, j.damping, j.friction, j.drive.rotor_inertia, j.drive.gear_ratio] for j in robot.active]
    arrays = (chain.rotation, chain.translation, chain.axis, robot.gravity, np.asarray(robot.coupling))
    bodies = None if nominal is None else np.round(nominal, 12).tolist()
    return {"chain": [np.round(a, 12).tolist() for a in arrays], "bodies": bodies, "joints": repr(joints)}


def _digest(facts: Any) -> str:
    return hashlib.sha256(json.dumps(facts, sort_keys=True).encode()).hexdigest()[:16]


@lru_cache(maxsize=2)
def recorded(work: VirtualWork, robot: str, noise: NoiseLevel, draw: int) -> tuple[Log, Array]:
    """Return the log of a draw and the truth behind it, payload included; the same at every rate, for every method."""
    experiment = work.experiment
    theta = work.truth(robot, noise, draw)
    seed = int(np.random.SeedSequence([experiment.seed, draw]).generate_state(1)[0])
    motion, cell = work.motions[robot].train, experiment.cell(robot, noise).cell
    run = simulate_cell(experiment.models[robot], theta, motion, cell, duration=experiment.duration, seed=seed)
    return run.log, run.theta


@lru_cache(maxsize=2)
def _contest(
    work: VirtualWork, robot: str, noise: NoiseLevel, draw: int, rate: float, preparation: Preparation
) -> Contest:
    """Return the problem that all methods of one preparation are given."""
    log, theta = recorded(work, robot, noise, draw)
    experiment = work.experiment
    if preparation.unfiltered:
        step = max(1, round(experiment.cell(robot, noise).cell.recorder.rate / rate))
        log = log.rows(slice(None, None, step), f"every {step}th row")
    known: DynamicModel = experiment.models[robot]
    guess = (
        None
        if experiment.guess is None
        else near(known, work.truth(robot, noise, draw), experiment.seed + 1000 * (draw + 1), experiment.guess)
    )
    contest = Contest(build_problem(told(known, guess), [log], preparation.at(rate)), (), theta, (log,))
    _ = contest.least  # what all methods share is computed before the clock of the first one begins
    return contest


def figures_of(outcome: Outcome, contest: Contest, motion: Designable) -> dict[str, Any]:
    """Return what a method came to, beside the truth, as plain data.

    ``parameter_distance`` is |beta - truth| / |truth|, ``weighted_distance`` the same with each parameter in units of
    its column's norm, ``torque_distance`` |tau - truth| / |truth| over the test motion without noise (Leboutet et al.
    2021: figures of merit of a benchmark).

    Args:
        outcome: Of :meth:`Contest.attempt`.
        contest: With the truth.
        motion: On which torques are compared.
    """
    effort = outcome.effort
    facts = {name: effort.get(name) for name in ("iterations", "simulations", "evaluations")}
    estimate, theta = outcome.estimate, contest.truth
    if estimate is None or theta is None:
        return {**failed(outcome.failure, outcome.seconds), **facts}
    problem = contest.problem
    truth = problem.base.from_standard(theta)
    q, dq, ddq = motion.evaluate(np.arange(STATES) * motion.period / STATES)
    warm = np.full_like(q, TEMPERATURE) if "temperature" in problem.model.needs else None
    states = Motion(q, dq, ddq, temperature=warm)
    wanted = problem.model.torque(states, theta)
    found = estimate.model.torque(states, estimate.base.to_standard(estimate.beta))
    covered = np.abs(estimate.beta - truth) <= estimate.half_widths(LEVEL)
    return {
        "failure": None,
        "parameter_distance": _ratio(estimate.beta - truth, truth),
        "weighted_distance": None if outcome.parameter_error is None else finite(outcome.parameter_error),
        "torque_distance": _ratio(found - wanted, wanted),
        "seconds": outcome.seconds,
        **facts,
        "consistent": bool(estimate.consistency.consistent),
        "covered": int(np.sum(covered)),
        "parameters": len(truth),
        "verdict": outcome.verdict or None,
    }


def _ratio(part: Array, whole: Array) -> float | None:
    size = float(np.linalg.norm(whole))
    return finite(float(np.linalg.norm(part)) / size) if size > 0 else None


def motions_of(
    experiment: Experiment, folder: str | Path, progress: Callable[[str], None] = lambda step: None
) -> dict[str, Motions]:
    """Return the motions of each robot of an experiment.

    Those that are designed are written into the folder; there they are found when the benchmark goes on, so that all
    its logs are of the same motion.

    Args:
        experiment: The benchmark.
        folder: Where its results are kept.
        progress: Called with each design.

    Raises:
        DynidentError: A plan of another robot or a damaged one, or no motion that keeps the limits.
    """
    found = {}
    for number, (name, model) in enumerate(experiment.models.items()):
        pair = []
        for seed, kind, stated in ((0, "train", experiment.motion.train), (1, "test", experiment.motion.test)):
            if stated:
                plan = _stated(experiment.path.parent / stated, model)
            else:
                plan = _designed(
                    experiment, model, Path(folder) / f"{kind}-{number + 1}.plan.json", seed, progress, name
                )
            pair.append(plan)
        found[name] = Motions(*pair)
    return found


def _stated(path: Path, model: DynamicModel) -> Designable:
    plan = read_plan(path)
    return _checked(plan, path, model)


def _designed(
    experiment: Experiment, model: DynamicModel, path: Path, seed: int, progress: Callable[[str], None], name: str
) -> Designable:
    motion = experiment.motion
    try:
        return _checked(read_plan(path), path, model)
    except DynidentError:
        if path.exists():
            raise
    progress(f"design of a motion for {name}")
    plan = design_excitation(
        model,
        trajectory=TrajectoryOptions(period=motion.period, harmonics=motion.harmonics),
        search=SearchOptions(starts=motion.starts, seed=experiment.seed + seed, time_limit=motion.time_limit),
    )
    write_plan(plan, path)
    return plan.trajectory


def _checked(plan: Plan, path: Path, model: DynamicModel) -> Designable:
    if plan.joints != model.robot.joint_names:
        step = f"give a plan for {', '.join(model.robot.joint_names)}, or another folder"
        raise FileError(path, f"a plan for {', '.join(plan.joints)}", step)
    return plan.trajectory
