"""What has changed since an earlier estimate: its bodies, with their covariance, as a prior of the fit.

Friction is another one on another day and stays free. Base parameters of the earlier estimate and of the quick fit are
told apart by their maps, so that gravity, rotors and friction may differ: what both know counts, the rest is free.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.special

from dynident.arrays import Array, IntArray
from dynident.diagnosis.causes.against_robot_model import TEN
from dynident.diagnosis.causes.cause_search import Cause, CauseRows, CauseSearch
from dynident.diagnosis.causes.quick_fit import PASSES, RIDGE, Solved
from dynident.diagnosis.causes.trends import OVERSAMPLING, Trends
from dynident.identification.estimate.estimate import Estimate
from dynident.identification.problem.regressor_stream import motion_of
from dynident.model.base_parameters import BaseParameters
from dynident.model.dynamic_model import DynamicModel
from dynident.model.kernels import batched
from dynident.model.robot import Robot

#: A map of base parameters whose rest is below this share of it is the same.
SAME = 1e-6

#: Deviations of the earlier estimate below this share of its largest, all with unit columns, are rounding.
SMALLEST = 1e-6

#: Chance of so large a difference below which an earlier estimate contradicts the robot model.
CONTRADICTS = 1e-3

#: Causes that have no meaning against bodies: friction may be another one.
LEFT_OUT = ("friction curve",)


@dataclass(frozen=True)
class KnownBodies:
    """A normal prior of some of the columns of a fit.

    Attributes:
        places: Positions in beta, shape (s,).
        factor: Root of the information, shape (s, s).
        values: The mean, shape (s,).
    """

    places: IntArray
    factor: Array
    values: Array

    def agrees(self, beta: Array) -> bool:
        """Return whether it does not contradict other values of beta."""
        squares = float(np.sum((self.factor @ (beta[self.places] - self.values)) ** 2))
        return bool(scipy.special.chdtrc(len(self.places), squares) > CONTRADICTS)


def known_bodies(estimate: Estimate, model: DynamicModel, base: BaseParameters) -> KnownBodies | None:
    """Return what an estimate knows of the bodies among the base parameters of a model; None where it is nothing."""
    if not np.all(np.isfinite(estimate.covariance)):
        return None  # of a method without intervals
    theirs = {parameter.name: k for k, parameter in enumerate(estimate.base.parameters)}
    bodies = estimate.base.independent < estimate.model.inertial_count
    rows = estimate.base.matrix[bodies]
    rotors = _rotors(estimate.model.robot)
    places, maps, added = [], [], []
    for k in np.flatnonzero(base.independent < model.inertial_count):
        wanted, offset, sound = np.zeros(rows.shape[1]), 0.0, True
        for column in np.flatnonzero(base.matters[k]):
            parameter, share = base.parameters[column], float(base.matrix[k, column])
            if parameter.name in theirs:
                wanted[theirs[parameter.name]] = share
            elif parameter.kind == "rotor":
                offset += share * rotors.get(parameter.owner, 0.0)
            else:
                sound = False
        mix = np.linalg.lstsq(rows.T, wanted, rcond=None)[0]
        if sound and np.linalg.norm(rows.T @ mix - wanted) < SAME * np.linalg.norm(wanted):
            places.append(k)
            maps.append(mix)
            added.append(offset)
    if not places:
        return None
    mixing = np.array(maps)
    covariance = mixing @ estimate.covariance[np.ix_(bodies, bodies)] @ mixing.T
    sizes = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    squares, directions = np.linalg.eigh(covariance / np.outer(sizes, sizes))
    factor = (directions / np.sqrt(np.maximum(squares, SMALLEST**2 * squares[-1]))).T / sizes
    return KnownBodies(np.array(places, dtype=np.int64), factor, mixing @ estimate.beta[bodies] + np.array(added))


def with_rotors(theta: Array, model: DynamicModel, robot: Robot) -> Array:
    """Return standard parameters (p,) of a model with the rotor inertias that a robot states."""
    rotors, filled = _rotors(robot), np.array(theta)
    for k, parameter in enumerate(model.parameters):
        if parameter.kind == "rotor":
            filled[k] = rotors.get(parameter.owner, 0.0)
    return filled


def _rotors(robot: Robot) -> dict[str, float]:
    """Return the rotor inertia of each joint, behind its gear, by name."""
    return dict(zip(robot.joint_names, np.diag(robot.reflected_inertia).tolist(), strict=True))


class Anchored(CauseSearch):
    """A search in which some columns have a prior; rows count as often as they are independent in the plain fit."""

    def __init__(self, rows: CauseRows, causes: Sequence[Cause], known: KnownBodies, factors: Array) -> None:
        super().__init__(rows, causes)
        self._known, self._factors = known, factors

    def fit(self, chosen: Sequence[int]) -> Solved:
        grams, sides = self.products(chosen)
        pull = np.zeros((len(self._known.values), grams.shape[-1]))
        pull[:, self._known.places] = self._known.factor
        target = self._known.factor @ self._known.values
        counts, squares, floors = self.rows.counts, self.squares, self.floors
        variances = squares / counts + floors
        beta, information = np.zeros(0), np.zeros((0, 0))
        for _ in range(PASSES):
            weights = 1.0 / (variances * self._factors)
            gram = np.tensordot(weights, grams, 1) + pull.T @ pull
            sizes = np.sqrt(np.diag(gram))
            sizes = np.where(sizes > 0, sizes, 1.0)
            information = gram + RIDGE * np.diag(sizes**2)
            side = (weights @ sides + pull.T @ target) / sizes
            beta = np.linalg.solve(information / np.outer(sizes, sizes), side) / sizes
            left = squares - 2 * sides @ beta + np.einsum("k,ikl,l->i", beta, grams, beta)
            variances = np.maximum(left, 0.0) / counts + floors
        surprise = float(np.sum((pull @ beta - target) ** 2))
        return Solved(beta, variances, float(np.sum(np.log(variances))), information, surprise)

    def factors(self, solved: Solved, chosen: Sequence[int]) -> Array:
        return self._factors

    def spread(self, worth: Array) -> float:
        return 1.0

    def candidates(self, before: Solved, chosen: Sequence[int]) -> list[int]:
        return [k for k in range(len(self.causes)) if k not in chosen]


class Since:
    """What the torques leave where the bodies are those of an earlier estimate, as far as it knows them.

    Attributes:
        fit: The quick fit, whose bodies are free.
    """

    def __init__(self, trends: Trends, known: KnownBodies) -> None:
        self.fit, self._trends, self._known = trends.fit, trends, known

    @cached_property
    def search(self) -> Anchored:
        """The products of all columns."""
        fit, rows = self.fit, self.fit.rows
        target = rows.torque - rows.known
        found = CauseRows(rows.blocks, rows.columns, fit.base.count, target, rows.torque, rows.masks, OVERSAMPLING)
        causes = [cause for cause in self._trends.causes if cause.name not in LEFT_OUT]
        causes += [Cause("load at the flange", "", self.load_columns), Cause("torque scale", "", self.bodies[None])]
        return Anchored(found, causes, self._known, fit.counts / fit.independent_rows)

    @cached_property
    def load_columns(self) -> Array:
        """Torque of first moments and mass at the last link, 1 kg m and 1 kg, filtered, shape (4, N, n).

        The moments of inertia of a load at the flange hardly show beside its weight, and would count as six causes.
        """
        prepared = self.fit.rows.prepared
        motion = motion_of(prepared.log)
        chain = self.fit.model.robot.chain
        regressor = batched.torque_regressor(chain, motion.q, motion.dq, motion.ddq, once=True)
        last = regressor[:, :, -TEN:][:, :, TEN - 4 :]
        flat = np.ascontiguousarray(last.transpose(2, 1, 0)).reshape(-1, len(last))
        smooth = prepared.smooth(flat)[:, prepared.keep]
        return smooth.reshape(4, last.shape[1], -1).transpose(0, 2, 1)

    @cached_property
    def bodies(self) -> Array:
        """Torque of the bodies as this log has them, shape (N, n)."""
        fit, rows = self.fit, self.fit.rows
        found = []
        for block, own in zip(rows.blocks, rows.columns, strict=True):
            bodies = fit.base.independent[own] < fit.model.inertial_count
            found.append(block[:, bodies] @ fit.plain.beta[own[bodies]])
        return np.stack(found, axis=1)
