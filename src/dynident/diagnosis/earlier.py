"""What earlier runs know, as information for the design of the next one: of an estimate, or of logs as they are."""

from __future__ import annotations

import shlex
from collections.abc import Sequence

import numpy as np

from dynident.arrays import Array
from dynident.data.log import Log
from dynident.data.preprocessing import Prepared, Preprocessing, preprocess
from dynident.errors import BadOption
from dynident.excitation.design.prior import Prior, prior_of_covariance
from dynident.identification.estimate.estimate import Estimate
from dynident.identification.problem.problem import counting_rows
from dynident.identification.problem.regressor_stream import RegressorStream
from dynident.identification.residuals.covariance import correlation_factors
from dynident.model.base_parameters import BaseParameters, base_parameters
from dynident.model.dynamic_model import DynamicModel
from dynident.model.reduction import Triangle, reduce

#: A direction with unit columns below this share of the strongest is not determined by the logs.
_WEAK = 1e-9


def noise_of(estimate: Estimate) -> Array:
    """Return the standard deviation of each joint's torque that an independent row is worth, shape (n,).

    The residual deviation of the fit times the root of its correlation factor: rows of residuals that hang together
    count as fewer.
    """
    return estimate.joint_deviations * np.sqrt(estimate.correlation_factors)


def prior_of_estimate(estimate: Estimate, model: DynamicModel, name: str) -> Prior:
    """Return what an estimate knows of the base parameters of a model.

    Args:
        estimate: The estimate.
        model: The model that the next run is designed for.
        name: Name of the estimate in messages.

    Raises:
        BadOption: The estimate is of other base parameters, or its covariance is singular.
    """
    check_same(estimate, model, name)
    return prior_of_covariance(estimate.covariance, estimate.beta, name)


def check_same(estimate: Estimate, model: DynamicModel, name: str) -> None:
    """Refuse an estimate of another model.

    Raises:
        BadOption: Its robot or friction has other base parameters.
    """
    ours = base_parameters(model)
    if estimate.base.names == ours.names and estimate.model.robot.joint_names == model.robot.joint_names:
        return
    theirs = set(estimate.base.names) - set(ours.names)
    differs = min(theirs or set(ours.names) - set(estimate.base.names) or {"the joints"})
    evidence = f"an estimate of other base parameters ({estimate.base.count} beside {ours.count}, such as {differs})"
    step = "give the robot, locked joints and friction with which it was identified"
    if set(model.robot.joint_names) < set(estimate.model.robot.joint_names):
        export = f"dynident export {shlex.quote(name)} --to mjcf -o identified.xml"
        step += (
            f"; or leave the estimate out, and state robot: identified.xml in the case that '{export}' writes from it"
        )
    raise BadOption(name, evidence, step)


def prior_of_logs(model: DynamicModel, logs: Sequence[Log], how: Preprocessing) -> tuple[Prior, Array]:
    """Return what logs know, and the noise of an independent row of each joint, (n,); NaN where none of its rows count.

    Unlike an estimate, the logs need not determine every base parameter: what they leave open is what the next run is
    for. The noise is that of a weighted least-squares fit; its rows count less where residuals hang together.

    Args:
        model: Robot, drives and friction; none of it may depend on the load.
        logs: Raw logs with positions and torques.
        how: How logs become rows.

    Raises:
        BadOption: No log, or friction that depends on the load.
        LogMismatch: A log does not fit the robot, or is too short.
    """
    if not logs:
        raise BadOption("earlier logs", "none", "give at least one log")
    if "torque" in model.needs:
        raise BadOption("earlier logs", "with friction that depends on the load", "identify them and give the estimate")
    base = base_parameters(model)
    regressor = RegressorStream(model, base)
    prepared = [preprocess(log.ordered(model.robot.joint_names), how) for log in logs]
    masks = [counting_rows(model, log) for log in prepared]
    parts = [regressor.triangles(log, mask) for log, mask in zip(prepared, masks, strict=True)]
    triangles = [first.merged(rest) for first, *rest in zip(*parts, strict=True)]
    noise, whole = np.ones(len(triangles)), False
    beta = np.zeros(base.count)
    for _ in range(2):
        beta, rank = fit_determined(triangles, base, noise)
        noise, whole = deviations_left(triangles, beta, rank), rank == base.count
    noise = noise * np.sqrt(correlation_factors([_residual(regressor, log, beta) for log in prepared], masks))
    triangle = reduce(triangles, base.count, 1.0 / noise).r
    names = ", ".join(log.name for log in logs)
    counted = np.array([part.rows > 0 for part in triangles])
    return Prior(triangle.T @ triangle, beta if whole else None, names), np.where(counted, noise, np.nan)


def fit_determined(triangles: Sequence[Triangle], base: BaseParameters, noise: Array) -> tuple[Array, int]:
    """Return the least-squares beta of the directions that the rows determine, and their number."""
    reduced = reduce(triangles, base.count, 1.0 / noise)
    norms = np.where(reduced.column_norms > 0, reduced.column_norms, 1.0)
    found, _, rank, _ = np.linalg.lstsq(reduced.r / norms, reduced.z, rcond=_WEAK)
    return found / norms, int(rank)


def deviations_left(triangles: Sequence[Triangle], beta: Array, rank: int) -> Array:
    """Return the residual standard deviation of each joint, shape (n,), never zero."""
    counts = np.array([max(triangle.rows, 1) for triangle in triangles])
    free = max(1.0 - rank / counts.sum(), 1e-3)
    squares = np.array([triangle.residual_square(beta) for triangle in triangles])
    floor = 1e-24 * np.array([triangle.torque_square for triangle in triangles]) + 1e-300
    found = np.sqrt(np.maximum(squares, floor) / (counts * free))
    return np.where([triangle.rows > 0 for triangle in triangles], found, 1.0)


def _residual(regressor: RegressorStream, prepared: Prepared, beta: Array) -> Array:
    """Return the residual of the kept rows, filtered as the fit sees it, shape (N, n)."""
    assert prepared.log.torque is not None  # the triangles were made from it
    predicted = prepared.smooth(regressor.predict(prepared.log, beta).T).T
    return (prepared.log.torque - predicted)[prepared.keep]
