"""Validation: measured against predicted torque, per joint and in total."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from dynident.arrays import Array, BoolArray, finite, plain
from dynident.data.log import Log
from dynident.identification.estimate.envelope import Departure
from dynident.methods import ShortText

#: Quantile of the normal distribution for 95 % between minus and plus.
Z_95 = 1.959963984540054

#: What is found beside the figures, as it is in plain data.
_FOUND = ("at_rest", "start_states")


@dataclass(frozen=True)
class Fit:
    """Figures of one joint; relative figures are fractions, torques in the joint's unit.

    ``rmse``, ``correlation``, ``r2`` and ``relative_error`` use the torque filtered as stated beside them. A figure
    that does not exist (a torque that never changes, no row) is NaN, and null in JSON.

    Attributes:
        name: Joint.
        unit: N m or N.
        samples: Samples counted.
        rmse: Root mean square of the residual.
        rmse_unfiltered: The same against the torque before the filter; the prediction is filtered all the same.
        correlation: (18).
        r2: 1 - residual variance about zero / variance of the torque.
        relative_error: |residual| / |torque|, not centred.
        deviation: Standard deviation of the torque.
    """

    name: str
    unit: str
    samples: int
    rmse: float
    rmse_unfiltered: float
    correlation: float
    r2: float
    relative_error: float
    deviation: float


@dataclass(frozen=True)
class NominalErrors:
    """Relative errors of the robot model's own inertias on the samples of a validation, fractions.

    Attributes:
        friction_fitted: Total, with friction, offset and rotor inertia fitted alone, on the data of the fit.
        nothing_fitted: Total, without friction.
        joints_friction_fitted: The first of each joint.
        joints_nothing_fitted: The second of each joint.
        friction: Parameters of friction, offset and rotor inertia that were fitted, by name.
    """

    friction_fitted: float
    nothing_fitted: float
    joints_friction_fitted: tuple[float, ...]
    joints_nothing_fitted: tuple[float, ...]
    friction: Mapping[str, float]

    def figures(self) -> dict[str, Any]:
        """Return the errors as plain data; one that does not exist is None."""
        return plain(asdict(self) | {"friction": [{"name": k, "value": value} for k, value in self.friction.items()]})


@dataclass(frozen=True, repr=False)
class Validation(ShortText):
    """How well a model predicts logs.

    Attributes:
        joints: Figures per joint over all rows.
        moving: The same over rows where no drive of the joint rests.
        total_relative_error: |residual| / |torque| over all joints and rows, not centred.
        samples: Time samples.
        standstill: Speed in rad/s below which a joint rests when it stays there, of slides times their travel.
        filter: What was done to the signals; stands beside every figure.
        logs: Names of the logs.
        time: Concatenated time of the logs, shape (N,), in s; starts anew with each log.
        starts: First sample of each log in the arrays.
        q: Positions, shape (N, n).
        dq: Velocities, shape (N, n).
        measured: Filtered torque, shape (N, n).
        unfiltered: Torque before the filter, shape (N, n).
        predicted: Torque of the model, shape (N, n).
        departure: How the logs lie to those of the fit; None for those of the fit itself.
        deviations: Standard deviation of ``predicted`` by the covariance of the parameters, shape (N, n); None where
            it was not computed.
        noise: Residual standard deviation of each joint in the fit, shape (n,); None where it is not known.
        nominal: Errors of the robot model's own inertias on the same samples; None where it states none, or where they
            were not computed.
        free_bodies_error: Total relative error of the same fit without bounds of bodies on the same samples; None where
            the estimate has none, and on the data of the fit.
        at_rest: Of joints with samples at rest, how these lie to what static friction can hold.
        start_states: States of friction at the start of logs, as they were found from these.
        held: Least and largest torque of the model, shape (N, n) each: ``predicted``, and at rest what static friction
            can hold; None where samples at rest count against ``predicted``.
    """

    joints: tuple[Fit, ...]
    moving: tuple[Fit, ...]
    total_relative_error: float
    samples: int
    standstill: float
    filter: Mapping[str, Any]
    logs: tuple[str, ...]
    time: Array
    starts: tuple[int, ...]
    q: Array
    dq: Array
    measured: Array
    unfiltered: Array
    predicted: Array
    departure: Departure | None = None
    deviations: Array | None = None
    noise: Array | None = None
    nominal: NominalErrors | None = None
    free_bodies_error: float | None = None
    at_rest: tuple[Mapping[str, Any], ...] = ()
    start_states: tuple[Mapping[str, Any], ...] = ()
    held: tuple[Array, Array] | None = None

    @property
    def nearest(self) -> Array:
        """Torque of the model that the errors count against, in ``held`` nearest to the measured one, shape (N, n)."""
        return self.predicted if self.held is None else np.clip(self.measured, *self.held)

    @property
    def residual(self) -> Array:
        """Measured torque less the nearest of the model, shape (N, n)."""
        return self.measured - self.nearest

    @property
    def rests(self) -> bool:
        """Whether a joint rests in some rows."""
        return sum(fit.samples for fit in self.moving) < sum(fit.samples for fit in self.joints)

    @property
    def moving_relative_error(self) -> float:
        """|residual| / |torque| over all joints and the rows in motion; NaN where none moves."""
        known = [fit for fit in self.moving if fit.samples and fit.relative_error > 0]
        residual = sum(fit.samples * fit.rmse**2 for fit in known)
        torque = sum(fit.samples * (fit.rmse / fit.relative_error) ** 2 for fit in known)
        return ratio(np.sqrt(residual), np.sqrt(torque))

    def half_widths(self) -> tuple[Array, Array] | None:
        """Return half the widths of the 95 % bands about the prediction, shape (N, n) each; None where not known.

        The first is by the deviations of the parameters, the second with the noise of the fit. What the model does not
        have is in neither: a share of rows inside that is far below 95 % shows it.
        """
        if self.deviations is None or self.noise is None:
            return None
        return Z_95 * self.deviations, Z_95 * np.hypot(self.deviations, self.noise)

    def bands(self) -> list[dict[str, Any]]:
        """Return for each joint as plain data how wide its 95 % bands are and which share of rows lies inside.

        Empty where they are not known.
        """
        widths = self.half_widths()
        if widths is None or not len(self.time):
            return []
        parameters, whole = (np.sqrt(np.mean(np.square(width), axis=0)) for width in widths)
        inside = np.mean(np.abs(self.residual) <= widths[1], axis=0)
        return [
            {"name": fit.name, "unit": fit.unit, "parameters": float(a), "whole": float(b), "inside": float(c)}
            for fit, a, b, c in zip(self.joints, parameters, whole, inside, strict=True)
        ]

    def figures(self) -> dict[str, Any]:
        """Return the figures as plain data for JSON; a figure that does not exist is None."""
        return {
            "total_relative_error": finite(self.total_relative_error),
            "samples": self.samples,
            "logs": list(self.logs),
            "joints": [_figures(fit) for fit in self.joints],
            "moving": {
                "standstill": self.standstill,
                "total_relative_error": finite(self.moving_relative_error),
                "joints": [_figures(fit) for fit in self.moving],
            },
            "bands": self.bands(),
            **{name: [dict(each) for each in own] for name in _FOUND if (own := getattr(self, name))},
            **({} if self.nominal is None else {"nominal": self.nominal.figures()}),
            **({} if self.free_bodies_error is None else {"free_bodies_error": finite(self.free_bodies_error)}),
        }


def _figures(fit: Fit) -> dict[str, Any]:
    numbers = ("rmse", "rmse_unfiltered", "correlation", "r2", "relative_error")
    facts = {"name": fit.name, "unit": fit.unit, "samples": fit.samples}
    return facts | {name: finite(getattr(fit, name)) for name in numbers}


def compare_torques(
    logs: Sequence[Log],
    predictions: Sequence[Array],
    moving: Sequence[BoolArray],
    units: Sequence[str],
    standstill: float,
    filter: Mapping[str, Any],
) -> Validation:
    """Return the figures of predicted against measured torques.

    Args:
        logs: Preprocessed logs with torque; raw_torque where a filter changed it.
        predictions: Predicted torques of each log, filtered like the measured ones, shape (N, n).
        moving: Which rows are not at rest, per log, shape (N, n).
        units: Unit of each joint's torque.
        standstill: Speed that divides moving rows from rest.
        filter: Statement of the preprocessing.
    """
    measured = np.concatenate([np.asarray(log.torque) for log in logs])
    raw = np.concatenate([np.asarray(log.torque if log.raw_torque is None else log.raw_torque) for log in logs])
    predicted = np.concatenate(predictions)
    keep = np.concatenate(moving)
    names, lengths = logs[0].joints, [log.samples for log in logs]
    return Validation(
        joints=fits_of(names, units, measured, raw, predicted, np.ones_like(keep)),
        moving=fits_of(names, units, measured, raw, predicted, keep),
        total_relative_error=ratio(np.linalg.norm(measured - predicted), np.linalg.norm(measured)),
        samples=sum(lengths),
        standstill=standstill,
        filter=dict(filter),
        logs=tuple(log.name for log in logs),
        time=np.concatenate([log.time for log in logs]),
        starts=tuple(np.cumsum([0, *lengths[:-1]]).tolist()),
        q=np.concatenate([log.q for log in logs]),
        dq=np.concatenate([np.asarray(log.dq) for log in logs]),
        measured=measured,
        unfiltered=raw,
        predicted=predicted,
    )


def ratio(part: Any, whole: Any) -> float:
    """Return part / whole; NaN where there is no whole."""
    return float(part / whole) if whole > 0 else float("nan")


def fits_of(
    names: Sequence[str], units: Sequence[str], measured: Array, raw: Array, predicted: Array, keep: BoolArray
) -> tuple[Fit, ...]:
    """Return the figures of each joint over the rows ``keep``, all arrays of shape (N, n)."""
    return tuple(
        _fit(name, unit, *[signal[keep[:, i], i] for signal in (measured, raw, predicted)])
        for i, (name, unit) in enumerate(zip(names, units, strict=True))
    )


def _fit(name: str, unit: str, measured: Array, raw: Array, predicted: Array) -> Fit:
    if not len(measured):
        return Fit(name, unit, 0, *[float("nan")] * 6)
    error, spread = measured - predicted, float(np.linalg.norm(_centred(measured)) / np.sqrt(len(measured)))
    return Fit(
        name=name,
        unit=unit,
        samples=len(measured),
        rmse=float(np.sqrt(np.mean(error**2))),
        rmse_unfiltered=float(np.sqrt(np.mean((raw - predicted) ** 2))),
        correlation=correlation(measured, predicted),
        r2=1.0 - float(np.mean(error**2)) / spread**2 if spread > 0 else float("nan"),
        relative_error=ratio(np.linalg.norm(error), np.linalg.norm(measured)),
        deviation=spread,
    )


def correlation(measured: Array, predicted: Array) -> float:
    """Return the normalised cross-covariance (18) of two signals, shape (N,); NaN where one never changes."""
    a, b = _centred(measured), _centred(predicted)
    return ratio(a @ b, np.linalg.norm(a) * np.linalg.norm(b))


def _centred(signal: Array) -> Array:
    """Return a signal less its mean; exactly zero where it never changes, whatever the mean is rounded to."""
    return signal - np.mean(signal) if np.ptp(signal) > 0 else np.zeros_like(signal)
