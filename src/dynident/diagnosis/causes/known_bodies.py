"""What differs from bodies that are known: those of an earlier estimate, or of the robot model, as a prior of the fit.

Friction is another one on another day and stays free. Base parameters of the earlier estimate and of the quick fit are
told apart by their maps, so that gravity, rotors and friction may differ: what both know counts, the rest is free.

An estimate has a covariance. The errors of a robot model are not stated: they are normal with relative standard
deviations, which the log tells by the marginal likelihood (MacKay 1992, section 2.4), and count in the intervals.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dynident.arrays import Array, IntArray
from dynident.case.evidence.torques import body_errors
from dynident.diagnosis.causes.flange_load import TEN
from dynident.identification.estimate.estimate import Estimate
from dynident.identification.residuals.quantiles import chi_square_tail
from dynident.model.base_parameters import BaseParameters
from dynident.model.dynamic_model import DynamicModel
from dynident.model.robot import Robot

#: A map of base parameters whose rest is below this share of it is the same.
SAME = 1e-4

#: Deviations of the earlier estimate below this share of its largest, all with unit columns, are rounding.
SMALLEST = 1e-6

#: Chance of so large a difference below which an earlier estimate contradicts the robot model.
CONTRADICTS = 1e-3

#: Relative standard deviations of a robot model at least.
LEAST = 1e-5

#: Relative standard deviation of moments of inertia about the centre of mass, of which weights tell nothing.
MOMENTS = 0.4


@dataclass(frozen=True)
class KnownBodies:
    """A normal prior of some of the columns of a fit.

    Attributes:
        places: Positions in beta, shape (s,).
        factor: Combinations of the bodies whose errors are independent of each other, shape (s, s); an estimate knows
            each with a standard deviation of 1.
        values: The mean, shape (s,).
    """

    places: IntArray
    factor: Array
    values: Array

    def agrees(self, beta: Array) -> bool:
        """Return whether it does not contradict other values of beta."""
        squares = float(np.sum((self.factor @ (beta[self.places] - self.values)) ** 2))
        return bool(chi_square_tail(squares, len(self.places)) > CONTRADICTS)

    def variances(self, shares: Array) -> Array:
        """Return the variances of the combinations, shape (s,); ``shares`` are those of :class:`NominalBodies`."""
        return np.ones(len(self.places))

    def likelier(self, shares: Array, variances: Array, off: Array, left: Array) -> Array:
        """Return standard deviations that explain a fit better; those of an estimate are stated."""
        return shares

    def surprise(self, variances: Array, off: Array, fitted: float) -> float:
        """Return twice the fall of the log-likelihood by ``off`` (s,), the combinations less what is known of them."""
        return float(off @ (off / variances))

    def freedom(self, variances: Array, left: Array) -> float:
        """Return how many errors of the bodies the torques tell, from which their deviations were found."""
        return np.inf

    def moment_errors(self) -> Array:
        """Return what errors of moments of inertia of one standard deviation do to the combinations, shape (s, m)."""
        return np.zeros((len(self.places), 0))


@dataclass(frozen=True)
class NominalBodies(KnownBodies):
    """Bodies of a robot model, whose errors the log tells.

    Attributes:
        places: Positions in beta, shape (s,).
        factor: Combinations of the bodies whose errors are independent of each other, shape (s, s): those of the single
            parameters and those that all ten parameters of a link have in common alike.
        values: The mean, shape (s,).
        common: Variance of the combinations for relative errors of one that links have in common, shape (s,); that for
            relative errors of one of the single parameters is 1.
        moments: What the moments of inertia of each link about its centre of mass do to the combinations, shape (s, m).
    """

    common: Array
    moments: Array

    def moment_errors(self) -> Array:
        return MOMENTS * self.moments

    def variances(self, shares: Array) -> Array:
        return shares[0] ** 2 * self.common + shares[1] ** 2

    def likelier(self, shares: Array, variances: Array, off: Array, left: Array) -> Array:
        """Return a step to the largest marginal likelihood (MacKay 1992, by components of the variance).

        Args:
            shares: Standard deviations of the common and of the single errors.
            variances: Of the combinations with these, shape (s,).
            off: The fitted combinations less the nominal ones, shape (s,).
            left: Their variances after the fit, shape (s,).
        """
        parts = np.stack([self.common, np.ones(len(left))])
        squares, counts = parts @ (off / variances) ** 2, parts @ ((1.0 - left / variances) / variances)
        least = 1e-12 * (parts @ (1.0 / variances))  # logs without noise tell next to nothing of them
        return np.maximum(shares * np.sqrt(squares / np.maximum(counts, least)), LEAST)

    def surprise(self, variances: Array, off: Array, fitted: float) -> float:
        """Return the same for the marginal likelihood; ``fitted`` is the log determinant of all that was fitted."""
        return float(off @ (off / variances) + fitted + np.log(variances).sum())

    def freedom(self, variances: Array, left: Array) -> float:
        """Return the effective number of parameters (MacKay 1992); ``left`` are variances after the fit, shape (s,)."""
        return max(len(left) - float(np.sum(left / variances)), 1.0)


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
    factor = _root_of_inverse(mixing @ estimate.covariance[np.ix_(bodies, bodies)] @ mixing.T)
    return KnownBodies(np.array(places, dtype=np.int64), factor, mixing @ estimate.beta[bodies] + np.array(added))


def nominal_bodies(
    model: DynamicModel, base: BaseParameters, robot: Robot, asked: frozenset[str]
) -> NominalBodies | None:
    """Return the bodies of a robot model as known up to relative errors; None where it states none that count.

    All ten parameters of a link are off by a common share, and each by one of its own: the mass by a share of it, the
    first moments of mass times size, the moments of inertia of mass times size squared; the size is the radius of
    gyration about the origin of the link's frame. All shares are independent, with one standard deviation for the
    common and one for the single ones. Rotor inertias that are not known, and springs, leave the base parameters that
    hold them free.

    Args:
        model: The model of the quick fit.
        base: Its base parameters.
        robot: The robot with its stated rotor inertias.
        asked: Joints whose rotor inertias are to be identified; those of the others are as stated.
    """
    theta = model.nominal()
    if theta is None:
        return None
    count = model.inertial_count
    bodies = theta[:count].reshape(-1, TEN)
    if not np.any(bodies[:, -1] > 0):
        return None
    errors = body_errors(bodies)
    kinds = [(parameter.kind, parameter.owner in asked) for parameter in model.parameters]
    unknown = np.array([kind == "friction" or (kind == "rotor" and is_asked) for kind, is_asked in kinds])
    held = (base.independent < count) & ~np.any(base.matters[:, unknown], axis=1)
    places = np.flatnonzero(held)
    if not len(places):
        return None
    mixing = base.matrix[places]
    whole = np.stack([mixing[:, TEN * i : TEN * (i + 1)] @ body for i, body in enumerate(bodies)], axis=1)
    single = (mixing[:, :count] * errors**2) @ mixing[:, :count].T
    root = _root_of_inverse(single)
    directions, sizes, _ = np.linalg.svd(root @ whole)
    common = np.zeros(len(places))
    common[: len(sizes)] = sizes**2
    factor = directions.T @ root
    moments = np.stack([mixing[:, TEN * i : TEN * i + 6] @ _own_moments(body) for i, body in enumerate(bodies)], axis=1)
    return NominalBodies(places, factor, mixing @ with_rotors(theta, model, robot), common, factor @ moments)


def _own_moments(body: Array) -> Array:
    """Return the moments of inertia of a body (10,) about its centre of mass, shape (6,)."""
    if body[-1] <= 0.0:
        return body[:6]
    x, y, z = body[6:9] / np.sqrt(body[-1])
    return body[:6] - np.array([y * y + z * z, -x * y, -x * z, x * x + z * z, -y * z, x * x + y * y])


def _root_of_inverse(covariance: Array) -> Array:
    """Return F with F' F the inverse of a covariance, its smallest deviations bounded."""
    sizes = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    squares, directions = np.linalg.eigh(covariance / np.outer(sizes, sizes))
    return (directions / np.sqrt(np.maximum(squares, SMALLEST**2 * squares[-1]))).T / sizes


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
