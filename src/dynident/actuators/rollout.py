"""Roll-outs of a servo joint over logs, and their errors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from dynident.actuators.drive_law import DriveLaw
from dynident.actuators.joint_load import JointLoad, loop_samples
from dynident.actuators.parameters import COUNT
from dynident.actuators.rollout_loop import roll_out
from dynident.actuators.servo_log import ServoLog
from dynident.arrays import Array, BoolArray, IntArray

#: Longest step of the integration in s: of a search, and of the answer.
SEARCH_STEP, STEP = 4e-3, 5e-4

#: No derivative is asked for.
NONE: Final = np.full(COUNT, -1)

#: Samples by which the velocity at the start is found.
_FIRST = 8


@dataclass(frozen=True)
class JointRecord:
    """One joint in one log, as the roll-out takes it.

    Attributes:
        name: The log.
        samples: Shape (N, COLUMNS) of ``rollout_loop``.
        loads: Shape ((N - 1) S, LOADS) of ``rollout_loop``.
        law: Numbers of the drive law at the gain of the log, shape (4,).
        kp: Gain of the log.
        q: Measured positions, shape (N,), in rad.
        used: Samples whose error counts: reads that did not fail, shape (N,).
        start: Position and velocity at the first sample, shape (2,).
    """

    name: str
    samples: Array
    loads: Array
    law: Array
    kp: float
    q: Array
    used: BoolArray
    start: Array

    def part(self, first: int, last: int) -> JointRecord:
        """Return some of the samples, started from the measurement there."""
        own = slice(first, last)
        loads = self.loads[first * self.parts : (last - 1) * self.parts]
        q, used = self.q[own], self.used[own]
        start = start_of(self.samples[own, 0], q, used)
        return replace(self, samples=self.samples[own], loads=loads, q=q, used=used, start=start)

    @property
    def parts(self) -> int:
        """S, the rows of the load for each interval between two samples."""
        return len(self.loads) // (len(self.samples) - 1)

    def under(self, load: JointLoad) -> JointRecord:
        """Return the record with another load."""
        return replace(self, loads=load.rows)

    def finely(self, time: Array) -> JointRecord:
        """Return the record with a sample at each end of a part of the load, at the times (K + 1,) of these."""
        held = np.minimum(np.arange(len(time)) // self.parts, len(self.samples) - 1)
        samples = self.samples[held]
        samples[:, 0] = time
        used = self.used[held] & (np.arange(len(time)) % self.parts == 0)
        return replace(self, samples=samples, q=self.q[held], used=used)


def start_of(time: Array, q: Array, used: BoolArray) -> Array:
    """Return position and velocity at the first sample, shape (2,): the line through the first few reads."""
    few = np.flatnonzero(used)[:_FIRST]
    if len(few) < 3:
        return np.array([q[0], 0.0])
    slope = np.polyfit(time[few] - time[0], q[few], 1)[0]
    return np.array([q[0], slope if abs(slope) > 0.02 else 0.0])


def record_of(log: ServoLog, joint: int, load: JointLoad, law: DriveLaw) -> JointRecord:
    """Return one joint of a log as the roll-out takes it."""
    used = ~log.failed[:, joint]
    return JointRecord(
        name=log.name,
        samples=loop_samples(log, joint),
        loads=load.rows,
        law=law.numbers(log.kp),
        kp=log.kp,
        q=log.q[:, joint],
        used=used,
        start=start_of(log.time, log.q[:, joint], used),
    )


@dataclass(frozen=True)
class Rollout:
    """A roll-out.

    Attributes:
        q: Positions at the samples, shape (N,), in rad.
        dq: Velocities, shape (N,), in rad/s.
        slopes: Their derivatives by the parameters, shape (N, f).
        saturated: Whether the duty was at its limit after a sample, shape (N,).
    """

    q: Array
    dq: Array
    slopes: Array
    saturated: BoolArray


def rolled_out(record: JointRecord, parameters: Array, at: IntArray = NONE, longest: float = STEP) -> Rollout:
    """Return the roll-out of a joint from the first sample of a log with its commands as the only input.

    Args:
        record: The joint in the log.
        parameters: In the order of PARAMETERS, shape (COUNT,).
        at: Column of the derivatives by each parameter, shape (COUNT,); equal parameters share one, -1: none.
        longest: Longest step of the integration in s.
    """
    count = len(record.q)
    out = np.empty((count, 4 + int(at.max())))
    roll_out(parameters, record.samples, record.loads, record.law, record.start, longest, at, out)
    return Rollout(out[:, 0], out[:, 1], out[:, 3:], out[:, 2] > 0.5)


def mean_errors(records: Sequence[JointRecord], parameters: Array, longest: float = SEARCH_STEP) -> Array:
    """Return the mean absolute position error of each roll-out, shape (logs,), in rad."""
    return np.array([mean_error(record, rolled_out(record, parameters, longest=longest).q) for record in records])


def mean_error(record: JointRecord, q: Array) -> float:
    """Return the mean absolute error of rolled-out positions (N,), in rad; infinite where they are no numbers."""
    error = np.abs(q - record.q)[record.used]
    return float(np.mean(error)) if np.isfinite(error).all() else np.inf
