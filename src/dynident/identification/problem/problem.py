"""The identification problem: one triangle per joint and, for estimators that need them, the rows themselves."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Protocol

import numpy as np

from dynident.arrays import Array, BoolArray, IntArray
from dynident.data.log import Log
from dynident.data.preprocessing import Prepared, Preprocessing, at_rest
from dynident.errors import BadOption, LogMismatch, PoorExcitation
from dynident.identification.problem.choices import Choices
from dynident.identification.problem.kept_rows import KeptRows, kept_rows
from dynident.identification.problem.prior import BodyPrior
from dynident.identification.problem.regressor_stream import RegressorStream, motion_of
from dynident.model.base_parameters import BaseParameters
from dynident.model.body_constraints import Constraints
from dynident.model.dynamic_model import DynamicModel
from dynident.model.reduction import Reduced, Triangle, reduce
from dynident.model.robot import Robot


@dataclass(frozen=True)
class Rows:
    """The observation matrix in full, joint by joint, samples at rest left out.

    Attributes:
        matrix: W, shape (r, b).
        torque: Measured torque less the known one, shape (r,).
        joint: Joint of each row, shape (r,).
        samples: Time sample of each row, counted through all logs, shape (r,).
    """

    matrix: Array
    torque: Array
    joint: IntArray
    samples: IntArray


class LeftOver(Protocol):
    """What is still known of rows that were reduced as a stream and are gone; triangles are in the problem.

    Attributes:
        samples: Number of time samples in all logs.
        accelerations: Root mean square acceleration of each joint, shape (n,).
    """

    samples: int
    accelerations: Array

    def factors(self, beta: Array) -> Array:
        """Return the correlation factor of each joint's residual at ``beta``, shape (n,)."""
        ...

    def uncertainty(self, inverse: Array, weights: Array, beta: Array) -> tuple[Array, Array]:
        """Return covariance and degrees of freedom of a fit with the inverse normal matrix (b, b) and weights (n,)."""
        ...


@dataclass(frozen=True)
class Problem:
    """All that an estimator may know.

    Attributes:
        model: Robot, drives and friction.
        base: The base parameters that are to be found.
        logs: Preprocessed logs with q, dq, ddq and torque.
        masks: Which of the kept rows count for each joint, per log, shape (N, n).
        triangles: The unweighted rows of each joint, reduced, over all logs.
        load: Base parameters whose torque without friction loads the drives, shape (b,); None where no part asks.
        choices: What was chosen on the way to the problem, such as the delay of each log; goes with the estimate.
        constraints: What is known about bodies beforehand; estimators of possible robots keep it, others do not.
        prior: Standard parameters known beforehand, in place of the robot model's; None for the robot model's.
        left: What is known of rows that are gone; None where logs and rows are there.
        kept: The rows of the logs, where they were made already and fit into memory.
        bias: By noise of the positions, shape (b,), that the triangles go without; None where it stays in.
    """

    model: DynamicModel
    base: BaseParameters
    logs: tuple[Prepared, ...]
    masks: tuple[BoolArray, ...]
    triangles: tuple[Triangle, ...]
    load: Array | None = None
    choices: Choices = field(default_factory=Choices)
    constraints: Constraints = field(default_factory=Constraints)
    prior: BodyPrior | None = None
    left: LeftOver | None = None
    kept: KeptRows | None = field(default=None, repr=False, compare=False)
    bias: Array | None = None

    def __post_init__(self) -> None:
        """Let go of rows that are those of other logs, base parameters or another load, as after ``replace``."""
        if self.kept is not None and not self.kept.are_of(self.logs, self.base, self.load):
            object.__setattr__(self, "kept", None)

    @property
    def regressor(self) -> RegressorStream:
        """What makes the rows of the problem from a log."""
        return RegressorStream(self.model, self.base, self.load)

    @property
    def preprocessing(self) -> Preprocessing:
        """How logs that had no part in the fit are prepared: as those of the problem, with the delay found there."""
        own, delay_s = self.logs[0].how, self.choices.delay_s
        return own if delay_s is None else replace(own, delay_s=delay_s)

    @property
    def samples(self) -> int:
        """Number of time samples in all logs."""
        return self.left.samples if self.left is not None else sum(len(log.keep) for log in self.logs)

    @property
    def counts(self) -> IntArray:
        """Number of rows that count, per joint, shape (n,)."""
        return np.array([triangle.rows for triangle in self.triangles])

    def reduced(self, weights: Sequence[float] | Array | None = None) -> Reduced:
        """Return the triangle over all joints, each joint's rows times its weight (default 1)."""
        return reduce(self.triangles, self.base.count, np.ones(len(self.triangles)) if weights is None else weights)

    def residual_squares(self, beta: Array) -> Array:
        """Return the sum of squared residuals of each joint at ``beta``, shape (n,)."""
        return np.array([triangle.residual_square(beta) for triangle in self.triangles])

    def joint_deviations(self, beta: Array) -> Array:
        """Return the residual standard deviation of each joint, shape (n,), a millionth of its torque at least.

        The degrees of freedom that beta takes are shared among the joints by their rows.
        """
        counts = np.maximum(self.counts, 1)
        free = counts * max(1.0 - self.base.count / max(int(counts.sum()), 1), 1e-3)
        floor = 1e-6 * np.array([np.sqrt(t.torque_square / max(t.rows, 1)) for t in self.triangles])
        deviations = np.sqrt(self.residual_squares(beta) / free)
        return np.maximum(deviations, np.maximum(floor, 1e-300))

    def without(self, bias: Array) -> Problem:
        """Return the problem whose triangles go without a bias, shape (b,)."""
        return replace(self, triangles=tuple(each.shifted(bias) for each in self.triangles), bias=bias)

    @cached_property
    def rows(self) -> Rows:
        """The rows in full; computed when first asked for."""
        regressor = self.regressor
        blocks: list[list[tuple[Array, Array, IntArray]]] = [[] for _ in self.triangles]
        start = 0
        for log, mask in zip(self.logs, self.masks, strict=True):
            for i, part in enumerate(regressor.rows(log)):
                keep = np.flatnonzero(mask[:, i])
                full = np.zeros((len(keep), self.base.count))
                full[:, regressor.columns[i]] = part[:-1, keep].T
                blocks[i].append((full, part[-1, keep], keep + start))
            start += len(log.keep)
        matrix = np.concatenate([block[0] for joint in blocks for block in joint])
        torque = np.concatenate([block[1] for joint in blocks for block in joint])
        samples = np.concatenate([block[2] for joint in blocks for block in joint])
        joints = np.concatenate([np.full(len(block[1]), i) for i, joint in enumerate(blocks) for block in joint])
        return Rows(matrix, torque, joints, samples)


def make_problem(
    model: DynamicModel,
    base: BaseParameters,
    logs: Sequence[Prepared],
    load: Array | None = None,
    before: KeptRows | None = None,
) -> Problem:
    """Reduce preprocessed logs to a problem.

    Args:
        model: Robot, drives and friction.
        base: Its base parameters.
        logs: Preprocessed logs, joints in the order of the robot.
        load: See :class:`Problem`.
        before: Rows of these logs with another load, or without the friction that depends on it.

    Raises:
        BadOption: A friction part needs a load that is not given, or coefficients depend on each other in any motion.
        LogMismatch: A log without the temperatures that a friction part needs, a joint that never moved, or a torque
            that never changed.
        PoorExcitation: The rows do not determine all base parameters.
    """
    check_friction(model, base)
    check_temperature(model, [log.log for log in logs])
    names = ", ".join(log.log.name for log in logs)
    check_motion(model.robot, np.max([np.ptp(log.log.q, axis=0) for log in logs], axis=0), names)
    torques = [log.log.torque if log.log.raw_torque is None else log.log.raw_torque for log in logs]
    if known := [torque for torque in torques if torque is not None]:
        low, high = (pick([pick(torque, axis=0) for torque in known], axis=0) for pick in (np.min, np.max))
        check_torque(model.robot, (low, high), names)
    problem = unreduced(model, base, logs, load)
    regressor, masks = problem.regressor, problem.masks
    kept = before.updated(regressor) if before is not None and before.has_logs(logs) else None
    kept = kept or kept_rows(regressor, logs)
    made = kept.segments if kept is not None else [None] * len(logs)
    parts = [regressor.triangles(log, mask, own) for log, mask, own in zip(logs, masks, made, strict=True)]
    triangles = tuple(first.merged(rest) for first, *rest in zip(*parts, strict=True))
    problem = replace(problem, triangles=triangles, kept=kept)
    check_rank(problem.reduced(), base)
    return problem


def unreduced(
    model: DynamicModel, base: BaseParameters, logs: Sequence[Prepared], load: Array | None = None
) -> Problem:
    """Return the problem of preprocessed logs without its triangles; arguments as of :func:`make_problem`."""
    return Problem(model, base, tuple(logs), tuple(counting_rows(model, log) for log in logs), (), load)


def counting_rows(model: DynamicModel, prepared: Prepared) -> BoolArray:
    """Return which of the kept rows count for each joint, shape (N, n): where none of its drives rests.

    Nor do those count at the start of a log in which friction that remembers depends on what was before.
    """
    how, remembering = prepared.how, [part for part in model.friction if part.states]
    rests = how.rest != "keep" and how.standstill != 0
    if not rests and not remembering:
        return np.ones((len(prepared.keep), model.robot.dof), bool)
    coupling = np.asarray(model.robot.coupling)
    at_motors = motion_of(prepared.log).at_motors(coupling)
    aside = np.zeros(at_motors.q.shape, dtype=bool)
    if rests:
        aside |= at_rest(at_motors.dq, rest_speeds(model.robot, how.standstill), prepared.log.rate)
    for part in remembering:
        drives = list(model.drives_of(part))
        aside[:, drives] |= part.is_unsettled(at_motors.of_drives(drives))
    return ~((aside[prepared.keep] @ (coupling != 0)) > 0)


def rest_speeds(robot: Robot, standstill: float) -> Array:
    """Return the speed below which each joint rests, shape (n,): ``standstill`` in rad/s, of slides less, in m/s."""
    return standstill * np.array([joint.speed_scale for joint in robot.active])


def check_rank(reduced: Reduced, base: BaseParameters) -> None:
    """Check that rows, weighted or chosen in whatever way, determine all base parameters.

    Raises:
        PoorExcitation: A direction with unit columns is below 1e-9 of the strongest.
    """
    norms = reduced.column_norms
    scale = np.where(norms > 0, norms, 1.0)
    _, values, directions = np.linalg.svd(reduced.r / scale)
    weak = values <= 1e-9 * values[0]
    if not weak.any():
        return
    share = np.abs(directions[weak]).max(axis=0)
    names = [base.names[k] for k in np.argsort(-share)[:3]]
    raise PoorExcitation(
        int((~weak).sum()),
        base.count,
        f"undetermined: {'; '.join(names)}",
        "record a motion that moves all joints fast and far at once, or drop friction terms",
    )


def check_friction(model: DynamicModel, base: BaseParameters) -> None:
    """Refuse friction parts whose coefficients count in combination alone, whatever the motion; springs may."""
    spring = [part.is_spring for part in model.friction for _ in part.coefficients]
    grouped = base.matters & np.array([p.kind == "friction" for p in base.parameters])
    grouped[:, model.inertial_count :] &= ~np.array(spring, dtype=bool)[model.terms[1]]
    grouped[:, base.independent] = False
    for row in np.flatnonzero(grouped.any(axis=1)):
        step = (
            "no motion tells these coefficients apart; leave a part of theirs out, or state other values of its fields"
        )
        raise BadOption("friction", base.names[row], step)


def check_temperature(model: DynamicModel, logs: Sequence[Log]) -> None:
    """Refuse logs without the temperatures that a friction part asks for."""
    for log in logs:
        if "temperature" in model.needs and log.temperature is None:
            step = "map them in the case file (log: columns: temperature), or leave the friction part out"
            raise LogMismatch(log.name, "no temperatures of the drives", step)


def check_motion(robot: Robot, span: Array, logs: str) -> None:
    """Name the joints that never move by their spans (n,) in all logs: the case must say that they are locked."""
    still = [name for name, moved in zip(robot.joint_names, span, strict=True) if moved < 1e-3]
    if still:
        ranges = ", ".join(f"{s:.2g}" for s in span[span < 1e-3])
        step = "lock it in the case file (locked: {" + still[0] + ": 0}) or record a motion of all joints"
        raise LogMismatch(logs, f"{', '.join(still)} never moved (range {ranges} rad or m)", step)


def check_torque(robot: Robot, ends: Iterable[Array], logs: str) -> None:
    """Name the joints whose lowest and highest torque (n,) are one: no sensor says that of a joint that moves."""
    for name, unit, low, high in zip(robot.joint_names, robot.units, *ends, strict=True):
        if high - low <= 1e-12 * abs(high):
            evidence = f"{name} moves but its torque is {high:.4g} {unit} throughout"
            raise LogMismatch(logs, evidence, "map the right column, or leave the joint out (locked:)")
