"""The signals of a log that an observer takes, as a controller would have them: no filter that knows the future."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import scipy.signal

from dynident.applications.monitor.momentum_observer import UNSEEN, MomentumObserver
from dynident.applications.start_states import first_states
from dynident.arrays import Array
from dynident.data.log import Log, measured_torque
from dynident.data.preprocessing import BRIDGED, check_finite, resample
from dynident.data.preprocessing._closed_brakes import closed_brakes
from dynident.errors import LogMismatch
from dynident.identification.estimate.estimate import Estimate

#: Samples that a log, or a part of it between gaps, has at least.
LEAST = 10


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
        steps: Starts and ends of the long steps of the log, over which straight lines go, shape (G, 2), in s.
        braked: Starts and ends of spells with closed brakes, which are not watched, shape (k, 2), in s.
        delay: Of the torques, by which the motion was shifted, in s.
    """

    name: str
    time: Array
    q: Array
    dq: Array
    torque: Array
    temperature: Array | None = None
    first: Array | None = None
    steps: Array = field(default_factory=lambda: np.zeros((0, 2)))
    braked: Array = field(default_factory=lambda: np.zeros((0, 2)))
    delay: float = 0.0

    @property
    def step(self) -> float:
        """Seconds a sample."""
        return float(self.time[-1] - self.time[0]) / (len(self.time) - 1)

    def gaps(self, observer: MomentumObserver) -> Array:
        """Return the steps over which the observer does not follow, shape (k, 2), in s."""
        return self.steps[np.diff(self.steps, axis=1)[:, 0] > observer.longest_step(self.step)]

    def stretches(self, observer: MomentumObserver) -> list[Signals]:
        """Return the parts between gaps, over which the observer does not follow; the whole where there is none.

        Spells with closed brakes are gaps.
        """
        gaps = np.concatenate([self.gaps(observer), self.braked])
        known = np.ones(len(self.time), dtype=bool)
        before, after = 2 * self.step - min(self.delay, 0.0), 2 * self.step + max(self.delay, 0.0)
        for start, end in gaps:  # velocities and shifted motions are made of samples on both sides
            known &= (self.time <= start - before) | (self.time >= end + after)
        cuts = np.flatnonzero(np.diff(known, prepend=False, append=False)).reshape(-1, 2)
        states = observer.states(self.q, self.dq, self.step, self.first) if len(gaps) else None
        found = []
        for start, stop in cuts[np.diff(cuts, axis=1)[:, 0] >= LEAST].tolist():
            first = self.first if states is None or not start else states[start]
            rows = {name: getattr(self, name) for name in ("time", "q", "dq", "torque", "temperature")}
            own = {name: None if one is None else one[start:stop] for name, one in rows.items()}
            found.append(replace(self, **own, first=first, steps=np.zeros((0, 2)), braked=np.zeros((0, 2))))
        return found


def signals_of(estimate: Estimate, log: Log) -> Signals:
    """Return the signals of a log; time is made uniform, the motion shifted by the torque's delay in the fit.

    Where the log has no velocities they are differences of positions, and positions and torques are means over the same
    two samples. Drives whose friction lasts for minutes begin as its torques say best. Gaps in time are bridged by
    straight lines and told, see :meth:`Signals.stretches`.

    Raises:
        LogMismatch: No torques or temperatures, or a log that does not fit the robot.
    """
    log = log.ordered(estimate.model.robot.joint_names)
    check_finite(log)
    steps = np.diff(log.time)
    long = np.flatnonzero(steps > UNSEEN * np.median(steps)) if len(steps) else []
    log, steps = resample(log, BRIDGED), np.column_stack([log.time[long], log.time[np.add(long, 1, dtype=int)]])
    torque, braked = measured_torque(log), closed_brakes(log)
    if "temperature" in estimate.model.needs and log.temperature is None:
        raise LogMismatch(log.name, "no temperatures of the drives", "map them: the friction depends on them")
    time, q, dq, warm = log.time, log.q, log.dq, log.temperature
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
    if len(time) < LEAST:
        raise LogMismatch(log.name, f"{len(time)} samples are left", "give a longer log")
    return Signals(log.name, time, q, dq, torque, warm, first_states(estimate, log), steps, braked, delay)


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
