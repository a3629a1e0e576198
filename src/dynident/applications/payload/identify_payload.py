"""identify_payload: an estimate of the robot and logs with a payload to the payload, with intervals and verdicts."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dynident.applications.drive_gains.payload import HEAVIEST, CarriedBody
from dynident.applications.payload.carried_load import CarriedLoad
from dynident.applications.payload.difference_fit import (
    DifferenceSolution,
    RunPrior,
    fit_difference,
    independent_covariance,
    load_of_parts,
    noise_covariance,
)
from dynident.applications.payload.flanges import chosen_end, ends_of, frames_beside, second_load
from dynident.applications.payload.gain_doubt import GainDoubt, gain_doubt, scaled_rows
from dynident.applications.payload.poses import holding_friction, mostly_standing, posture_log
from dynident.applications.payload.statement import PayloadFit, disagreement, stated, unexplained
from dynident.arrays import Array, IntArray
from dynident.data.log import Log
from dynident.data.preprocessing import Prepared, Preprocessing, preprocess
from dynident.errors import BadOption, LogMismatch
from dynident.identification.estimate.estimate import Estimate
from dynident.identification.problem.problem import Problem, counting_rows
from dynident.identification.problem.regressor_stream import RegressorStream
from dynident.identification.residuals.covariance import correlation_factors
from dynident.identification.residuals.row_passes import RowPasses
from dynident.model.inertia import Inertia

#: Fits: each takes weights, and the load of friction that grows with it, from the one before.
PASSES = 3

#: Share of the weighted squares that a payload leaves below which one on another link leaves far less: half the torque.
FAR_BETTER = 0.25

#: Share of a stated mass by which that of the log may differ by the scale of its torques: not obeyed beyond it.
GAINS = 0.1

#: Natural sizes of a payload, by which unknowns are compared: kg and m.
NATURAL = (1.0, 0.1)

Progress = Callable[[str], None]


@dataclass(frozen=True)
class BeforeRun:
    """What is known before a run with a payload.

    Attributes:
        mass: Known mass in kg; None: to be found.
        mass_deviation: Its standard deviation in kg.
        friction_share: How far friction may have changed since the robot was identified: standard deviation of the
            torque of each friction term as a share of all friction of its joint; 0: not at all.
        gain_deviation: Relative standard deviation of each drive gain, errors of different drives independent; None:
            those of the robot's drives, or, where torques are made of currents and the gains have none, as far as the
            joints disagree about the payload.
    """

    mass: float | None = None
    mass_deviation: float = 0.0
    friction_share: float = 1.0
    gain_deviation: float | None = None


NOTHING = BeforeRun()


def identify_payload(
    estimate: Estimate,
    logs: Sequence[Log],
    flange: str = "",
    known: BeforeRun = NOTHING,
    rows: str = "auto",
    level: float = 0.95,
    preprocessing: Preprocessing | None = None,
    progress: Progress = lambda step: None,
) -> CarriedLoad:
    """Return mass, centre of mass and inertia of what the robot carried in some logs.

    Args:
        estimate: Of the robot without it; its covariance is part of the payload's.
        logs: Raw logs with the payload.
        flange: Link or frame of the robot model that the payload is stated in; empty for the tool, or the last link;
            of a robot with several ends that at which a payload explains the torques best.
        known: What is known before the run.
        rows: ``motion``; ``poses`` takes one row from each posture at which the arm stands; ``auto`` looks.
        level: Confidence of the intervals.
        preprocessing: Another preparation than that of the fit.
        progress: Called with each step in words.

    Raises:
        BadOption: A mass, share, level or ``rows`` that is none, or a flange that does not move.
        LogMismatch: A log does not fit the robot, or has been used to identify it.
        UnknownChoice: No such flange.
    """
    _check(known, rows, level)
    robot = estimate.model.robot
    ends = (flange,) if flange else ends_of(robot)
    places = [CarriedBody(1.0, frame=name).place(robot) for name in ends]
    progress("preprocessing")
    prepared = _prepared(estimate, logs, preprocessing or estimate.preprocessing)
    if rows == "auto":
        rows = "poses" if mostly_standing(prepared) else "motion"
    used = [posture_log(log) for log in prepared] if rows == "poses" else prepared
    gains = _gain_deviations(estimate, logs, known.gain_deviation)
    beforehand = _Beforehand(known.mass, known.mass_deviation, known.friction_share, gains)
    runs = {
        name: _Run(estimate, used, rows, place, beforehand, progress) for name, place in zip(ends, places, strict=True)
    }
    gains_of = [run.gain() for run in runs.values()] if len(runs) > 1 else [0.0]
    frame, remarks = chosen_end(ends, gains_of)
    remarks = [] if flange else [*remarks, *second_load(robot, frame, ends, gains_of), *frames_beside(robot, frame)]
    names, fit = tuple(log.name for log in logs), runs[frame].solve()
    if known.mass is None:
        return stated(fit, estimate, frame, level, names, tuple(remarks))
    free = _Run(
        estimate, used, rows, runs[frame].place, replace(beforehand, mass=None, deviation=0.0), progress
    ).solve()
    found = stated(fit, estimate, frame, level, names, tuple(remarks), free)
    alone = stated(free, estimate, frame, 0.95, names).mass
    told = disagreement(known.mass, known.mass_deviation, alone)
    if not told:
        return found
    is_far = abs(alone.value - known.mass) > GAINS * known.mass
    return replace(found, remarks=(told, *found.remarks)).contradicted(told if is_far else "")


def _gain_deviations(estimate: Estimate, logs: Sequence[Log], deviation: float | None) -> Array | None:
    """Return the relative deviation of each drive gain, (n,); 0 where torques are measured, None for unknown."""
    stated = np.array([joint.drive.gain_deviation for joint in estimate.model.robot.active])
    if deviation is not None:
        return np.full(len(stated), deviation)
    return None if not np.any(stated) and any(log.current is not None for log in logs) else stated


@dataclass(frozen=True)
class _Beforehand:
    """What the caller knows: the mass and its deviation, change of friction, deviation of each drive gain (n,).

    Without deviations (None) the joints have to say how far their gains are off.
    """

    mass: float | None
    deviation: float
    friction_share: float
    gains: Array | None


@dataclass(frozen=True)
class _Pass:
    """One fit: its rows, the weights it had, what was known, what it found and left, and what rows are worth after."""

    passes: RowPasses
    weights: Array
    known: RunPrior
    found: DifferenceSolution
    residual: Array
    deviations: Array
    factors: Array


def _check(known: BeforeRun, rows: str, level: float) -> None:
    mass, deviation, share, gain_deviation = (
        known.mass,
        known.mass_deviation,
        known.friction_share,
        known.gain_deviation,
    )
    if mass is not None and not 0 < mass <= HEAVIEST:
        raise BadOption("mass", mass, f"give the payload's mass in kg, above 0 and up to {HEAVIEST:g}")
    if not 0 <= deviation < (np.inf if mass is None else 0.5 * mass) or (mass is None and deviation):
        raise BadOption("mass_deviation", deviation, "give the standard deviation of a stated mass in kg, below half")
    if rows not in ("auto", "motion", "poses"):
        raise BadOption("rows", rows, "choose 'auto', 'motion' or 'poses'")
    if not 0 <= share < np.inf:
        raise BadOption("friction_share", share, "give a share of the friction, 0 or more, such as 1")
    if gain_deviation is not None and not 0 <= gain_deviation < 1:
        raise BadOption("gain_deviation", gain_deviation, "give a share of the gain from 0 to 1, such as 0.05")
    if not 0.5 <= level < 1:
        raise BadOption("level", level, "give the confidence of the intervals, such as 0.95")


def _prepared(estimate: Estimate, logs: Sequence[Log], how: Preprocessing) -> list[Prepared]:
    if not logs:
        raise LogMismatch("payload", "no log", "give at least one log with the payload")
    trained = {str(log.get("sha256")) for log in estimate.provenance.get("logs", ())} - {"", "None"}
    found: list[Prepared] = []
    for log in logs:
        if log.source.sha256 in trained:
            raise LogMismatch(log.name, "the robot without the payload was identified from it", "give another log")
        found.append(preprocess(log.ordered(estimate.model.robot.joint_names), how))
        if "temperature" in estimate.model.needs and log.temperature is None:
            raise LogMismatch(log.name, "no temperatures of the drives", "map them: the friction depends on them")
    return found


class _Run:
    """One question: the rows of the logs with the payload, and what is known before them."""

    def __init__(
        self,
        estimate: Estimate,
        logs: Sequence[Prepared],
        rows: str,
        place: tuple[int, Array, Array],
        told: _Beforehand,
        progress: Progress,
    ) -> None:
        self.estimate, self.logs, self.rows, self.place = estimate, tuple(logs), rows, place
        self.told, self.progress = told, progress
        link, rotation, translation = place
        turn = np.column_stack([Inertia.from_vector(one).moved(rotation, translation).vector for one in np.eye(10)])
        self.carried = estimate.base.matrix[:, 10 * link : 10 * link + 10] @ turn
        model, base = estimate.model, estimate.base
        # The variances are not known equally well; those known best let the weights go wrong least.
        self.degrees = np.inf if estimate.degrees is None else float(np.max(estimate.degrees))
        is_open = base.is_friction & (rows == "motion" and told.friction_share > 0)
        self.friction = np.flatnonzero(is_open)
        self.masks = tuple(counting_rows(model, log) for log in self.logs)
        for i, name in enumerate(model.robot.joint_names):
            if not any(mask[:, i].any() for mask in self.masks):
                progress(f"{name} rests throughout: its torque tells nothing")
        self.floor = np.zeros(model.robot.dof)
        if rows == "poses":
            holds = [holding_friction(estimate, log.log) for log in self.logs]
            self.floor = np.max(holds, axis=0) / np.sqrt(3.0)  # uniform between minus and plus what friction holds

    def solve(self) -> PayloadFit:
        """Return the payload's ten, their covariance by source, and the residuals."""
        estimate = self.estimate
        deviations = np.hypot(estimate.joint_deviations, self.floor)
        factors = estimate.correlation_factors if self.rows == "motion" else np.ones(len(deviations))
        passes = RowPasses(self._problem(estimate.beta))
        before = passes.residuals(estimate.beta)
        fit = self._pass(passes, deviations, factors)
        for _ in range(PASSES - 1):
            if "torque" in estimate.model.needs:
                passes = RowPasses(self._problem(estimate.beta + fit.found.change))
            fit = self._pass(passes, fit.deviations, fit.factors)
        found, problem = fit.found, passes.problem
        if self.rows == "motion":
            noise, degrees = noise_covariance(problem, fit.passes, fit.weights, found, fit.residual)
        else:
            noise = independent_covariance(problem, fit.weights, found, fit.deviations)
            degrees = np.full(len(noise), np.inf)
        doubt = self._gain_doubt(fit)
        parts = {
            "noise": noise,
            "robot": found.by_robot,
            "friction": found.by_known[10:].sum(axis=0),
            "gains": np.zeros_like(noise) if doubt is None else doubt.covariance,
            "stated": found.by_known[:10].sum(axis=0),
        }
        ten, left = slice(0, 10), (_rms(before, fit.passes), _rms(fit.residual, fit.passes))
        return PayloadFit(
            ten=found.x[ten],
            open=found.open[ten],
            parts={name: part[ten, ten] for name, part in parts.items()},
            degrees=degrees[ten],
            place=self.place,
            rows=self.rows,
            samples=problem.samples,
            residual=left,
            gains=doubt,
            better=self._better(fit) if unexplained(*left, estimate) is not None else None,
            loads=self._loads(fit) if self.rows == "motion" else None,
        )

    def gain(self) -> float:
        """Return by how much a payload here lowers the weighted squares, beside friction that may have changed.

        The weights are those of the robot's own fit.
        """
        estimate, problem = self.estimate, self._problem(self.estimate.beta)
        factors = estimate.correlation_factors if self.rows == "motion" else np.ones(estimate.model.robot.dof)
        weights = 1.0 / (np.hypot(estimate.joint_deviations, self.floor) * np.sqrt(factors))
        known, without = self._known(problem), slice(10, None)
        own = {name: getattr(known, name)[without] for name in ("sizes", "means", "deviations")}
        friction = replace(known, columns=known.columns[:, without], **own)
        rest = fit_difference(problem, weights, friction).gain if len(self.friction) else 0.0
        return fit_difference(problem, weights, known).gain - rest

    def _loads(self, fit: _Pass) -> tuple[float, float] | None:
        """Return the least and the largest load of parts of the logs, in kg; None where it may be one."""
        carried = fit.known.columns[:, :10] @ fit.found.x[:10]
        torque = fit.passes.residuals(self.estimate.beta + fit.found.change - carried) - fit.residual
        carried, left = fit.passes.by_log(torque), fit.passes.by_log(fit.residual)
        return load_of_parts(float(fit.found.x[9]), carried, left, 1.0 / (fit.deviations * np.sqrt(fit.factors)))

    def _better(self, fit: _Pass) -> tuple[int, Array] | None:
        """Return the link on which a payload leaves the least, with what is left; None where that is not far less.

        The weights are those of the last fit: with those of a log that is explained the robot's own error takes up the
        payload.
        """
        estimate, link = self.estimate, self.place[0]
        weights = 1.0 / np.maximum(np.asarray(estimate.joint_deviations), 1e-300)
        left = []
        for k in range(len(estimate.model.robot.links)):
            columns = np.hstack([estimate.base.matrix[:, 10 * k : 10 * k + 10], fit.known.columns[:, 10:]])
            change = fit_difference(fit.passes.problem, fit.weights, replace(fit.known, columns=columns)).change
            left.append(_rms(fit.passes.residuals(estimate.beta + change), fit.passes))
        sizes = np.sum((weights * np.array(left)) ** 2, axis=1)
        best = int(np.argmin(sizes))
        return (best, left[best]) if sizes[best] < FAR_BETTER * sizes[link] else None

    def _pass(self, passes: RowPasses, deviations: Array, factors: Array) -> _Pass:
        self.progress("payload")
        weights, known = 1.0 / (deviations * np.sqrt(factors)), self._known(passes.problem)
        found = fit_difference(passes.problem, weights, known)
        residual = passes.residuals(self.estimate.beta + found.change)
        return _Pass(passes, weights, known, found, residual, *self._worth(residual, passes))

    def _problem(self, load: Array) -> Problem:
        """Return the rows with friction under the load of some base parameters."""
        estimate = self.estimate
        of_load = load if "torque" in estimate.model.needs else None
        regressor = RegressorStream(estimate.model, estimate.base, of_load)
        parts = [regressor.triangles(log, mask) for log, mask in zip(self.logs, self.masks, strict=True)]
        triangles = tuple(first.merged(rest) for first, *rest in zip(*parts, strict=True))
        return Problem(estimate.model, estimate.base, self.logs, self.masks, triangles, of_load)

    def _worth(self, residual: Array, passes: RowPasses) -> tuple[Array, Array]:
        """Return deviation and correlation factor of each joint's rows after a fit."""
        counts = np.maximum(passes.counting.sum(axis=0), 1)
        free = counts.sum() / max(counts.sum() - 10.0, 0.5 * counts.sum())
        spread = np.sqrt(np.sum(residual**2, axis=0) / counts * free)
        if self.rows == "poses":
            return np.maximum(np.hypot(self.estimate.joint_deviations, self.floor), spread), np.ones(len(spread))
        floor = 1e-3 * np.asarray(self.estimate.joint_deviations)
        return np.maximum(spread, floor), correlation_factors(passes.by_log(residual), self.masks)

    def _known(self, problem: Problem) -> RunPrior:
        """Return what is known before the run, with the friction that may have changed among the unknowns."""
        estimate, count = self.estimate, 10 + len(self.friction)
        columns = np.hstack([self.carried, np.eye(len(estimate.beta))[:, self.friction]])
        kilogram, metre = NATURAL
        own = kilogram * np.r_[np.full(6, metre**2), np.full(3, metre), 1.0]
        spread = self.told.friction_share * _friction_sizes(estimate, problem, self.friction)
        means, deviations = np.zeros(count), np.r_[np.full(10, np.inf), spread]
        if self.told.mass is not None:
            means[9], deviations[9] = self.told.mass, max(self.told.deviation, 1e-6 * self.told.mass)
        sizes = np.r_[own, spread]
        return RunPrior(estimate.beta, estimate.covariance, self.degrees, columns, sizes, means, deviations)

    def _gain_doubt(self, fit: _Pass) -> GainDoubt | None:
        """Return the doubt about drive gains; None where no torque is made of one."""
        if self.told.gains is not None and not np.any(self.told.gains):
            return None
        carried = fit.known.columns[:, :10] @ fit.found.x[:10]
        scaled = scaled_rows(fit.passes.problem, fit.passes, fit.weights, carried, fit.residual)
        return gain_doubt(fit.passes.problem, fit.weights, fit.known, fit.found, scaled, self.told.gains)


def _friction_sizes(estimate: Estimate, problem: Problem, chosen: IntArray) -> Array:
    """Return the value of each chosen friction parameter whose torque is as large as all friction of its joint."""
    base, names = estimate.base, estimate.model.robot.joint_names
    of_joint = []
    for i in range(len(names)):
        one = np.zeros(len(names))
        one[i] = 1.0
        of_joint.append(problem.reduced(one).r)
    found = np.ones(len(chosen))
    for position, k in enumerate(chosen):
        triangle = of_joint[names.index(base.parameters[base.independent[k]].owner)]
        column = float(np.linalg.norm(triangle[:, k]))
        whole = float(np.linalg.norm(triangle @ np.where(base.is_friction, estimate.beta, 0.0)))
        found[position] = max(whole, 1e-9) / column if column > 0 else max(abs(float(estimate.beta[k])), 1e-9)
    return found


def _rms(residual: Array, passes: RowPasses) -> Array:
    return np.sqrt(np.sum(residual**2, axis=0) / np.maximum(passes.counting.sum(axis=0), 1))
