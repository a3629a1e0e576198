"""The torque that an estimate predicts along a log, with two bands of 95 %, all filtered as in the fit."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from dynident.applications.compensation import parameters_of
from dynident.applications.standstill import held_along
from dynident.applications.start_states import with_starts
from dynident.arrays import Array
from dynident.data.log import Log
from dynident.data.preprocessing import Prepared, Preprocessing, preprocess, resample
from dynident.data.preprocessing._spectra import noise_floor
from dynident.errors import LogMismatch
from dynident.identification.estimate.estimate import Estimate
from dynident.identification.estimate.validation import Z_95
from dynident.identification.problem.regressor_stream import RegressorStream
from dynident.identification.uncertainty.propagation import covariance_root, prediction_deviations

#: Periods of the cut-off at both ends of a log in which a filter lacks samples.
SPOILED_PERIODS = 3.0

#: Draws of the noise of the positions, and their seed.
DRAWS, SEED = 20, 20


@dataclass(frozen=True)
class PredictedTorque:
    """The predicted torque of each joint at the rows that are used: all but those that the filter spoils.

    Attributes:
        prepared: The log, and which rows are used.
        torque: Torque of the model, filtered as the measured one, shape (N, n).
        half_model: Half the width of the 95 % band of the torque without noise: covariance of the parameters, and noise
            of the positions of this log, shape (N, n).
        half_measured: Half the width of the 95 % band of the measured torque: covariance of the parameters, and the
            residual of the fit or the noise of the positions, the larger of both, shape (N, n).
        half_held: How far from the torque what static friction holds can lead, shape (N, n): where a drive rests, and
            after it for as long as the filter looks back; both bands have it.
        starts: States of friction that last for minutes, at the start of a log with torques, as these say.
    """

    prepared: Prepared
    torque: Array
    half_model: Array
    half_measured: Array
    half_held: Array
    starts: tuple[dict[str, Any], ...] = ()

    @property
    def measured(self) -> Array | None:
        """Measured torque, filtered, shape (N, n); None where the log has none."""
        return self.prepared.kept.torque

    @property
    def inside(self) -> Array:
        """Share of the measured torques that lie in their band, shape (n,); NaN where the log has none."""
        if self.measured is None:
            return np.full(self.torque.shape[1], np.nan)
        return np.mean(np.abs(self.measured - self.torque) <= self.half_measured, axis=0)


def predict_torque(estimate: Estimate, log: Log) -> PredictedTorque:
    """Return the torque of a motion and its bands, at all samples but those that the filter spoils.

    Args:
        estimate: The estimate.
        log: The motion as it came, joints in the order of the robot; torques may be there.

    Raises:
        LogMismatch: The log is too short for the filter, or unsound.
    """
    how = _all_rows(estimate.preprocessing, log)
    ((prepared,), starts) = with_starts(estimate, [preprocess(log, how)])
    if starts:
        log = replace(log, before=prepared.log.before)
    regressor = RegressorStream(estimate.model, estimate.base)
    torque = regressor.predict(prepared.log, estimate.beta)
    noise = _noise_deviations(estimate, regressor, log, prepared, torque)
    parameters = torque_deviations(estimate, prepared)
    residual = np.maximum(noise, np.asarray(estimate.joint_deviations))
    (held,) = held_along(estimate.model, [parameters_of(estimate)], prepared)
    smooth = prepared.smooth(torque.T).T[prepared.keep]
    reach = held.half + np.abs(held.middle - held.torque)  # the whole interval, about the torque
    return PredictedTorque(
        prepared=prepared,
        torque=smooth,
        half_model=Z_95 * np.hypot(parameters, noise) + reach,
        half_measured=Z_95 * np.hypot(parameters, residual) + reach,
        half_held=reach,
        starts=starts,
    )


def _all_rows(how: Preprocessing, log: Log) -> Preprocessing:
    """Return the preparation that keeps all rows but those near the ends, where the filter lacks samples."""
    cutoff = how.filter.bandwidth()
    trim = how.trim_s if cutoff is None else max(how.trim_s, SPOILED_PERIODS / cutoff)
    if log.duration <= 2 * trim:
        evidence = f"{log.duration:.3g} s, of which the filter spoils {trim:.3g} s at both ends"
        raise LogMismatch(log.name, evidence, "give a longer motion, with a pause before and after it")
    return replace(how, trim_s=trim, rate_hz=None, rows_per_period=None)


def _noise_deviations(
    estimate: Estimate, regressor: RegressorStream, log: Log, prepared: Prepared, torque: Array
) -> Array:
    """Return the standard deviation of the filtered torque by the noise of the positions over the kept rows, (N, n).

    White noise of the power that the positions have above the motion is drawn and added once more. What it changes is,
    in first order, what the noise in the log has changed.
    """
    even = replace(resample(log, prepared.how.longest_gap_s), torque=None, raw_torque=None)
    noise = np.sqrt(noise_floor(even.q, even.rate) * even.rate / 2)
    generator, total = np.random.default_rng(SEED), np.zeros((len(prepared.keep), len(noise)))
    for _ in range(DRAWS):
        noisy = preprocess(replace(even, q=even.q + noise * generator.normal(size=even.q.shape)), prepared.how)
        change = regressor.predict(noisy.log, estimate.beta) - torque
        total += prepared.smooth(change.T).T[prepared.keep] ** 2
    return np.sqrt(total / DRAWS)


def torque_deviations(estimate: Estimate, prepared: Prepared) -> Array:
    """Return the standard deviation of the predicted torque by the parameters' covariance over the kept rows, (N, n).

    The torque is filtered as the measured one is; noise and errors of the model come on top.

    Args:
        estimate: The estimate.
        prepared: A preprocessed log.

    Raises:
        LogMismatch: The log has no velocities or accelerations yet.
    """
    regressor, beta = RegressorStream(estimate.model, estimate.base), estimate.beta
    log = prepared.log
    if "torque" not in estimate.model.needs:
        still = replace(prepared, log=replace(log, torque=np.zeros_like(log.q)))  # the measured torque does not count
        return prediction_deviations(regressor, still, estimate.covariance)
    # With friction that depends on the load the torque is not linear in beta: slopes by central differences.
    squares = np.zeros((len(prepared.keep), log.q.shape[1]))
    for root in covariance_root(estimate.covariance):
        slope = 0.5 * (regressor.predict(log, beta + root) - regressor.predict(log, beta - root))
        squares += prepared.smooth(slope.T).T[prepared.keep] ** 2
    return np.sqrt(squares)
