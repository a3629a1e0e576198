"""Roll-outs of a servo joint over logs, and their errors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from dynident.actuators.drive_law import DriveLaw
from dynident.actuators.joint_load import LOAD_STEP, JointLoad, loop_samples
from dynident.actuators.parameters import COUNT
from dynident.actuators.rollout_loop import START_Q, START_V, roll_out
from dynident.actuators.servo_log import ServoLog
from dynident.arrays import Array, BoolArray, IntArray

#: Commands that span less than this many rad or m hold a joint.
HELD = 1e-3

#: Longest step of the integration in s: of the search in some logs of an arm, of the search, and of the answer.
ROUGH_STEP, SEARCH_STEP, STEP = LOAD_STEP, 4e-3, 5e-4

#: Stands for the longest step of the search.
SEARCH: Final = 0.0

#: No derivative is asked for.
NONE: Final = np.full(COUNT + 2, -1)

#: Samples by which the velocity at the start is found where no more of the log may be used.
FIRST = 8

#: Deviation of the velocity at the first of so many samples by a parabola over that by a line.
_PARABOLA = 4.0

#: Steps of Gauss and Newton to position and velocity at the start.
_START_STEPS = 2


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
        read: Samples whose read did not fail, shape (N,).
        used: Those of them whose error counts, shape (N,).
        start: Position and velocity at the first sample, shape (2,).
        says: What the first reads alone say of them, and the standard deviations of that, shape (2, 2).
        search: Longest step of the search in s.
    """

    name: str
    samples: Array
    loads: Array
    law: Array
    kp: float
    q: Array
    read: BoolArray
    used: BoolArray
    start: Array
    says: Array
    search: float = SEARCH_STEP

    def part(self, first: int, last: int) -> JointRecord:
        """Return some of the samples, started from the measurement there."""
        own = slice(first, last)
        loads = self.loads[first * self.parts : (last - 1) * self.parts]
        q, read = self.q[own], self.read[own]
        says = start_of(self.samples[own, 0], q, read)
        mine = {"samples": self.samples[own], "loads": loads, "q": q, "read": read, "used": self.used[own]}
        return replace(self, **mine, start=says[0], says=says)

    @property
    def is_held(self) -> bool:
        """Whether one command holds the joint throughout: the log tests nothing of it where others move."""
        return bool(np.ptp(self.samples[:, 1]) < HELD and self.samples[:, 4].all())

    @property
    def as_first_read(self) -> JointRecord:
        """The record started as the first reads say."""
        return replace(self, start=self.says[0])

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
        at_sample = np.arange(len(time)) % self.parts == 0
        read, used = self.read[held] & at_sample, self.used[held] & at_sample
        return replace(self, samples=samples, q=self.q[held], read=read, used=used)


def start_of(time: Array, q: Array, read: BoolArray) -> Array:
    """Return position and velocity at the first sample by the first few reads, and their deviations, shape (2, 2).

    A joint that may be at rest, gathering speed within these reads, counts as at rest: polynomials through them then
    say the less the higher their degree. Else the velocity is that of the line, and its distance from that of the
    parabola the deviation.
    """
    few = np.flatnonzero(read)[:FIRST]
    levels = np.diff(np.unique(np.round(q[read], 9)))
    noise = float(np.quantile(levels, 0.1)) if len(levels) else 1e-6  # the encoder's step where it has one
    if len(few) < 4:
        return np.array([[q[0], 0.0], [noise, 1.0]])
    stamps = time[few] - time[0]
    noise = max(noise, float(np.sqrt(np.mean(np.diff(q[few], 3) ** 2) / 20.0)))
    slope, bent, cubic = (float(np.polyfit(stamps, q[few], degree)[-2]) for degree in (1, 2, 3))
    scatter = noise / float(np.linalg.norm(stamps - stamps.mean()))
    rests = abs(bent) <= max(abs(bent - slope), _PARABOLA * scatter) or 2.0 * abs(cubic) <= abs(bent) <= abs(slope)
    deviation = max(scatter, abs(slope), abs(bent)) if rests else max(scatter, abs(bent - slope))
    return np.array([[q[0], 0.0 if rests else slope], [noise, deviation]])


def record_of(log: ServoLog, joint: int, load: JointLoad, law: DriveLaw) -> JointRecord:
    """Return one joint of a log as the roll-out takes it."""
    read = ~log.failed[:, joint]
    says = start_of(log.time, log.q[:, joint], read)
    return JointRecord(
        name=log.name,
        samples=loop_samples(log, joint),
        loads=load.rows,
        law=law.numbers(log.kp),
        kp=log.kp,
        q=log.q[:, joint],
        read=read,
        used=read,
        start=says[0],
        says=says,
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
        at: Column of the derivatives by each parameter and by position and velocity at the start, shape (COUNT + 2,);
            equal parameters share one, -1: none.
        longest: Longest step of the integration in s, or SEARCH.
    """
    count = len(record.q)
    out = np.empty((count, 4 + int(at.max())))
    roll_out(parameters, record.samples, record.loads, record.law, record.start, longest or record.search, at, out)
    return Rollout(out[:, 0], out[:, 1], out[:, 3:], out[:, 2] > 0.5)


def _start_weights(record: JointRecord, error: Array, by_start: Array) -> tuple[Array, Array]:
    """Return the inverse of the normal matrix of the start (2, 2), and the weight of what the first reads say (2,)."""
    normal = by_start.T @ by_start
    left = error - by_start @ (_inverse(normal) @ (by_start.T @ error))
    prior = max(float(np.mean(left**2)), 1e-14) / record.says[1] ** 2
    return _inverse(normal + np.diag(prior)), prior


def _inverse(normal: Array) -> Array:
    """Return the pseudo-inverse of a positive semidefinite matrix, shape (2, 2)."""
    (a, b), (_, d) = normal.tolist()
    trace, size = a + d, a * d - b * b
    if size > 1e-12 * trace * trace:
        return np.array([[d, -b], [-b, a]]) / size
    return normal / max(trace * trace, 1e-300)  # of rank 1


def from_best_start(record: JointRecord, error: Array, slopes: Array) -> tuple[Array, Array, Array]:
    """Return the error of a roll-out (N,) and its slopes (N, f) less what the start explains, and its change (2,).

    Position and velocity at the start are found by least squares beside the parameters. What the first reads say of
    them counts against what the error leaves unexplained, so that the error of a model that lacks something does not
    move them. Slopes are those of Kaufman, "A variable projection method for solving separable nonlinear least squares
    problems", BIT 15, 1975.

    Args:
        record: The joint in the log.
        error: Of the samples that count, shape (N,), in rad.
        slopes: Derivatives by the parameters and by position and velocity at the start, shape (N, f + 2).
    """
    own, by_start = slopes[:, :-2], slopes[:, -2:]
    if not (error.size and np.isfinite(error).all() and np.isfinite(slopes).all()):
        return error, own, np.zeros(2)
    inverse, prior = _start_weights(record, error, by_start)
    step = -inverse @ (by_start.T @ error + prior * (record.start - record.says[0]))
    return error + by_start @ step, own - by_start @ (inverse @ (by_start.T @ own)), step


def started(record: JointRecord, parameters: Array, first: int | None = None, longest: float = STEP) -> JointRecord:
    """Return a record started where the roll-out follows it best.

    Args:
        record: The joint in the log.
        parameters: Shape (COUNT,).
        first: Samples that count, from the first one on; None for all.
        longest: Longest step of the integration in s, or SEARCH.
    """
    at = NONE.copy()
    at[[START_Q, START_V]] = 0, 1
    part = record
    if first is not None:
        part = replace(record.part(0, min(first, len(record.q))), start=record.start, says=record.says)
    for _ in range(_START_STEPS):
        run = rolled_out(part, parameters, at, longest)
        step = from_best_start(part, (run.q - part.q)[part.used], run.slopes[part.used])[2]
        part = replace(part, start=part.start + step)
    return replace(record, start=part.start)


def encoder_step(records: Sequence[JointRecord]) -> float:
    """Return the median distance of neighbouring readings, in rad; of a joint that rests it is the encoder's step."""
    levels = np.unique(np.round(np.concatenate([record.q[record.used] for record in records]), 9))
    return float(np.median(np.diff(levels))) if len(levels) > 1 else 0.0


def mean_errors(records: Sequence[JointRecord], parameters: Array, longest: float = SEARCH) -> Array:
    """Return the mean absolute position error of each roll-out, shape (logs,), in rad."""
    return np.array([mean_error(record, rolled_out(record, parameters, longest=longest).q) for record in records])


def mean_error(record: JointRecord, q: Array) -> float:
    """Return the mean absolute error of rolled-out positions (N,), in rad; infinite where they are no numbers."""
    error = np.abs(q - record.q)[record.used]
    return float(np.mean(error)) if np.isfinite(error).all() else np.inf
