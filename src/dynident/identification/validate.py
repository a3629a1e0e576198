"""An estimate against logs that had no part in its fit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from dynident.arrays import Array
from dynident.data.log import Log
from dynident.data.preprocessing import Prepared, Preprocessing, preprocess
from dynident.errors import LogMismatch
from dynident.identification.estimate.envelope import departure_of
from dynident.identification.estimate.estimate import Estimate
from dynident.identification.estimate.plausibility import Plausibility
from dynident.identification.estimate.validation import NominalErrors, Validation, compare_torques
from dynident.identification.problem.kept_rows import kept_rows
from dynident.identification.problem.problem import Problem, counting_rows
from dynident.identification.problem.regressor_stream import RegressorStream
from dynident.identification.uncertainty.propagation import prediction_deviations
from dynident.model.base_parameters import BaseParameters
from dynident.model.dynamic_model import DynamicModel
from dynident.model.threads import one_blas_thread


@one_blas_thread()
def validate(
    estimate: Estimate, logs: Sequence[Log | Prepared], preprocessing: Preprocessing | None = None
) -> Validation:
    """Compare an estimate with logs that it has not seen; they are prepared as those of the fit.

    Args:
        estimate: The estimate.
        logs: Raw logs with positions and torques, or logs that are prepared already.
        preprocessing: Another preparation than that of the fit, for raw logs.

    Raises:
        LogMismatch: A log does not fit the robot, or is too short.
    """
    how, names = preprocessing or estimate.preprocessing, estimate.model.robot.joint_names
    prepared = [one if isinstance(one, Prepared) else preprocess(one.ordered(names), how) for one in logs]
    found = validate_prepared(estimate.model, estimate.base, prepared, estimate.beta)
    regressor = RegressorStream(estimate.model, estimate.base, estimate.beta)
    kept = kept_rows(regressor, prepared)
    deviations = [
        prediction_deviations(regressor, log, estimate.covariance, kept and kept.of_log(k))
        for k, log in enumerate(prepared)
    ]
    known = estimate.train.nominal
    nominal = None if known is None else nominal_errors(estimate.model, estimate.base, prepared, known.friction)
    bodies = Plausibility.of(estimate.run)
    if bodies is not None:
        free = validate_prepared(estimate.model, estimate.base, prepared, np.array(bodies.free_beta))
        found = replace(found, free_bodies_error=free.total_relative_error)
    found = replace(found, deviations=np.concatenate(deviations), noise=estimate.joint_deviations, nominal=nominal)
    if estimate.envelope is None:
        return found
    parts = [
        regressor.triangles(log, np.ones((len(log.keep), len(log.log.joints)), bool), kept and kept.segments[k])
        for k, log in enumerate(prepared)
    ]
    triangles = [first.merged(rest) for first, *rest in zip(*parts, strict=True)]
    logs_seen = [log.kept for log in prepared]
    return replace(found, departure=departure_of(estimate.envelope, logs_seen, triangles, estimate.covariance))


def validate_prepared(model: DynamicModel, base: BaseParameters, logs: Sequence[Prepared], beta: Array) -> Validation:
    """Compare base parameters with preprocessed logs."""
    for log in logs:
        if log.log.torque is None:
            raise LogMismatch(log.log.name, "no torques to compare with", "map torque columns in the case file")
    regressor = RegressorStream(model, base)
    return compare_torques(
        [log.kept for log in logs],
        [log.smooth(regressor.predict(log.log, beta).T).T[log.keep] for log in logs],
        [counting_rows(model, log) for log in logs],
        model.robot.units,
        logs[0].how.standstill,
        logs[0].statement(),
    )


def with_nominal(estimate: Estimate, problem: Problem) -> Estimate:
    """Return the estimate with the errors of the robot model's inertias on its samples; as it is where it states none.

    Friction, offset and rotor inertia beside the nominal inertias are those of weighted least squares on the same QR
    factors, each joint weighted by its residual in the fit; coefficients that would come out below the least that
    physics allows are that, as in the estimate. Inertias that a case states by ``prior`` have no part.
    """
    nominal = problem.model.robot.nominal
    if nominal is None:
        return estimate
    known, free = np.split(np.asarray(problem.base.matrix), [len(nominal)], axis=1)
    still = known @ nominal
    rows, target = [], []
    for triangle, deviation in zip(problem.triangles, estimate.joint_deviations, strict=True):
        matrix, torque = triangle.factor[:, :-1] / deviation, triangle.factor[:, -1] / deviation
        rows.append(matrix @ free[triangle.columns])
        target.append(torque - matrix @ still[triangle.columns])
    parameters, every, torques = problem.base.parameters[len(nominal) :], np.concatenate(rows), np.concatenate(target)
    least = np.array([parameter.least if parameter.nonnegative else -np.inf for parameter in parameters])
    friction, kept = np.zeros(len(parameters)), np.full(len(parameters), True)
    while kept.any():
        friction = np.where(kept, 0.0, least)
        friction[kept] = np.linalg.lstsq(every[:, kept], torques - every[:, ~kept] @ least[~kept])[0]
        if not (wrong := friction < least).any():
            break
        kept &= ~wrong
    named = {parameter.name: float(value) for parameter, value in zip(parameters, friction, strict=True)}
    errors = nominal_errors(problem.model, problem.base, problem.logs, named)
    return replace(estimate, train=replace(estimate.train, nominal=errors))


def nominal_errors(
    model: DynamicModel, base: BaseParameters, logs: Sequence[Prepared], friction: Mapping[str, float]
) -> NominalErrors | None:
    """Return the errors of the robot model's inertias on preprocessed logs; None where it states none.

    Args:
        model: The model.
        base: Its base parameters.
        logs: The logs.
        friction: Parameters of friction, offset and rotor inertia beside the nominal inertias, in the model's order.
    """
    nominal = model.robot.nominal
    if nominal is None:
        return None
    fitted, bare = (
        validate_prepared(model, base, logs, base.from_standard(np.append(nominal, values)))
        for values in (list(friction.values()), [0.0] * len(friction))
    )
    return NominalErrors(
        fitted.total_relative_error,
        bare.total_relative_error,
        tuple(fit.relative_error for fit in fitted.joints),
        tuple(fit.relative_error for fit in bare.joints),
        friction,
    )
