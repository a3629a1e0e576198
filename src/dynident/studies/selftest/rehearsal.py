"""rehearse: record a planned motion on a virtual cell, identify it, and compare with the truth."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from dynident.arrays import Array, finite
from dynident.data.log import Log
from dynident.data.preprocessing import Preprocessing
from dynident.errors import BadOption, DynidentError
from dynident.excitation.design.rest_to_rest import RestToRest
from dynident.excitation.trajectories.base import Designable
from dynident.identification.build_problem import PriorKnowledge, build_problem
from dynident.identification.estimate.estimate import Estimate
from dynident.identification.estimators import Estimator
from dynident.identification.fit import fit
from dynident.model.base_parameters import base_parameters
from dynident.model.body_constraints import Constraints
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import Motion
from dynident.simulation.cell import Cell, CellRun
from dynident.simulation.cell_simulation import simulate_cell
from dynident.studies.benchmark.possible_robots import told

#: Lengths of the log that are tried, in units of the planned one; the planned one is among them.
SHARES = (0.5, 1.0, 2.0, 4.0)

#: States in which torques are compared.
STATES = 1000

#: A parameter counts from this share of the torque of some joint on.
MATTERS = 0.01

#: Level of the intervals that are checked.
LEVEL = 0.95


@dataclass(frozen=True)
class Tolerance:
    """What the user asks of the run.

    Attributes:
        torque: Largest error of the predicted torque of a joint, as a share of that torque.
        parameter: Largest error of a base parameter that counts, as a share of its value; None asks nothing.
    """

    torque: float = 0.05
    parameter: float | None = None

    def __post_init__(self) -> None:
        for name, value in (("tolerance", self.torque), ("parameter tolerance", self.parameter)):
            if value is not None and not 0 < value < np.inf:
                raise BadOption(name, value, "give a share above 0, such as 0.05")


@dataclass(frozen=True)
class RehearsalStage:
    """What a log of one length came to.

    Attributes:
        share: Its length in units of the planned one.
        seconds: Its length in s.
        estimate: What was identified; None where that failed.
        failure: Why, in words; empty where it did not.
        truth: The true base parameters, shape (b,).
        torque_errors: Error of the predicted torque of each joint as a share of the true one, or of its noise where
            that is larger, shape (n,).
    """

    share: float
    seconds: float
    estimate: Estimate | None
    failure: str
    truth: Array
    torque_errors: Array

    @property
    def errors(self) -> Array:
        """Found less true base parameters, shape (b,); NaN where nothing was found."""
        return np.full(len(self.truth), np.nan) if self.estimate is None else self.estimate.beta - self.truth

    @property
    def relative_errors(self) -> Array:
        """Sizes of the errors as shares of the true values, shape (b,); infinite for a true value of 0."""
        size = np.abs(self.truth)
        return np.divide(np.abs(self.errors), size, out=np.full(len(size), np.inf), where=size > 0)

    @property
    def relative_std(self) -> Array:
        """Stated deviations as shares of the true values, shape (b,); NaN where nothing was found."""
        if self.estimate is None:
            return np.full(len(self.truth), np.nan)
        size = np.abs(self.truth)
        return np.divide(self.estimate.std, size, out=np.full(len(size), np.inf), where=size > 0)

    @property
    def inside(self) -> float:
        """Share of the stated 95 % intervals that hold the truth; NaN where nothing was found."""
        if self.estimate is None:
            return float("nan")
        return float(np.mean(np.abs(self.errors) <= self.estimate.half_widths(LEVEL)))


@dataclass(frozen=True)
class Rehearsal:
    """What a planned run would tell about a robot.

    Attributes:
        model: The model that is identified.
        names: Names of the base parameters.
        units: Their units.
        weights: How much of the torque each carries: its largest share of the torque of a joint, shape (b,).
        stages: Logs of growing length; :attr:`planned` is the one of the plan.
        tolerance: What was asked.
        saturated_torques: Torques that were cut at the effort limits.
        left_behind: Position error as a share of the motion of each joint that did not follow.
    """

    model: DynamicModel
    names: tuple[str, ...]
    units: tuple[str, ...]
    weights: Array
    stages: tuple[RehearsalStage, ...]
    tolerance: Tolerance
    saturated_torques: int = 0
    left_behind: Mapping[str, float] = field(default_factory=dict)

    @property
    def planned(self) -> RehearsalStage:
        """The log of the planned length."""
        return next(stage for stage in self.stages if stage.share == 1.0)

    def complaints(self, stage: RehearsalStage) -> tuple[str, ...]:
        """Return what is beyond the tolerance after a log, in words; nothing where it passes."""
        if stage.estimate is None:
            return (stage.failure,)
        found = [
            f"torque of {joint}: error of {100 * error:.2g} %, asked for {100 * self.tolerance.torque:g} %"
            for joint, error in zip(self.model.robot.joint_names, stage.torque_errors, strict=True)
            if not error <= self.tolerance.torque
        ]
        asked = self.tolerance.parameter
        for name, error, weight in zip(self.names, stage.relative_errors, self.weights, strict=True):
            if asked is not None and weight >= MATTERS and not error <= asked:
                found.append(f"{name}: error of {100 * error:.2g} %, asked for {100 * asked:g} %")
        return tuple(found)

    @property
    def passed(self) -> bool:
        """Whether the planned log meets the tolerance."""
        return not self.complaints(self.planned)

    @property
    def enough(self) -> float | None:
        """The least of the lengths, in units of the planned one, from which on all pass; None where none does."""
        good = None
        for stage in reversed(self.stages):
            if self.complaints(stage):
                break
            good = stage.share
        return good

    def figures(self) -> dict[str, Any]:
        """Return the rehearsal as plain data, fractions for shares; a figure that does not exist is None."""
        return {
            "robot": self.model.robot.name,
            "passed": self.passed,
            "violations": list(self.complaints(self.planned)),
            "sufficient_share": self.enough,
            "tolerance": {"torque": self.tolerance.torque, "parameter": self.tolerance.parameter},
            "saturated_torques": self.saturated_torques,
            "left_behind": dict(self.left_behind),
            "stages": [self._stage_figures(stage) for stage in self.stages],
        }

    def _stage_figures(self, stage: RehearsalStage) -> dict[str, Any]:
        found = stage.estimate
        deviations = np.full(len(stage.truth), np.nan) if found is None else found.std
        values = stage.truth + stage.errors
        return {
            "share": stage.share,
            "seconds": stage.seconds,
            "failure": stage.failure or None,
            "passed": not self.complaints(stage),
            "coverage": finite(stage.inside),
            "physically_consistent": None if found is None else found.consistency.consistent,
            "joints": [
                {"name": joint, "torque_error": finite(error)}
                for joint, error in zip(self.model.robot.joint_names, stage.torque_errors, strict=True)
            ],
            "parameters": [
                {
                    "name": name, "unit": unit, "truth": float(truth), "value": finite(value), "std": finite(deviation),
                    "share_of_torque": float(weight),
                }
                for name, unit, truth, value, deviation, weight in zip(
                    self.names, self.units, stage.truth, values, deviations, self.weights, strict=True
                )
            ],
        }  # fmt: skip


@dataclass(frozen=True)
class RehearsalPlan:
    """What is planned: a motion, how often, and how it is recorded and prepared.

    Attributes:
        core: One period of the motion.
        run_in: Length of the run-in from rest, in s.
        repeats: Periods of the planned log.
        cell: Where it is recorded; torque noise in N m or N.
        preprocessing: How the log becomes rows.
        seed: Of the noise.
    """

    core: Designable
    run_in: float
    repeats: int
    cell: Cell
    preprocessing: Preprocessing
    seed: int = 0

    def cut(self, log: Log, share: float) -> Log:
        """Return the beginning of a long log that is ``share`` of the planned one."""
        length = self.run_in + share * self.repeats * self.core.duration
        return log.rows(log.time < length, f"first {length:g} s")


@dataclass(frozen=True)
class KnownBefore:
    """What is known before a rehearsal.

    Attributes:
        guess: Parameters that the estimator may know, shape (p,); None for none.
        believed: Parameters that the controller believes, shape (p,); None for the truth.
        constraints: What is known about bodies.
    """

    guess: Array | None = None
    believed: Array | None = None
    constraints: Constraints = field(default_factory=Constraints)


NOTHING = KnownBefore()


def rehearse(
    model: DynamicModel,
    theta: Array,
    plan: RehearsalPlan,
    estimator: Estimator,
    tolerance: Tolerance,
    *,
    known: KnownBefore = NOTHING,
    shares: Sequence[float] = SHARES,
    progress: Callable[[str], None] = lambda step: None,
) -> Rehearsal:
    """Return what a planned run would tell about a robot with the parameters theta (p,).

    What the cell adds to the robot counts as true: a payload is one of its masses, a tilted base its gravity. One
    virtual log of the greatest length is recorded; every shorter one is its beginning, and nothing else differs.
    The estimator is told no masses, or those of a guess, never the truth.

    Args:
        model: Robot and friction, of the truth and of what is identified.
        theta: The truth but for the payload of the cell, shape (p,).
        plan: Motion, noise and preparation.
        estimator: Who identifies.
        tolerance: What is asked.
        known: What estimator and controller know beforehand.
        shares: Lengths that are tried; the planned one, 1, is always among them.
        progress: Called with each step in words.

    Raises:
        BadOption: A length, a number of periods or a setting of the cell that cannot be.
        MissingDependency: The cell is to run in MuJoCo, and that is not installed.
        NotConsistent: The truth cannot be simulated.
        SolverFailed: The motion diverged.
        UnknownChoice: A payload at a link that is not there.
    """
    lengths = sorted({1.0, *shares})
    if not 0 < lengths[0] <= lengths[-1] < np.inf:
        raise BadOption("shares", list(shares), "give lengths above 0 in units of the planned one")
    if plan.repeats < 1:
        raise BadOption("repeats", plan.repeats, "give 1 or more")
    periods = int(np.ceil(lengths[-1] * plan.repeats))
    motion = RestToRest(plan.core, plan.run_in, periods)
    progress("virtual robot")
    run = simulate_cell(model, theta, motion, plan.cell, believed=known.believed, seed=plan.seed)
    states, weights = _states(model, run, plan.seed)
    base = base_parameters(model)
    noise = np.broadcast_to(np.asarray(plan.cell.effort.noise, dtype=float), (model.robot.dof,))
    nominal = told(model, known.guess)
    stages = []
    for share in lengths:
        log = plan.cut(run.log, share)
        progress(f"{log.duration:.3g} s of motion")
        stages.append(_stage(share, log, nominal, plan.preprocessing, estimator, known.constraints))
    judged = tuple(_judged(stage, model, run, states, noise) for stage in stages)
    behind = dict(run.left_behind())
    return Rehearsal(model, base.names, base.units, weights, judged, tolerance, run.saturated, behind)


def _stage(
    share: float, log: Log, model: DynamicModel, how: Preprocessing, estimator: Estimator, constraints: Constraints
) -> RehearsalStage:
    """Identify one log; what the log does not tell is an answer too."""
    estimate, failure = None, ""
    try:
        estimate = fit(build_problem(model, [log], how, knowledge=PriorKnowledge(constraints)), estimator)
    except DynidentError as error:
        failure = " ".join(str(error).split())
    return RehearsalStage(share, log.duration, estimate, failure, np.zeros(0), np.zeros(0))


def _judged(stage: RehearsalStage, model: DynamicModel, run: CellRun, states: Motion, noise: Array) -> RehearsalStage:
    """Return the stage with its truth and the errors of its torques."""
    found, theta = stage.estimate, run.theta
    if found is None:
        truth = base_parameters(model).from_standard(theta)
        return replace(stage, truth=truth, torque_errors=np.full(model.robot.dof, np.nan))
    wanted = replace(model, robot=model.robot.with_gravity(run.gravity)).torque(states, theta)
    own = found.model.torque(states, found.base.to_standard(found.beta))
    size = np.maximum(np.sqrt(np.mean(wanted**2, axis=0)), noise)
    error = np.sqrt(np.mean((own - wanted) ** 2, axis=0))
    ratio = np.divide(error, size, out=np.where(error > 0, np.inf, 0.0), where=size > 0)
    return replace(stage, truth=found.base.from_standard(theta), torque_errors=ratio)


def _states(model: DynamicModel, run: CellRun, seed: int) -> tuple[Motion, Array]:
    """Return states that mix positions, speeds and accelerations of the motion, and what each parameter carries there.

    Each joint's position, speed and acceleration come from moments of their own: states that the log has not seen,
    within what it has seen.
    """
    generator, truth, theta = np.random.default_rng([seed, 11]), run.truth, run.theta
    q, dq, ddq, temperature = (
        np.stack([generator.choice(signal[:, i], STATES) for i in range(model.robot.dof)], axis=1)
        for signal in map(np.asarray, (truth.q, truth.dq, truth.ddq, truth.temperature))
    )
    motion = Motion(q, dq, ddq, temperature=temperature)
    base = base_parameters(model)
    parts = model.regressor(model.loaded(motion, theta))[..., base.independent] * base.from_standard(theta)
    torque = np.sqrt(np.mean(model.torque(motion, theta) ** 2, axis=0))
    sizes = np.sqrt(np.mean(parts**2, axis=0))
    shares = np.divide(sizes, torque[:, None], out=np.zeros_like(sizes), where=torque[:, None] > 0)
    return motion, shares.max(axis=0)
