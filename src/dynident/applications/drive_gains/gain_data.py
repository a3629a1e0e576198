"""The reduced rows of all runs, and what every method of this room shares: linearised rows, stacked and solved.

With the coupling C the torques at the joints are C' K i, so C^-T turns the rows of the joints into rows of the drives,
K i = C^-T (W beta + known). A row of a drive has the columns of beta, then those of a lean of the base where that is
free, then the known torque, then the current itself, and the current again as its target.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from dynident.applications.drive_gains.unknowns import Unknowns
from dynident.arrays import Array, BoolArray, IntArray
from dynident.data.preprocessing import at_rest
from dynident.identification.problem.problem import Problem, rest_speeds
from dynident.identification.problem.regressor_stream import RegressorStream, motion_of
from dynident.identification.residuals.row_passes import KEPT, RowPasses, Segment
from dynident.model.reduction import Triangle

#: A direction with unit columns below this share of the strongest is not determined at all.
NULL = 1e-8


@dataclass(frozen=True)
class GainData:
    """What the gains are found from.

    Attributes:
        rows: The rows of each run.
        triangles: The same reduced, by run and group.
        unknowns: What is known and what is not about the base parameters.
    """

    rows: tuple[DriveRows, ...]
    triangles: tuple[tuple[Triangle, ...], ...]
    unknowns: Unknowns

    @classmethod
    def of(cls, rows: Sequence[DriveRows], unknowns: Unknowns) -> GainData:
        """Return the data of some runs."""
        found = tuple(each.triangles(np.ones(each.counting.shape)) for each in rows)
        return cls(tuple(rows), found, unknowns)

    @property
    def groups(self) -> tuple[DriveGroup, ...]:
        """The G groups of rows that share a gain."""
        return self.rows[0].groups

    @property
    def counts(self) -> Array:
        """Number of rows of each group in all runs, shape (G,)."""
        return np.array([[t.rows for t in run] for run in self.triangles], dtype=float).sum(axis=0)

    @property
    def current_squares(self) -> Array:
        """Sum of squared currents of each group in all runs, shape (G,)."""
        return np.array([[t.torque_square for t in run] for run in self.triangles]).sum(axis=0)


@dataclass(frozen=True)
class Linearised:
    """Rows linear in the coordinates x = (one for each group, then z), as maps on the rows of the drives.

    The residual of a row e with target i is i - e vector, and its slopes with respect to x are e map.

    Attributes:
        maps: By run, shape (G, b + 2, P).
        vectors: By run, shape (G, b + 2).
        inverse: Whether the first G coordinates are the inverses of the gains, in A/N m, or the gains.
    """

    maps: tuple[Array, ...]
    vectors: tuple[Array, ...]
    inverse: bool


def current_rows(data: GainData, inverse_gains: Array, z: Array) -> Linearised:
    """Return the rows i = a (W beta + known), residuals in A, about inverse gains a (G,) and z (Z,)."""
    groups, unknowns = len(data.groups), data.unknowns
    maps, vectors = [], []
    for run in range(len(data.rows)):
        torque = np.append(unknowns.beta(run, z), [1.0, 0.0])
        slope = np.zeros((groups, len(torque), groups + unknowns.count))
        slope[np.arange(groups), :, np.arange(groups)] = torque
        slope[:, :-2, groups:] = inverse_gains[:, None, None] * unknowns.slopes(run, z)
        maps.append(slope)
        vectors.append(np.outer(inverse_gains, torque))
    return Linearised(tuple(maps), tuple(vectors), True)


def torque_rows(data: GainData, gains: Array, z: Array) -> Linearised:
    """Return the rows W known_s + known = K i - W slopes_s z, residuals in N m, at gains K (G,) and z (Z,)."""
    groups, unknowns = len(data.groups), data.unknowns
    maps, vectors = [], []
    for run in range(len(data.rows)):
        beta = unknowns.beta(run, z)
        slope = np.zeros((groups, len(beta) + 2, groups + unknowns.count))
        slope[np.arange(groups), -1, np.arange(groups)] = 1.0
        slope[:, :-2, groups:] = -unknowns.slopes(run, z)
        maps.append(slope)
        vectors.append(np.column_stack([np.tile(np.append(-beta, -1.0), (groups, 1)), 1.0 + gains]))
    return Linearised(tuple(maps), tuple(vectors), False)


def stacked(data: GainData, rows: Linearised, weights: Array) -> tuple[Array, Array]:
    """Return the weighted slopes and residuals of all reduced rows, what is known of z among them."""
    slopes, residuals = [], []
    for run, triangles in enumerate(data.triangles):
        for g, triangle in enumerate(triangles):
            own, factor = triangle.columns, triangle.factor
            slopes.append(weights[g] * factor[:, :-1] @ rows.maps[run][g, own])
            residuals.append(weights[g] * (factor[:, -1] - factor[:, :-1] @ rows.vectors[run][g, own]))
    return np.concatenate(slopes), np.concatenate(residuals)


def with_prior(data: GainData, slopes: Array, residuals: Array, z: Array) -> tuple[Array, Array]:
    """Return slopes and residuals with the rows z / deviation = 0 of what is known of z."""
    known = np.flatnonzero(np.isfinite(data.unknowns.deviations))
    if not len(known):
        return slopes, residuals
    deviations = data.unknowns.deviations[known]
    rows = np.zeros((len(known), slopes.shape[1]))
    rows[np.arange(len(known)), slopes.shape[1] - data.unknowns.count + known] = 1.0 / deviations
    return np.concatenate([slopes, rows]), np.concatenate([residuals, -z[known] / deviations])


def group_squares(data: GainData, rows: Linearised) -> Array:
    """Return the sum of squared residuals of each group over all runs, shape (G,)."""
    found = np.zeros(len(data.groups))
    for run, triangles in enumerate(data.triangles):
        for g, triangle in enumerate(triangles):
            own, factor = triangle.columns, triangle.factor
            found[g] += np.sum((factor[:, -1] - factor[:, :-1] @ rows.vectors[run][g, own]) ** 2)
    return found


def solved(slopes: Array, residuals: Array) -> Array:
    """Return the least-squares step of smallest norm with unit columns; directions that are null stay zero."""
    norms = np.linalg.norm(slopes, axis=0)
    scale = np.where(norms > 0, norms, 1.0)
    return np.linalg.lstsq(slopes / scale, residuals, rcond=NULL)[0] / scale


#: Share of a drive's root mean square current below which the sign of a current is not taken for sure.
SURE = 0.1


@dataclass(frozen=True)
class DriveGroup:
    """The rows of one drive that share a gain.

    Attributes:
        drive: Position among the drives.
        joint: Name of its joint.
        sign: ``"+"`` or ``"-"`` for rows with currents of one sign, empty for all rows.
    """

    drive: int
    joint: str
    sign: str = ""


def groups_of(joints: tuple[str, ...], signed: bool) -> tuple[DriveGroup, ...]:
    """Return a group for each drive, or two, one for each sign of its current."""
    signs = ("+", "-") if signed else ("",)
    return tuple(DriveGroup(k, name, sign) for k, name in enumerate(joints) for sign in signs)


class DriveRows(RowPasses):
    """The rows of the drives of some logs, as often as they are asked for; groups of rows stand where joints do.

    The torques of the problem's logs are C' i.

    Attributes:
        groups: Which rows share a gain, G of them.
        size: Number of columns, b + 2: the base parameters, the known torque, the current; b + 4 with ``pulls``.
    """

    def __init__(
        self, problem: Problem, signed: bool = False, kept: int = KEPT, pulls: Sequence[Array] | None = None
    ) -> None:
        """Take a problem; ``pulls`` are torques at the joints by a lean of the base, per log, shape (N, n, 2)."""
        super().__init__(problem, kept)
        robot = problem.model.robot
        self.groups = groups_of(robot.joint_names, signed)
        self._pulls = None if pulls is None else np.concatenate(pulls)
        free = 0 if pulls is None else 2
        self.size = problem.base.count + free + 2
        if free:  # one kernel for all directions of gravity
            self._regressor = RegressorStream(problem.model, problem.base, problem.load, any_gravity=True)
            self.columns = self._regressor.columns
        self._turn = np.linalg.inv(np.asarray(robot.coupling)).T
        self._joint_columns = self.columns
        self._known = [_known_torque(problem, k) for k in range(len(problem.logs))]
        self._own = [self._columns_of(drive) for drive in range(robot.dof)]
        ends = np.arange(problem.base.count, self.size)
        self.columns = tuple(np.concatenate([self._own[group.drive], ends]) for group in self.groups)
        self.counting = self._counting()

    def _columns_of(self, drive: int) -> IntArray:
        """Return the base parameters that matter at a drive: friction of other drives cancels."""
        problem = self.problem
        used = np.zeros(problem.base.count, bool)
        for joint in np.flatnonzero(self._turn[drive]):
            used[self._joint_columns[joint]] = True
        name = problem.model.robot.joint_names[drive]
        for k, standard in enumerate(problem.base.independent):
            if standard >= problem.model.inertial_count and problem.base.parameters[standard].owner != name:
                used[k] = False
        return np.flatnonzero(used)

    def _counting(self) -> BoolArray:
        """Return which rows count for each group, shape (N, G)."""
        found = []
        coupling = np.asarray(self.problem.model.robot.coupling)
        for log in self.problem.logs:
            moving = np.ones((len(log.keep), len(coupling)), bool)
            if log.how.rest == "mask" and log.how.standstill > 0:
                speeds = motion_of(log.log).dq @ coupling.T
                slowest = rest_speeds(self.problem.model.robot, log.how.standstill)
                moving = ~at_rest(speeds, slowest, log.log.rate)[log.keep]
            current = np.asarray(log.log.torque)[log.keep] @ self._turn.T
            level = SURE * np.sqrt(np.mean(current**2, axis=0))
            sure = {"": moving, "+": moving & (current > level), "-": moving & (current < -level)}
            found.append(np.column_stack([sure[group.sign][:, group.drive] for group in self.groups]))
        return np.concatenate(found)

    def __iter__(self) -> Iterator[Segment]:
        known = np.concatenate(self._known)
        for segment in super().__iter__():
            pulls = None if self._pulls is None else self._pulls[segment.samples]
            drives = [self._drive_block(k, segment, known[segment.samples], pulls) for k in range(len(self._own))]
            yield Segment(segment.samples, tuple(drives[group.drive] for group in self.groups))

    def _drive_block(self, drive: int, segment: Segment, known: Array, pulls: Array | None) -> Array:
        """Return the rows of a drive over a segment, transposed, shape (K + 3, m), or (K + 5, m) with pulls."""
        own = self._own[drive]
        block = np.zeros((len(own) + 3 + (0 if pulls is None else 2), known.shape[0]))
        for joint in np.flatnonzero(self._turn[drive]):
            part, share = segment.blocks[joint], self._turn[drive, joint]
            _, to, source = np.intersect1d(own, self._joint_columns[joint], return_indices=True)
            block[to] += share * part[source]
            block[-3] += share * known[:, joint]
            if pulls is not None:
                block[len(own) : len(own) + 2] += share * pulls[:, joint].T
            block[-1] += share * (part[-1] + known[:, joint])  # the problem's target has the known torque taken off
        block[-2] = block[-1]
        return block

    def group_residuals(self, vectors: Array) -> Array:
        """Return the target less the rows times a vector of each group, zero where a row does not count, (N, G).

        Args:
            vectors: Shape (G, b + 2).
        """
        residual = np.zeros(self.counting.shape)
        for segment in self:
            for g, (own, block) in enumerate(zip(self.columns, segment.blocks, strict=True)):
                residual[segment.samples, g] = block[-1] - vectors[g, own] @ block[:-1]
        return np.where(self.counting, residual, 0.0)


def _known_torque(problem: Problem, which: int) -> Array:
    """Return the filtered torque of known rotors and biases at the joints over the kept rows, shape (N, n)."""
    log, robot = problem.logs[which], problem.model.robot
    if not np.any(robot.reflected_inertia) and not np.any(robot.bias):
        return np.zeros((len(log.keep), robot.dof))
    return log.smooth(problem.model.known_torque(motion_of(log.log)).T).T[log.keep]
