"""How the fits of the joints of an arm move each other: each joint's parameters move the load of all the others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
from scipy.linalg import block_diag

from dynident.actuators.arm_motion import joint_motion
from dynident.actuators.joint_fit import JointData, JointFit
from dynident.actuators.joint_load import ArmMotion, MeasuredMotion, rigid_inertia
from dynident.actuators.output_error import ServoProblem, log_errors, log_weights
from dynident.actuators.parameters import PLACE
from dynident.actuators.verdict import DRAWS, Spread, spread_of
from dynident.arrays import Array
from dynident.model.kernels import batched
from dynident.model.robot import Robot

#: Farthest that the zero of any encoder moves in one turn, in rad: far from the answer the derivatives mislead.
LONGEST_STEP = 0.05

#: Changes by which derivatives are found: a share of the standard deviation, at most one of the value.
_OF_DEVIATION, _OF_VALUE = 0.3, 0.01

#: Singular values below this share of the largest, of columns of unit length, are directions that no log sees.
_UNSEEN = 1e-4


@dataclass(frozen=True)
class Arm:
    """An arm between two turns.

    Attributes:
        robots: The robot, of n joints, in each log.
        measured: Measured motion of each log.
        ends: Ends of the parts of the load of each log, each (K + 1,).
        motions: The motion of each log that the loads are of.
        datas: Each joint under these loads.
        fits: Of each joint.
        used: Parameters of each joint that the motions are by, each (COUNT,).
        coupling: Derivatives of the free parameters that the fits find by those that the motions are by, P of all
            joints together, shape (P, P); none before they are found.
        few: Training logs by which these are found; None for all.
        shared: Covariance that unknown bodies give the P free parameters, and the same of these over the size of the
            bodies, shape (2, P, P); none where they are known.
        turns: How far the zeros that the motions are by have gone in each turn, and those that the fits find, (2, n).
    """

    robots: Sequence[Robot]
    measured: Sequence[MeasuredMotion]
    ends: Sequence[Array]
    motions: Sequence[ArmMotion]
    datas: Sequence[JointData]
    fits: Sequence[JointFit]
    used: Sequence[Array]
    coupling: Array = field(default_factory=lambda: np.zeros((0, 0)))
    few: Sequence[int] | None = None
    shared: Array = field(default_factory=lambda: np.zeros((0, 0, 0)))
    turns: Sequence[Array] = ()

    def error(self) -> float:
        """Return the mean logarithm of the errors of the roll-outs, over joints and logs."""
        return float(np.mean([np.log(log_errors(one, fit.parameters)).mean() for one, fit in self.pairs()]))

    def part(self, logs: Sequence[int]) -> Arm:
        """Return the arm in some of the training logs."""
        return replace(
            self,
            robots=[self.robots[k] for k in logs],
            measured=[self.measured[k] for k in logs],
            ends=[self.ends[k] for k in logs],
            motions=[self.motions[k] for k in logs],
            datas=[data.part(logs) for data in self.datas],
            few=None,
        )

    def pairs(self) -> list[tuple[ServoProblem, JointFit]]:
        """Return the roll-outs and the fit of each joint."""
        return [(fit.problem(data), fit) for data, fit in zip(self.datas, self.fits, strict=True)]

    def spreads(self) -> list[Spread]:
        """Return how the errors of each joint spread its parameters, those of the others as they are."""
        return [spread_of(one, fit.parameters) for one, fit in self.pairs()]

    def fine_spreads(self, beside: Sequence[Array | None]) -> list[Spread]:
        """Return the same with the step of the answer, over roll-outs drawn within what the others do too.

        Args:
            beside: Covariance of the free parameters of each joint by the errors of the others, each (f, f), or None.
        """
        pairs = zip(self.pairs(), beside, strict=True)
        return [spread_of(one.finely, fit.parameters, DRAWS, more) for (one, fit), more in pairs]

    @property
    def firsts(self) -> list[int]:
        """Place of the first free parameter of each joint among the P of all, and P."""
        return [0, *np.cumsum([len(fit.free) for fit in self.fits]).tolist()]

    @property
    def zeros(self) -> list[int]:
        """Places of the encoders' zeros that are sought among the P of all."""
        sought = [(first, fit.free) for first, fit in zip(self.firsts[:-1], self.fits, strict=True)]
        return [first + free.index("angle_offset") for first, free in sought if "angle_offset" in free]

    def coupled(self, spreads: Sequence[Spread], is_whole: bool) -> Arm:
        """Return the arm with the derivatives of what the fits find by what the motions are by.

        Args:
            spreads: Of each joint.
            is_whole: Whether by all parameters; else by the zeros of the encoders alone, the readings as they are,
                which leads to the answer from afar.
        """
        firsts, arm = self.firsts, self if self.few is None else self.part(self.few)
        found = np.zeros((firsts[-1], firsts[-1]))
        theirs = [Response(one, fit, spread) for (one, fit), spread in zip(arm.pairs(), spreads, strict=True)]
        for joint, ((one, _), spread) in enumerate(zip(arm.pairs(), spreads, strict=True)):
            values, deviations = self.used[joint][one.places], np.sqrt(np.diag(spread.covariance))
            most = _OF_VALUE * np.maximum(np.abs(values), one.scales())
            sizes = np.minimum(_OF_DEVIATION * deviations, most)
            counts = spread.inner & spread.seen & (sizes > 0)
            if not is_whole:
                counts &= np.array(one.free) == "angle_offset"
            for column in np.flatnonzero(counts).tolist():
                moved = values.copy()
                moved[column] += sizes[column]
                torques = arm.torques(joint, one.full(moved, self.used[joint]), is_whole)
                for other in set(range(len(theirs))) - {joint}:
                    rows = slice(firsts[other], firsts[other + 1])
                    change = theirs[other].to([torque[:, other] for torque in torques])
                    found[rows, firsts[joint] + column] = change / sizes[column]
        return replace(self, coupling=found if is_whole else self._as_seen(found, spreads))

    def _as_seen(self, coupling: Array, spreads: Sequence[Spread]) -> Array:
        """Return derivatives, shape (P, P), that agree with how the turns so far have moved the zeros.

        A mode of the arm that each joint finds as it is put into the others has a derivative near 1: on the wrong side
        of 1 the zeros would go away from where they agree. Broyden, "A class of methods for solving nonlinear
        simultaneous equations", Mathematics of Computation 19, 1965; a turn counts by how far it goes beyond the noise.

        Args:
            coupling: By small changes; changed in place.
            spreads: Of each joint.
        """
        block, sought = np.ix_(self.zeros, self.zeros), ["angle_offset" in fit.free for fit in self.fits]
        noise = np.concatenate([np.diag(spread.covariance) for spread in spreads])[self.zeros]
        for moved, found in (turn[:, sought] for turn in self.turns):
            size = max(float(moved @ moved), 1e-300)
            left = found - coupling[block] @ moved
            coupling[block] += np.outer(left, moved) / (size + moved**2 @ noise / size)
        return coupling

    def since(self, before: Arm) -> Arm:
        """Return the arm after a turn, which it remembers."""
        place = PLACE["angle_offset"]
        used, found = (
            np.array([now[place] - then[place] for now, then in zip(*pair, strict=True)])
            for pair in (
                (self.used, before.used),
                ([fit.parameters for fit in self.fits], [fit.parameters for fit in before.fits]),
            )
        )
        return replace(self, turns=[*before.turns, np.array([used, found])])

    def torques(self, joint: int, parameters: Array, is_whole: bool) -> list[Array]:
        """Return the change of the bodies' torque in each training log by other parameters of a joint, each (K, n)."""
        found, place = [], PLACE["angle_offset"]
        zero = float(parameters[place] - self.used[joint][place])
        for k, record in enumerate(self.datas[joint].train):
            robot, motion = self.robots[k], self.motions[k]
            q, dq, ddq = motion.q.copy(), motion.dq.copy(), motion.ddq.copy()
            q[:, joint] += zero
            if is_whole:
                first = record.as_first_read
                both = self.used[joint], parameters
                pair = (joint_motion(first, own, self.measured[k], self.ends[k]) for own in both)
                for column, old, new in zip((q, dq, ddq), *pair, strict=True):
                    column[:, joint] += new - old
            theta = rigid_inertia(robot)
            old = batched.inverse_dynamics(robot.chain, theta, motion.q, motion.dq, motion.ddq)
            found.append(batched.inverse_dynamics(robot.chain, theta, q, dq, ddq) - old)
        return found

    @property
    def fitted(self) -> Array:
        """Free parameters that the fits have found, shape (P,)."""
        return np.concatenate([fit.parameters[one.places] for one, fit in self.pairs()])

    @property
    def moved_by(self) -> Array:
        """Free parameters that the motions are by, shape (P,); those found where they are by none."""
        used = np.concatenate([used[one.places] for (one, _), used in zip(self.pairs(), self.used, strict=True)])
        return np.where(np.isfinite(used), used, self.fitted)

    @property
    def reach(self) -> Array:
        """How an error of each fit reaches all of them where they find themselves, (I - G)^-1, shape (P, P)."""
        return np.asarray(np.linalg.inv(np.eye(len(self.coupling)) - self.coupling))

    def step(self, share: float = 1.0) -> Array:
        """Return the step to parameters that find themselves, shape (P,).

        Motions by the parameters p let the fits find f(p); with its derivatives G the fixed point is
        p + (I - G)^-1 (f(p) - p).

        Args:
            share: Of what the joints change of each other, that is gone.
        """
        alone = self.fitted - self.moved_by
        step = alone + share * (self.reach @ alone - alone)
        return step * min(1.0, LONGEST_STEP / max(float(np.abs(step[self.zeros]).max(initial=0.0)), 1e-12))

    def reached(self, spreads: Sequence[Spread], reach: Array, step: Array) -> list[Spread]:
        """Return the spread that all joints give each other; those that do not agree yet are not known better.

        Args:
            spreads: Of each joint, those of the others as they are.
            reach: Of the errors of the fits, shape (P, P).
            step: That is left, shape (P,).
        """
        own = np.asarray(block_diag(*[spread.covariance for spread in spreads]))
        return self.with_shared(spreads, reach @ own @ reach.T + np.outer(step, step))

    def with_shared(self, spreads: Sequence[Spread], covariance: Array) -> list[Spread]:
        """Return the spread of each joint by a covariance of all free parameters and what the bodies add, (P, P)."""
        owns = [slice(*ends) for ends in pairwise(self.firsts)]
        if not self.shared.size:
            return [replace(one, covariance=covariance[own, own]) for one, own in zip(spreads, owns, strict=True)]
        whole, ratio = covariance + self.shared
        pairs = zip(spreads, owns, strict=True)
        return [replace(one, covariance=whole[own, own], ratio=ratio[own, own]) for one, own in pairs]

    def after(self, step: Array) -> list[JointFit]:
        """Return the fits after a step of all free parameters, shape (P,), within their bounds."""
        fits, found = [], self.moved_by + step
        for (one, fit), ends in zip(self.pairs(), pairwise(self.firsts), strict=True):
            values = np.clip(found[slice(*ends)], *one.bounds())
            fits.append(replace(fit, parameters=one.full(values, fit.parameters)))
        return fits


class Response:
    """How errors of the roll-outs of a joint, and the free parameters that its fit finds, answer to its load."""

    def __init__(self, problem: ServoProblem, fit: JointFit, spread: Spread) -> None:
        self.problem, self.parameters = problem, fit.parameters
        self.errors = problem.residuals(fit.parameters)
        slopes = problem.errors(fit.parameters)[1]
        weights = log_weights(problem, fit.parameters)
        self.scales = [weight / np.sqrt(len(error)) for weight, error in zip(weights, self.errors, strict=True)]
        rows = np.concatenate([slope * scale for slope, scale in zip(slopes, self.scales, strict=True)])
        self.free = np.flatnonzero(spread.inner & spread.seen)
        self.sizes = np.maximum(np.linalg.norm(rows[:, self.free], axis=0), 1e-300)
        self.solve = np.linalg.pinv(rows[:, self.free] / self.sizes, rcond=_UNSEEN)

    def changes(self, more: Sequence[Array]) -> list[Array]:
        """Return the change of the errors in each log under loads with more inertia and bias torque, each (K, 2)."""
        records = []
        for record, change in zip(self.problem.records, more, strict=True):
            loads = record.loads.copy()
            loads[:, :2] += change
            records.append(replace(record, loads=loads))
        errors = replace(self.problem, records=tuple(records)).residuals(self.parameters)
        return [new - old for new, old in zip(errors, self.errors, strict=True)]

    def to(self, torques: Sequence[Array]) -> Array:
        """Return the change of the free parameters, shape (f,), under loads that are more by torques, each (K,)."""
        more = [np.column_stack([np.zeros_like(torque), torque]) for torque in torques]
        change = [own * scale for own, scale in zip(self.changes(more), self.scales, strict=True)]
        found = np.zeros(len(self.problem.free))
        found[self.free] = -(self.solve @ np.concatenate(change)) / self.sizes
        return found

    def less_own(self, beside: Sequence[Array]) -> tuple[list[Array], list[Array], Array]:
        """Return derivatives and errors, weighted, less what the free parameters and the start of each log explain.

        Args:
            beside: Derivatives of the errors by d other numbers, log by log, each (N, d).

        Returns:
            The derivatives by these, each (N, d), the errors, each (N,), and what the free parameters answer to the
            numbers and to the errors, shape (f, d + 1).
        """
        errors, slopes = self.problem.errors(self.parameters, beside)
        count, ends = len(self.problem.free), np.cumsum([len(error) for error in errors])[:-1]
        rows = np.concatenate([slope * scale for slope, scale in zip(slopes, self.scales, strict=True)])
        error = np.concatenate([own * scale for own, scale in zip(errors, self.scales, strict=True)])
        own, others = rows[:, self.free] / self.sizes, rows[:, count:]
        answer, taken = self.solve @ others, self.solve @ error
        found = np.zeros((count, others.shape[1] + 1))
        found[self.free] = -np.column_stack([answer, taken]) / self.sizes[:, None]
        return np.split(others - own @ answer, ends), np.split(error - own @ taken, ends), found
