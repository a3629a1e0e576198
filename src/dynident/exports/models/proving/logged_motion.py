"""The motion of a log as a trajectory, for a simulated robot to follow: some seconds, smooth, with its derivatives."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from dynident.arrays import Array
from dynident.data.log import Log
from dynident.data.preprocessing import check_finite, check_turns, resample
from dynident.errors import LogMismatch
from dynident.excitation.trajectories.base import Trajectory, times
from dynident.identification.simulated.course import smoothed

#: Longest part of a log that is followed, in s.
LONGEST = 10.0

#: What is faster is left out of the positions, in Hz: noise of encoders has accelerations without end.
CUTOFF_HZ = 10.0

#: Times a second at which the part with the most motion is looked for.
_LOOK_HZ = 10.0


@dataclass(frozen=True)
class LoggedMotion(Trajectory):
    """The quintic spline through the low-pass filtered positions of a part of a log.

    Attributes:
        log: Name of the log.
        start: Where the part begins, in s of the log.
        q: Positions on a uniform grid from time 0 on, shape (N, n), in rad or m.
        rate: Samples a second.
    """

    log: str
    start: float
    q: Array
    rate: float

    def __post_init__(self) -> None:
        from scipy.interpolate import make_interp_spline  # loads slowly

        spline: Any = make_interp_spline(np.arange(len(self.q)) / self.rate, self.q, k=5)
        object.__setattr__(self, "_orders", [spline, *(spline.derivative(k) for k in (1, 2, 3))])

    @property
    def duration(self) -> float:
        """Length in s."""
        return (len(self.q) - 1) / self.rate

    @property
    def periodic(self) -> bool:
        """It happens once."""
        return False

    @property
    def joints(self) -> int:
        return self.q.shape[1]

    def evaluate(self, time: npt.ArrayLike) -> tuple[Array, Array, Array]:
        at = np.clip(times(time), 0.0, self.duration)
        orders: Any = getattr(self, "_orders")  # noqa: B009
        return orders[0](at), orders[1](at), orders[2](at)

    def jerk(self, time: npt.ArrayLike) -> Array:
        orders: Any = getattr(self, "_orders")  # noqa: B009
        return orders[3](np.clip(times(time), 0.0, self.duration))


def logged_motion(log: Log, longest_gap: float | None = None) -> LoggedMotion:
    """Return up to ten seconds of a log in which the joints move most, without what is faster than 10 Hz.

    Args:
        log: The log, its joints in the order of the robot.
        longest_gap: Longest gap in time in s that a straight line bridges; None for half a second.

    Raises:
        LogMismatch: Too few samples, a value that is no number, a gap in time, or a position that starts again after a
            whole turn.
    """
    check_finite(log)
    if log.samples < 10:
        raise LogMismatch(log.name, f"only {log.samples} samples", "give a log of some seconds of motion")
    first = _most_motion(log)
    part = log.rows((log.time >= first) & (log.time <= first + LONGEST), "the part with the most motion")
    check_turns(part)
    even = resample(part, longest_gap)
    rate = (even.samples - 1) / even.duration
    return LoggedMotion(log.name, float(even.time[0]), smoothed(even.q, min(CUTOFF_HZ / rate, 0.4)), rate)


def _most_motion(log: Log) -> float:
    """Return the time at which the ten seconds with the largest sum of squared speeds over spans begin, in s."""
    if log.duration <= LONGEST:
        return float(log.time[0])
    time = np.arange(log.time[0], log.time[-1], 1.0 / _LOOK_HZ)
    q = np.stack([np.interp(time, log.time, joint) for joint in log.q.T], axis=1)
    spans = np.ptp(q, axis=0)
    speed = np.diff(q / np.where(spans > 0, spans, 1.0), axis=0)
    total = np.append(0.0, np.cumsum(np.sum(speed**2, axis=1)))
    count = min(round(LONGEST * _LOOK_HZ), len(total) - 1)
    return float(time[int(np.argmax(total[count:] - total[:-count]))])
