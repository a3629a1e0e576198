"""Causes that show only against the bodies of the robot model: a load, a counterbalance that carries weight, a scale.

A fit of base parameters takes all of these in: they have the torque of a body. So bodies are held as they are
described, friction alone is fitted, and what is left is explained. Where bodies are described so badly that no one
cause brings the fit near to that of free bodies, nothing is said.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property

import numpy as np

from dynident.arrays import Array
from dynident.diagnosis.causes.cause_search import Blame, Cause, CauseRows, CauseSearch
from dynident.diagnosis.causes.trends import OVERSAMPLING, Trends
from dynident.identification.problem.regressor_stream import motion_of
from dynident.model.kernels import batched
from dynident.model.robot import Robot

#: Columns of a body.
TEN = 10

#: A column, or a combination of columns, of a body below this share of the strongest one is rounding.
ZERO, DEPENDENT = 1e-8, 1e-4

#: A load is likelier than a wrong link: on the axis of the last joint both have the same torque.
LIKELIER = 1.05


class Against:
    """What the torques leave where bodies, and rotors that are known, are held as described.

    Attributes:
        fit: The quick fit, whose bodies are free.
        theta: Standard parameters of the robot model, shape (p,).
        robot: The robot with its known rotor inertias; None where they are to be identified.
    """

    def __init__(self, trends: Trends, theta: Array, robot: Robot | None) -> None:
        self.fit, self.theta, self.robot, self._trends = trends.fit, theta, robot, trends

    @cached_property
    def rows(self) -> CauseRows:
        """Friction columns alone, rotors with them where they are not known; torques of described bodies taken off."""
        fit, rows = self.fit, self.fit.rows
        free = fit.base.is_friction if self.robot is not None else fit.base.independent >= fit.model.inertial_count
        merged = self._rotors([] if self.robot is not None else self._merged())
        blocks, columns = [], []
        for i, (block, own) in enumerate(zip(rows.blocks, rows.columns, strict=True)):
            blocks.append(np.column_stack([block[:, free[own]], merged[:, :, i].T]))
            columns.append(np.concatenate([own[free[own]], fit.base.count + np.arange(len(merged))]))
        target = rows.torque - rows.known - self.bodies - self._known_rotors()
        size = fit.base.count + len(merged)
        return CauseRows(blocks, columns, size, target, rows.torque, rows.masks, OVERSAMPLING)

    def _merged(self) -> list[int]:
        """Return the drives whose rotor inertia base parameters count with the bodies."""
        model, independent = self.fit.model, set(self.fit.base.independent.tolist())
        lost = [k for k, p in enumerate(model.parameters) if p.kind == "rotor" and k not in independent]
        return [int(model.terms[0][k - model.inertial_count]) for k in lost]

    def _rotors(self, drives: list[int]) -> Array:
        """Return the torque of rotors of 1 kg m^2, filtered, (k, N, n)."""
        model, prepared = self.fit.model, self.fit.rows.prepared
        coupling = np.asarray(model.robot.coupling)
        ddq = np.asarray(prepared.log.ddq) @ coupling.T
        smooth = [prepared.smooth((ddq[:, j, None] * coupling[j]).T).T[prepared.keep] for j in drives]
        return np.array(smooth).reshape(-1, len(prepared.keep), model.robot.dof)

    def _known_rotors(self) -> Array:
        """Return the torque of the rotors that are known, filtered, shape (N, n)."""
        prepared = self.fit.rows.prepared
        if self.robot is None:
            return np.zeros_like(self.fit.rows.torque)
        torque = np.asarray(prepared.log.ddq) @ self.robot.reflected_inertia
        return prepared.smooth(torque.T).T[prepared.keep]

    @cached_property
    def each(self) -> Array:
        """Torque of one unit of each inertial parameter, filtered, over the kept rows, shape (10 l, N, n)."""
        prepared = self.fit.rows.prepared
        motion = motion_of(prepared.log)
        chain = self.fit.model.robot.chain
        regressor = batched.torque_regressor(chain, motion.q, motion.dq, motion.ddq, once=True)
        flat = regressor.transpose(2, 1, 0).reshape(-1, len(regressor))
        smooth = prepared.smooth(flat)[:, prepared.keep]
        return smooth.reshape(regressor.shape[2], regressor.shape[1], -1).transpose(0, 2, 1)

    @cached_property
    def bodies(self) -> Array:
        """Torque of the described bodies, filtered, shape (N, n)."""
        return np.tensordot(self.theta[: self.fit.model.inertial_count], self.each, 1)

    @cached_property
    def search(self) -> CauseSearch:
        """The products of all columns."""
        return CauseSearch(self.rows, list(self._causes()))

    @cached_property
    def blames(self) -> tuple[Blame, ...]:
        """The causes that are sure, the one that explains most first."""
        return self.search.blames()

    @cached_property
    def excess(self) -> float:
        """By how much the sum of the log variances falls when the bodies are free, beyond what noise alone gives.

        Of columns that say nothing, each takes away one of the independent rows of a joint.
        """
        free = int(np.count_nonzero(self.fit.base.independent < self.fit.model.inertial_count))
        by_noise = free / float(np.mean(self.fit.independent_rows))
        return self.search.fit([]).score - self.fit.plain.score - by_noise

    def columns_of(self, link: int) -> tuple[Array, Array]:
        """Return independent columns of a body, (k, N, n), and its ten parameters for one unit of each, (10, k)."""
        columns = self.each[TEN * link : TEN * (link + 1)]
        masks = self.fit.rows.masks
        rows = np.where(masks, columns / np.sqrt(self.fit.plain.variances), 0.0).reshape(TEN, -1)
        norms = np.linalg.norm(rows, axis=1)
        live = np.flatnonzero(norms > ZERO * norms.max(initial=0.0))
        if not len(live):
            return np.zeros((0, *masks.shape)), np.zeros((TEN, 0))
        directions, sizes, _ = np.linalg.svd(rows[live] / norms[live, None], full_matrices=False)
        kept = directions[:, sizes > DEPENDENT * sizes[0]]
        parameters = np.zeros((TEN, kept.shape[1]))
        parameters[live] = kept / norms[live, None]
        return np.tensordot(parameters.T, columns, 1), parameters

    def load(self, blame: Blame) -> tuple[float, float]:
        """Return the mass of a load at the flange and its deviation, in kg."""
        mass = self.columns_of(len(self.fit.model.robot.links) - 1)[1][-1]
        return float(mass @ blame.values), float(np.sqrt(max(mass @ blame.covariance @ mass, 0.0)))

    def _causes(self) -> Iterator[Cause]:
        links = self.fit.model.robot.links
        yield Cause("load at the flange", "", self.columns_of(len(links) - 1)[0], LIKELIER)
        for k, link in enumerate(links[:-1]):
            columns, _ = self.columns_of(k)
            if len(columns):
                yield Cause("described body", link.name, columns)
        yield Cause("torque scale", "", self.bodies[None])
        local = ("counterbalance", "spring", "tilt", "torque scale", "drift", "time scale", "friction drift")
        for cause in self._trends.causes:
            if cause.name in local:
                yield cause
