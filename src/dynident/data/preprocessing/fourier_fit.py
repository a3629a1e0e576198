"""Period averaging and Fourier fit with analytic derivatives, section 3.3 of the article."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dynident.arrays import Array
from dynident.data.log import Log
from dynident.data.preprocessing._local_polynomials import five_point_smoothing
from dynident.data.preprocessing.base import Filter
from dynident.errors import BadOption, LogMismatch
from dynident.plugins import bounded

#: Samples by which the periods of a log may run out of step before it is resampled; averaging would smear them.
SLIP = 0.01


@dataclass(frozen=True)
class FourierFit(Filter):
    """Average whole periods, fit a Fourier series to the positions, differentiate it; for periodic excitation.

    Positions become the least-squares series of ``harmonics`` terms, velocities and accelerations its derivatives
    (Swevers et al. 1997). Torques are averaged over the periods and smoothed by (17).

    Attributes:
        period_s: Period of the motion in s.
        harmonics: Number of sine and cosine pairs.
        torque_repeats: How often (17) smooths the averaged torque; 0 for not at all.
    """

    period_s: float = 25.0
    harmonics: int = bounded(5, most=1_000)
    torque_repeats: int = bounded(10, most=1_000)

    def __post_init__(self) -> None:
        if not 0 < self.period_s < np.inf:
            raise BadOption("period_s", self.period_s, "give the period in s")
        if self.harmonics < 1:
            raise BadOption("harmonics", self.harmonics, "give 1 or more")
        if self.torque_repeats < 0:
            raise BadOption("torque_repeats", self.torque_repeats, "give 0 or more")

    def apply(self, log: Log) -> Log:
        log = _on_whole_samples(log, self.period_s)
        per_period = round(self.period_s * log.rate)
        periods = log.samples // per_period if per_period else 0
        if not periods or per_period < 2 * self.harmonics + 1:
            evidence = f"{log.duration:.4g} s at {log.rate:.4g} Hz hold no whole period of {self.period_s:g} s"
            step = f"{evidence} with {self.harmonics} harmonics" if periods else evidence
            raise LogMismatch(log.name, step, "state the period of the excitation, or choose another filter")
        whole = periods * per_period

        def average(signal: Array) -> Array:
            return signal[:whole].reshape(periods, per_period, -1).mean(axis=0)

        time = log.time[:per_period]
        basis = fourier_basis(time - time[0], self.period_s, self.harmonics)
        series = np.linalg.lstsq(basis[0], average(log.q), rcond=None)[0]
        raw = None if log.torque is None else average(log.torque)
        torque = raw if raw is None or not self.torque_repeats else five_point_smoothing(raw, self.torque_repeats)
        text = f"{periods} periods of {self.period_s:g} s averaged, Fourier fit of {self.harmonics} harmonics"
        kept: dict[str, Array | None] = {name: None for name in ("current", "temperature")}
        for name in ("q_ref", "dq_ref"):
            commanded: Array | None = getattr(log, name)
            kept[name] = None if commanded is None else average(commanded)
        return replace(
            log.with_step(f"{text}, torque smoothed {self.torque_repeats} times by five points"),
            time=time,
            q=basis[0] @ series,
            dq=basis[1] @ series,
            ddq=basis[2] @ series,
            torque=torque,
            raw_torque=raw,
            **kept,
        )

    def statement(self) -> dict[str, object]:
        return {
            "kind": "fourier_fit",
            "cutoff_hz": self.harmonics / self.period_s,
            "order": self.harmonics,
            "torque": f"period average, five-point smoothing {self.torque_repeats} times",
        }


def _on_whole_samples(log: Log, period: float) -> Log:
    """Return a log of several periods with whole samples per period, by linear interpolation where it has not."""
    rate = round(period * log.rate) / period
    if not rate or log.samples < 2 * period * rate or abs(rate / log.rate - 1) * log.samples < SLIP:
        return log
    time = log.time[0] + np.arange(int(log.duration * rate + 1e-6) + 1) / rate
    moved = {
        name: np.column_stack([np.interp(time, log.time, column) for column in values.T])
        for name, values in log.signals().items()
    }
    return replace(log.with_step(f"resampled to {rate:.8g} Hz, whole samples per period"), time=time, **moved)


def fourier_basis(time: Array, period: float, harmonics: int) -> tuple[Array, Array, Array]:
    """Return the basis 1, sin(k w t).., cos(k w t).. of (14) and its two derivatives, each (N, 2 harmonics + 1)."""
    pulsation = 2 * np.pi / period * np.arange(1, harmonics + 1)
    sine, cosine = np.sin(np.outer(time, pulsation)), np.cos(np.outer(time, pulsation))
    one, zero = np.ones((len(time), 1)), np.zeros((len(time), 1))
    return (
        np.hstack([one, sine, cosine]),
        np.hstack([zero, pulsation * cosine, -pulsation * sine]),
        np.hstack([zero, -(pulsation**2) * sine, -(pulsation**2) * cosine]),
    )
