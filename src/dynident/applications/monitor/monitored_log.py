"""run_monitor: a log through a monitor, with its alarms."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from dynident.applications.monitor.monitor import APART, Alarm, Monitor
from dynident.applications.monitor.signals import residuals_of, signals_of
from dynident.arrays import Array
from dynident.data.log import Log
from dynident.errors import LogMismatch

#: Share of a log above the threshold that is no contact any more.
MOSTLY = 0.5


@dataclass(frozen=True)
class Monitored:
    """A log as a monitor saw it.

    Attributes:
        log: Its name.
        joints: Names.
        time: Shape (N,), in s.
        residual: Torque from outside, shape (N, n), in N m or N.
        threshold: Shape (N, n).
        held: How much of it is what static friction can hold at rest, shape (N, n).
        alarms: In order of time.
        other_rate: What to do where the log is at another sampling rate than the clean runs; empty where it is not.
        gaps: Number of gaps in time behind which the observer began anew.
        braked: Start and end in s of the spells with closed brakes, which are not watched.
    """

    log: str
    joints: tuple[str, ...]
    time: Array
    residual: Array
    threshold: Array
    held: Array
    alarms: tuple[Alarm, ...]
    other_rate: str = ""
    gaps: int = 0
    braked: tuple[tuple[float, float], ...] = ()

    @property
    def seconds(self) -> float:
        """Length of the log, in s."""
        return float(self.time[-1] - self.time[0])

    @property
    def mostly_above(self) -> tuple[str, ...]:
        """Joints above their threshold for more than half of the log: no contact lasts so long as a rule."""
        share = np.mean(np.abs(self.residual) > self.threshold, axis=0)
        return tuple(name for name, one in zip(self.joints, share, strict=True) if one > MOSTLY)

    def figures(self) -> dict[str, Any]:
        """Return the alarms and each joint's figures as plain data."""
        share = np.abs(self.residual) / self.threshold
        return {
            "log": self.log,
            "seconds": self.seconds,
            "samples": len(self.time),
            "other_rate": self.other_rate,
            "gaps": self.gaps,
            "alarms": [asdict(alarm) for alarm in self.alarms],
            "joints": [
                {
                    "name": name,
                    "alarms": sum(alarm.joint == name for alarm in self.alarms),
                    "largest_share_of_threshold": float(share[:, j].max()),
                    "residual_rms": float(np.sqrt(np.mean(self.residual[:, j] ** 2))),
                    "threshold": float(np.median(self.threshold[:, j])),
                    "held": float(self.held[:, j].max()),
                }
                for j, name in enumerate(self.joints)
            ],
        }


def run_monitor(monitor: Monitor, log: Log) -> Monitored:
    """Return what a monitor says about a log; behind a gap in time the observer begins anew.

    Args:
        monitor: The monitor.
        log: Raw, with positions and torques.

    Raises:
        LogMismatch: The log does not fit the robot, has no torques, or gaps that leave no stretch of ten samples.
    """
    observer = monitor.observer
    whole = signals_of(observer.estimate, log)
    parts = whole.stretches(observer)
    if not parts:
        raise LogMismatch(whole.name, "gaps everywhere: no ten samples in a row", "log without losing samples")
    time, residual = np.concatenate([one.time for one in parts]), [residuals_of(observer, one) for one in parts]
    own, held = (np.concatenate(each) for each in zip(*map(monitor.parts, parts), strict=True))
    residual, threshold, names = np.concatenate(residual), own + held, observer.model.robot.joint_names
    found = [
        alarm
        for j, name in enumerate(names)
        for alarm in _alarms(name, time, residual[:, j], threshold[:, j], APART / observer.gain)
    ]
    alarms, other_rate = tuple(sorted(found, key=lambda one: one.start)), monitor.other_rate(whole.step)
    gaps, braked = len(whole.gaps(observer)), tuple((float(start), float(end)) for start, end in whole.braked)
    return Monitored(whole.name, names, time, residual, threshold, held, alarms, other_rate, gaps, braked)


def _alarms(name: str, time: Array, residual: Array, threshold: Array, apart: float) -> list[Alarm]:
    above = np.flatnonzero(np.abs(residual) > threshold)
    if not len(above):
        return []
    parts = np.split(above, np.flatnonzero(np.diff(time[above]) > apart) + 1)
    found = []
    for part in parts:
        top = part[int(np.argmax(np.abs(residual[part]) / threshold[part]))]
        ends = (float(time[part[0]]), float(time[part[-1]]))
        found.append(Alarm(name, *ends, float(residual[top]), float(threshold[top])))
    return found
