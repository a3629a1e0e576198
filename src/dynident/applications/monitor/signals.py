"""The signals of a log that an observer takes, as a controller would have them: no filter that knows the future."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.signal

from dynident.applications.monitor.momentum_observer import MomentumObserver
from dynident.applications.start_states import first_states
from dynident.arrays import Array
from dynident.data.log import Log
from dynident.data.preprocessing import check_finite, resample
from dynident.errors import LogMismatch
from dynident.identification.estimate.estimate import Estimate


@dataclass(frozen=True)
class Signals:
    """Samples on a uniform grid.

    Attributes:
        name: Of the log.
        time: Shape (N,), in s.
        q: Positions, shape (N, n), in rad or m.
        dq: Velocities, shape (N, n), in rad/s or m/s.
        torque: Measured torques at the same instants, shape (N, n), in N m or N.
        temperature: Of the drives, shape (N, n), in degrees Celsius; None where the log has none.
        first: States of friction at the first sample, shape (n, s); None for their start.
    """

    name: str
    time: Array
    q: Array
    dq: Array
    torque: Array
    temperature: Array | None = None
    first: Array | None = None

    @property
    def step(self) -> float:
        """Seconds a sample."""
        return float(self.time[-1] - self.time[0]) / (len(self.time) - 1)


def signals_of(estimate: Estimate, log: Log) -> Signals:
    """Return the signals of a log; time is made uniform, the motion shifted by the torque's delay in the fit.

    Where the log has no velocities they are differences of positions, and positions and torques are means over the same
    two samples. Drives whose friction lasts for minutes begin as its torques say best.

    Raises:
        LogMismatch: No torques or temperatures, or a log that does not fit the robot.
    """
    log = log.ordered(estimate.model.robot.joint_names)
    check_finite(log)
    log = resample(log)
    if log.torque is None:
        raise LogMismatch(log.name, "no torques", "map torque columns, or currents with drive gains, in the case file")
    if "temperature" in estimate.model.needs and log.temperature is None:
        raise LogMismatch(log.name, "no temperatures of the drives", "map them: the friction depends on them")
    time, q, dq, torque, warm = log.time, log.q, log.dq, log.torque, log.temperature
    if dq is None:
        dq = np.diff(q, axis=0) / np.diff(time)[:, None]
        time, q, torque = (0.5 * (values[1:] + values[:-1]) for values in (time, q, torque))
        warm = None if warm is None else warm[1:]
    delay = estimate.preprocessing.delay_s or 0.0
    if delay:
        early = time - delay
        inside = (early >= time[0]) & (early <= time[-1])
        q, dq = (np.column_stack([np.interp(early[inside], time, one) for one in values.T]) for values in (q, dq))
        time, torque = time[inside], torque[inside]
        warm = None if warm is None else warm[inside]
    if len(time) < 10:
        raise LogMismatch(log.name, f"{len(time)} samples are left", "give a longer log")
    return Signals(log.name, time, q, dq, torque, warm, first_states(estimate, log))


def residuals_of(observer: MomentumObserver, signals: Signals) -> Array:
    """Return the observer's residual at each sample, zero at the first, shape (N, n), in N m or N."""
    outside = observer.outside(signals.time, signals.q, signals.dq, signals.torque, signals.temperature, signals.first)
    return followed(outside, float(np.exp(-observer.gain * signals.step)))


def followed(means: Array, keep: float) -> Array:
    """Return what follows means over each step (N - 1, n) as the observer's residual does, zero at first, (N, n)."""
    found = np.asarray(scipy.signal.lfilter([1.0 - keep], [1.0, -keep], means, axis=0))
    return np.concatenate([np.zeros((1, found.shape[1])), found])


def held_share(held: Array, keep: float) -> Array:
    """Return how much of the observer's residual static friction can be that holds up to ``held``, shape (N, n)."""
    return followed(0.5 * (held[:-1] + held[1:]), keep)
