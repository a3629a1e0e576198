"""An estimate against logs that had no part in its fit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dynident.arrays import Array
from dynident.data.log import Log
from dynident.data.preprocessing import Prepared, Preprocessing, preprocess
from dynident.errors import LogMismatch
from dynident.identification.estimate.envelope import departure_of
from dynident.identification.estimate.estimate import Estimate
from dynident.identification.estimate.validation import Validation, compare_torques
from dynident.identification.problem.problem import counting_rows
from dynident.identification.problem.regressor_stream import RegressorStream
from dynident.identification.uncertainty.propagation import prediction_deviations
from dynident.model.base_parameters import BaseParameters
from dynident.model.dynamic_model import DynamicModel
from dynident.model.threads import on_one_blas_thread


@on_one_blas_thread
def validate(estimate: Estimate, logs: Sequence[Log], preprocessing: Preprocessing | None = None) -> Validation:
    """Compare an estimate with logs that it has not seen; they are prepared as those of the fit.

    Args:
        estimate: The estimate.
        logs: Raw logs with positions and torques.
        preprocessing: Another preparation than that of the fit.

    Raises:
        LogMismatch: A log does not fit the robot, or is too short.
    """
    preprocessing = preprocessing or estimate.preprocessing
    prepared = [preprocess(log.ordered(estimate.model.robot.joint_names), preprocessing) for log in logs]
    found = validate_prepared(estimate.model, estimate.base, prepared, estimate.beta)
    regressor = RegressorStream(estimate.model, estimate.base, estimate.beta)
    deviations = [prediction_deviations(regressor, log, estimate.covariance) for log in prepared]
    found = replace(found, deviations=np.concatenate(deviations), noise=estimate.joint_deviations)
    if estimate.envelope is None:
        return found
    parts = [regressor.triangles(log, np.ones((len(log.keep), len(log.log.joints)), bool)) for log in prepared]
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
