"""From the covariance of base parameters to what is made of them: standard parameters, torques, the mass matrix."""

from __future__ import annotations

import numpy as np
import scipy.linalg

from dynident.arrays import Array
from dynident.errors import BadOption
from dynident.estimation.consistency.consistent_fit import PULL, scale_of
from dynident.estimation.estimate import Estimate
from dynident.estimation.observer import Observer
from dynident.estimation.problem import Problem
from dynident.experiment.log import Log
from dynident.experiment.preprocessing import Prepared
from dynident.model.friction import Motion


def standard_covariance(estimate: Estimate, problem: Problem, pull: float = PULL) -> Array:
    """Return the covariance of the standard parameters, shape (p, p): data and prior together.

    The prior is normal about the stated one with a standard deviation of 1 / sqrt(pull) natural sizes for inertial
    parameters and rotor inertias, and flat (1000 times as wide) for friction. With P its covariance and C that of the
    base parameters the posterior is P - P K' (K P K' + C)^-1 K P; conditions of possible bodies narrow it further.

    Args:
        estimate: The estimate.
        problem: The problem that it solves, for scale and prior.
        pull: As of the estimator 'consistent'.

    Raises:
        BadOption: A pull that is not positive.
    """
    if not pull > 0:
        raise BadOption("pull", pull, "give a number above 0, such as 0.01")
    model, matrix = estimate.model, estimate.base.matrix
    scale = scale_of(problem).parameters
    wide = np.array([1.0 if parameter.unit.startswith("kg") else 1e3 for parameter in model.parameters])
    prior = scale * wide / np.sqrt(pull)
    spread = matrix * prior  # a square root of K P K'
    both = spread @ spread.T + estimate.covariance
    size = np.sqrt(np.diag(both))
    gain = scipy.linalg.solve(both / size / size[:, None], spread / size[:, None], assume_a="pos").T / size
    left = (np.eye(len(prior)) - gain @ spread) * prior[:, None]
    found = left @ left.T + (prior[:, None] * gain) @ estimate.covariance @ (prior[:, None] * gain).T  # Joseph's form
    return 0.5 * (found + found.T)


def prediction_deviations(observer: Observer, prepared: Prepared, covariance: Array) -> Array:
    """Return the standard deviation of the filtered torque by the parameters' covariance over the kept rows, (N, n).

    Args:
        observer: Of the model, with the estimate as its load.
        prepared: A preprocessed log.
        covariance: Of the base parameters, shape (b, b).
    """
    roots = [_root(covariance[np.ix_(columns, columns)]) for columns in observer.columns]
    found = np.empty((len(prepared.keep), len(roots)))
    for part, blocks in observer.segments(prepared):
        for i, (root, block) in enumerate(zip(roots, blocks, strict=True)):
            found[part, i] = np.linalg.norm(root @ block[:-1], axis=0)
    return found


def _root(covariance: Array) -> Array:
    """Return R with R'R the covariance, shape (b, b); rounding below zero is zero."""
    values, vectors = np.linalg.eigh(covariance)
    return (vectors * np.sqrt(np.maximum(values, 0.0))).T


def torque_deviations(estimate: Estimate, log: Log) -> Array:
    """Return the standard deviation of the predicted torque by the parameters' covariance, shape (N, n).

    It is that of the model's torque before any filter; noise and errors of the model come on top.

    Args:
        estimate: The estimate.
        log: Positions, velocities and accelerations.

    Raises:
        LogMismatch: The log has no velocities or accelerations yet.
    """
    observer, beta = Observer(estimate.model, estimate.base), estimate.beta
    roots = _root(estimate.covariance)
    # With friction that depends on the load the torque is not linear in beta: slopes by central differences.
    slopes = (0.5 * (observer.predict(log, beta + root) - observer.predict(log, beta - root)) for root in roots)
    return np.sqrt(sum(slope**2 for slope in slopes))


def mass_matrix(estimate: Estimate, q: Array) -> tuple[Array, Array]:
    """Return the mass matrix with its rotors at one posture and the standard deviation of each element, (n, n) each.

    M(q) is linear in the base parameters: its column j is the torque of the unit acceleration of joint j less that at
    rest, and elements of friction or gravity cancel. In kg m^2, kg m or kg.

    Args:
        estimate: The estimate.
        q: Posture, shape (n,).
    """
    joints = estimate.model.robot.dof
    ddq = np.concatenate([np.eye(joints), np.zeros((1, joints))])
    none = np.zeros_like(ddq)  # at rest no friction depends on load or temperature
    motion = Motion(np.tile(np.asarray(q, dtype=float), (joints + 1, 1)), none, ddq, torque=none, temperature=none)
    columns = estimate.model.regressor(motion, once=True)[..., estimate.base.independent]
    slopes = columns[:-1] - columns[-1]  # (j, i, b)
    known = estimate.model.known_torque(motion)
    value = (slopes @ estimate.beta + known[:-1] - known[-1]).T
    return value, np.sqrt(np.maximum(np.einsum("jib,bc,jic->ij", slopes, estimate.covariance, slopes), 0.0))
