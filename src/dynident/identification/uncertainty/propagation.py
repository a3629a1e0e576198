"""From the covariance of base parameters to what is made of them: standard parameters, torques, the mass matrix."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from dynident.arrays import Array
from dynident.data.preprocessing import Prepared
from dynident.errors import BadOption
from dynident.identification.consistency.consistent_fit import scale_of
from dynident.identification.estimate.estimate import Estimate
from dynident.identification.problem.choices import GainUncertainty
from dynident.identification.problem.prior import PULL
from dynident.identification.problem.problem import Problem
from dynident.identification.problem.regressor_stream import RegressorStream, Segments
from dynident.identification.residuals.row_passes import RowPasses
from dynident.model.friction import WHOLE_PART, Motion, called
from dynident.model.reduction import least_squares

#: Step of the logarithm of a field on either side, for its slope.
STEP = 0.01


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
    wide = np.array([1e3 if parameter.kind == "friction" else 1.0 for parameter in model.parameters])
    prior = scale * wide / np.sqrt(pull)
    spread = matrix * prior  # a square root of K P K'
    both = spread @ spread.T + estimate.covariance
    size = np.sqrt(np.diag(both))
    gain = np.linalg.solve(both / size / size[:, None], spread / size[:, None]).T / size
    left = (np.eye(len(prior)) - gain @ spread) * prior[:, None]
    found = left @ left.T + (prior[:, None] * gain) @ estimate.covariance @ (prior[:, None] * gain).T  # Joseph's form
    return 0.5 * (found + found.T)


def prediction_deviations(
    regressor: RegressorStream, prepared: Prepared, covariance: Array, made: Segments | None = None
) -> Array:
    """Return the standard deviation of the filtered torque by the parameters' covariance over the kept rows, (N, n).

    Args:
        regressor: Of the model, with the estimate as its load.
        prepared: A preprocessed log.
        covariance: Of the base parameters, shape (b, b).
        made: The rows of the log, where they are there already.
    """
    roots = [covariance_root(covariance[np.ix_(columns, columns)]) for columns in regressor.columns]
    found = np.empty((len(prepared.keep), len(roots)))
    for part, blocks in made or regressor.segments(prepared):
        for i, (root, block) in enumerate(zip(roots, blocks, strict=True)):
            found[part, i] = np.linalg.norm(root @ block[:-1], axis=0)
    return found


def covariance_root(covariance: Array) -> Array:
    """Return R with R'R the covariance, shape (b, b); rounding below zero is zero."""
    values, vectors = np.linalg.eigh(covariance)
    return (vectors * np.sqrt(np.maximum(values, 0.0))).T


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


def gain_slopes(problem: Problem, weights: Array) -> Array:
    """Return the slopes of weighted least squares by the relative errors of the gains, shape (b, n).

    Of beta = A^-1 sum_j w_j^2 X_j' tau_j with tau = C' K i, the slope by the relative error of gain k is
    A^-1 sum_j w_j^2 X_j' C_kj K_k i_k. No residual shows such errors, so they are stated beside the covariance.

    Args:
        problem: The problem; its torques are gains times currents.
        weights: Weight of each joint's rows, shape (n,).
    """
    passes, coupling = RowPasses(problem), np.asarray(problem.model.robot.coupling)
    torque = np.concatenate([np.asarray(log.log.torque)[log.keep] for log in problem.logs])
    drives = torque @ np.linalg.inv(coupling)
    products = [
        passes.products(drives[:, [k]] * (coupling[k] * np.asarray(weights) ** 2)) for k in range(len(coupling))
    ]
    return least_squares(problem.reduced(weights)).unscaled_covariance @ np.column_stack(products)


def field_covariance(problem: Problem, beta: Array, deviations: Array, factors: Array) -> Array:
    """Return what fields of friction parts that the logs have found add to the covariance of beta, shape (b, b).

    With D the slopes of the torque by the logarithms of the fields, beta moves by S = -A^-1 X'D as they do, whose
    covariance is ((D'D + X'D S) / c + P^-1)^-1, with c how far residuals depend on each other (Golub and Pereyra 1973)
    and P that of values anywhere in their ranges.

    Args:
        problem: The problem.
        beta: The estimate, shape (b,).
        deviations: Of the residual of each joint, shape (n,).
        factors: Rows that one independent row stands for, of each joint, shape (n,).
    """
    found, friction = list(_found_fields(problem)), problem.model.friction
    if not found:
        return np.zeros((len(beta), len(beta)))
    passes, weights = RowPasses(problem), 1.0 / deviations
    slopes = [_field_slope(problem, *field, beta) * passes.counting * weights for field in found]
    shares = [np.sum(slope**2, axis=0) for slope in slopes]
    grown = np.sqrt(np.array([float(np.average(factors, weights=own)) if own.any() else 1.0 for own in shares]))
    slopes = [slope / by for slope, by in zip(slopes, grown, strict=True)]
    ranges = [friction[parts[0]].ranges[name] for parts, name in found]
    known = np.diag([12.0 / np.log(own.high / own.low) ** 2 for own in ranges])  # of a uniform distribution
    products = np.column_stack([passes.products(slope * weights) for slope in slopes])
    moved = -least_squares(problem.reduced(weights)).unscaled_covariance @ products
    flat = np.reshape(slopes, (len(slopes), -1))
    inverse = np.linalg.inv(flat @ flat.T + products.T @ moved + known)
    return (moved * grown) @ inverse @ (moved * grown).T


def _found_fields(problem: Problem) -> Iterator[tuple[list[int], str]]:
    """Yield fields of friction parts whose values the logs have found: places of the parts that share it, its name."""
    told = problem.choices.chosen_fields or ()
    fitted = {own.part for own in told if own.field == WHOLE_PART and own.value}  # with all their fields, wherever
    chosen = [own for own in told if own.field != WHOLE_PART and (own.value != own.stated or own.part in fitted)]
    for each in (*(problem.choices.non_linear or ()), *chosen):
        parts = [
            p
            for p, part in enumerate(problem.model.friction)
            if called(part) in each.part.split(", ") and getattr(part, each.field, None) == each.value
        ]
        if parts:
            yield parts, each.field


def _field_slope(problem: Problem, places: Sequence[int], name: str, beta: Array) -> Array:
    """Return the slope of the filtered torque by the logarithm of a field of some parts, shape (N, n)."""
    sides = []
    for by in (-STEP, STEP):
        parts = list(problem.model.friction)
        for p in places:
            parts[p] = replace(parts[p], **{name: getattr(parts[p], name) * float(np.exp(by))})
        model = replace(problem.model, friction=tuple(parts))
        stream = RegressorStream(model, problem.base, problem.load, only="friction")
        sides.append([stream.predict(log.log, beta) for log in problem.logs])
    changes = zip(problem.logs, *sides, strict=True)
    return np.concatenate([log.smooth((b - a).T).T[log.keep] for log, a, b in changes]) / (2.0 * STEP)


def gain_uncertainty(problem: Problem, weights: Array) -> GainUncertainty | None:
    """Return what the stated deviations of the gains add to each base parameter, for the estimate; None without any."""
    joints = problem.model.robot.active
    stated = np.array([joint.drive.gain_deviation for joint in joints])
    if not np.any(stated):
        return None
    added = np.sqrt(np.sum((gain_slopes(problem, weights) * stated) ** 2, axis=1))
    relative = {joint.name: float(value) for joint, value in zip(joints, stated, strict=True)}
    return GainUncertainty(relative, tuple(added.tolist()))
