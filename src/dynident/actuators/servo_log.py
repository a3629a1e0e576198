"""Logs of commanded and measured positions: read, checked, and what spoils them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from dynident.actuators.drive_law import COUNTS, DriveLaw
from dynident.actuators.lerobot_calibration import MotorRange
from dynident.arrays import Array, BoolArray
from dynident.data.formats import ColumnMap
from dynident.errors import BadOption, LogMismatch
from dynident.model.body_constraints import Constraints
from dynident.simulation.effects import Payload

#: Share of samples whose reads may fail before a log is refused.
_MOST_FAILED = 0.5

#: A position is a failed read where it leaves the line through its neighbours by this many median steps and comes back.
_SPIKE = 12.0

#: Counts of the encoder beyond which one is.
_COUNTS = 3.0

#: Longest run of reads that fail.
_LONGEST_RUN = 3

#: Positions beyond this many rad are counts, or degrees.
LARGEST_ANGLE = 40.0

#: Positions that span more than this many times what their joint travels are in another unit.
_TRAVELS = 1.5

#: A command counts as copied where this share of it, in motion, is the measurement of another sample, at most this many
#: samples away.
_COPIED, _MOST_LAG = 0.9, 5

#: Positions of a joint in one pose span less than this many rad.
_POSE = 1e-3

#: Time that runs back by more than this many s is the start of another recording.
_BACK_S = 1.0

#: Fewest samples of a log.
_FEWEST = 20

#: A command that spans this many rad moves its joint.
MOVED = 0.05


@dataclass(frozen=True)
class ServoColumns:
    """Which columns of a log are what.

    Attributes:
        joints: Names of the n joints.
        columns: Names of time, positions and commands, with their units.
        enabled: Columns that are 1 where the drive is on: one for all joints, or one per joint; empty for always on.
        supply: Column of the supply voltage; empty for none.
        nominal_volts: Voltage at which the torque at full duty is stated; 0: the voltage is not used.
        added: Columns of feed-forward torque or duty, one per joint; empty for none.
        kp: Position gain of each log: a number for all, a column, a pattern with ``{}`` in the log's name, or numbers
            by name; None where it is not known.
        counts: Name of a coding of COUNTS where positions and commands are counts; empty where they have a unit.
        ranges: Range of the motor of each logged joint whose positions and commands are shares of it, None for one in
            the unit of the columns; empty where all are.
        payloads: Payload by a word in the name of a log; logs without any of them were recorded without one.
    """

    joints: tuple[str, ...]
    columns: ColumnMap = field(default_factory=ColumnMap)
    enabled: tuple[str, ...] = ()
    supply: str = ""
    nominal_volts: float = 0.0
    added: tuple[str, ...] = ()
    kp: float | str | Mapping[str, float] | None = None
    counts: str = ""
    ranges: tuple[MotorRange | None, ...] = ()
    payloads: Mapping[str, Payload] = field(default_factory=dict)


#: Stands for a friction model that held-out roll-outs choose.
AUTO = "auto"


@dataclass(frozen=True)
class ServoSetup:
    """What a case says of its servos.

    Attributes:
        laws: Drive law of each joint, in the order of the robot.
        columns: Which columns of the logs are what.
        friction: Name of a friction model, or ``auto``.
        bodies: Bodies that are found beside the drives: ``plausible`` or ``free``, as of ``bodies`` of a case; empty
            where they are those of the robot model.
        constraints: What is known about bodies that are found.
    """

    laws: tuple[DriveLaw, ...]
    columns: ServoColumns
    friction: str = AUTO
    bodies: str = ""
    constraints: Constraints = field(default_factory=Constraints)


@dataclass(frozen=True)
class ServoLog:
    """Commands and measured positions of n joints.

    Attributes:
        name: The file, with the episode where it has several.
        joints: Names of the n joints.
        time: Shape (N,), in s.
        q: Measured positions, shape (N, n), in rad or m; where a read failed the line between its neighbours.
        q_ref: Commanded positions, shape (N, n).
        dq_ref: Commanded velocities, shape (N, n); zero where there are none.
        added: Feed-forward duty or torque, shape (N, n).
        enabled: Whether the drive is on, shape (N, n).
        supply: Supply voltage over the nominal one, shape (N,).
        failed: Reads that failed, shape (N, n).
        kp: Position gain in the drive's unit; nan where it is not known.
        path: The file.
        left_out: What of the file is left out, and why, in words; with the first log of the file.
        payload: What the arm carried; None for nothing.
        dq: Measured velocities, shape (N, n), which are checked and not used; None where the log has none.
        radians: What counts as a radian of each joint, shape (n,): 1, of one that slides the range of its positions in
            all logs over pi, in m; None for 1 of each.
    """

    name: str
    joints: tuple[str, ...]
    time: Array
    q: Array
    q_ref: Array
    dq_ref: Array
    added: Array
    enabled: BoolArray
    supply: Array
    failed: BoolArray
    kp: float
    path: str = ""
    left_out: tuple[str, ...] = ()
    payload: Payload | None = None
    dq: Array | None = None
    radians: Array | None = None

    @property
    def samples(self) -> int:
        """N."""
        return len(self.time)

    def sized(self, joint: int, size: float) -> float:
        """Return an angle or a speed of a joint that turns, in rad or rad/s; of one that slides, in m or m/s."""
        return size if self.radians is None else size * float(self.radians[joint])


def checked_log(log: ServoLog) -> ServoLog:
    """Return a log without rows that cannot be placed, with its failed reads marked and bridged.

    Raises:
        LogMismatch: What ``read_servo_logs`` says.
    """
    back = np.flatnonzero(np.diff(log.time) < -_BACK_S)
    if len(back):
        evidence = (
            f"time runs back at {len(back)} places, the first after sample {back[0] + 1}: several recordings in a row"
        )
        step = "give each recording a file, or the file a column episode_index with the number of the recording"
        raise LogMismatch(log.name, evidence, step)
    good = np.isfinite(log.time) & np.isfinite(log.q_ref).all(axis=1)
    good &= log.time > np.maximum.accumulate(np.concatenate([[-np.inf], np.where(good, log.time, -np.inf)[:-1]]))
    log = rows_of(log, good)
    if log.samples < _FEWEST:
        raise LogMismatch(log.name, f"only {log.samples} samples with a time and a command", "log seconds of motion")
    failed = np.column_stack([_failed_reads(log.time, column) for column in log.q.T])
    q = log.q.copy()
    for joint in range(q.shape[1]):
        bad = failed[:, joint]
        if bad.mean() > _MOST_FAILED:
            evidence = f"{bad.sum()} of {log.samples} reads of {log.joints[joint]} failed"
            raise LogMismatch(log.name, evidence, "repair the bus (speed, cable, power) and record again")
        q[bad, joint] = np.interp(log.time[bad], log.time[~bad], q[~bad, joint])
    _check_meaning(log, q)
    return replace(log, q=q, failed=failed)


def with_slides(logs: Sequence[ServoLog], slides: Sequence[bool]) -> list[ServoLog]:
    """Return logs of n joints of which some slide: the range of such a joint in all logs counts as half a turn.

    What is at rest and what is moved, in rad and rad/s, then holds for it too.
    """
    spans = np.max([np.ptp(log.q, axis=0) for log in logs], axis=0, initial=0.0)
    radians = np.where(np.array(slides) & (spans > _POSE), spans / np.pi, 1.0)
    return [replace(log, radians=radians) for log in logs]


def rows_of(log: ServoLog, keep: BoolArray | slice) -> ServoLog:
    """Return some samples of a log."""
    signals = ("time", "q", "q_ref", "dq_ref", "added", "enabled", "supply", "failed")
    dq = None if log.dq is None else log.dq[keep]
    return replace(log, dq=dq, **{name: getattr(log, name)[keep] for name in signals})


def _failed_reads(time: Array, q: Array) -> BoolArray:
    """Return which positions are missing, or leave the line between their neighbours and come back, up to three reads.

    Far is by the usual steps of the reads that do not: many that fail would pass for these. It is more than three
    counts of the encoder, between which a joint at rest goes to and fro.
    """
    failed = ~np.isfinite(q)
    sound = np.flatnonzero(~failed)
    if len(sound) < _FEWEST:
        return failed
    t, x = time[sound], q[sound]
    steps = np.abs(np.diff(x))
    counts = _COUNTS * float(np.min(steps[steps > 0.0], initial=np.inf))
    if not np.isfinite(counts):
        return failed
    runs = [_run(t, x, width) for width in range(1, _LONGEST_RUN + 1)]
    aside = np.zeros(len(x), dtype=bool)
    for width, away in enumerate(runs, start=1):
        _mark(aside, away > max(_SPIKE * float(np.median(steps)), counts), width)
    whole = ~(aside[1:] | aside[:-1])
    usual = float(np.quantile(steps[whole], 0.99)) if whole.any() else 0.0
    found = np.zeros(len(x), dtype=bool)
    for width, away in enumerate(runs, start=1):
        _mark(found, away > max(_SPIKE * usual, counts), width)
    failed[sound[found]] = True
    return failed


def _run(time: Array, q: Array, width: int) -> Array:
    """Return how far each run of some reads (N,) is from the line between its neighbours, 0 where these differ too."""
    first, last = slice(None, -width - 1), slice(width + 1, None)
    slope = (q[last] - q[first]) / (time[last] - time[first])
    inner = [slice(k, k - width - 1 or None) for k in range(1, width + 1)]
    away = np.min([np.abs(q[own] - q[first] - slope * (time[own] - time[first])) for own in inner], axis=0)
    return np.where(np.abs(q[last] - q[first]) < 0.5 * away, away, 0.0)


def _mark(found: BoolArray, runs: BoolArray, width: int) -> None:
    """Mark the reads, (N,), of runs, (N - width - 1,), in place."""
    for first in np.flatnonzero(runs).tolist():
        found[first + 1 : first + 1 + width] = True


def _check_meaning(log: ServoLog, q: Array) -> None:
    for joint, name in enumerate(log.joints):
        measured, command = q[:, joint], log.q_ref[:, joint]
        spans = float(np.ptp(measured)), float(np.ptp(command))
        if max(spans) > LARGEST_ANGLE:
            raise _no_radians(log, name, spans)
        if max(np.ptp(measured), np.ptp(command)) < _POSE:
            if np.max(np.ptp(np.hstack([q, log.q_ref]), axis=0)) < _POSE:
                step = "log a motion of tens of degrees, or leave the joint out (locked: {joint: position})"
                raise LogMismatch(log.name, f"{name} stands in one pose throughout", step)
            continue  # it may move in other logs
        if not log.enabled[:, joint].any():
            step = "log with the torque on; where the column is 0 while the drive is on, it is inverted: turn it over"
            raise LogMismatch(log.name, f"the drive of {name} is never on by its column", step)
        on = log.enabled[:, joint]
        if np.ptp(measured) > 1e-3 and np.max(np.abs(measured - command)[on], initial=0.0) < 1e-9:
            step = "log what the controller sends (goal position), not the position that it reads back"
            raise LogMismatch(log.name, f"the command of {name} equals its measurement in every sample", step)
        lag = _copied(measured, command, on)
        if lag:
            when = f"{abs(lag)} sample{'s' * (abs(lag) > 1)} {'later' if lag > 0 else 'before'}"
            step = "log what the controller sends (goal position, the pose of the leader arm), not what it reads back"
            raise LogMismatch(log.name, f"the command of {name} is its measurement {when}", step)


def check_travel(log: ServoLog, travel: Array) -> None:
    """Refuse a log whose positions span more than their joints can travel: they are in another unit.

    Args:
        log: A log of the joints.
        travel: Upper less lower limit of each joint, shape (n,), in rad or m; infinite for none.

    Raises:
        LogMismatch: A joint moves further than its limits allow.
    """
    for joint, name in enumerate(log.joints):
        spans = float(np.ptp(log.q[:, joint])), float(np.ptp(log.q_ref[:, joint]))
        if spans[0] > _TRAVELS * travel[joint]:
            raise _no_radians(log, name, spans, f"; the joint travels {travel[joint]:.4g}")


def _no_radians(log: ServoLog, name: str, spans: tuple[float, float], more: str = "") -> LogMismatch:
    """Return the error that positions of a joint are in another unit, with what to state."""
    evidence = (
        f"positions of {name} span {spans[0]:.4g} rad, its commands {spans[1]:.4g} rad{more}: they are counts, "
        "degrees, or shares of a range"
    )
    step = (
        f"state the unit (log: {{units: {{position: deg}}}}), what counts they are (servo: {{counts: "
        f"{' or '.join(COUNTS)}}}), or the calibration of LeRobot (servo: {{calibration: FILE}})"
    )
    return LogMismatch(log.name, evidence, step)


def is_read_back(log: ServoLog, joint: int) -> bool:
    """Return whether the command of a joint that moves is its position and noise: a drive needs an error that lasts.

    By the ratio of the mean squared successive difference of command less position to its variance, 2 for noise (von
    Neumann, "Distribution of the ratio of the mean square successive difference to the variance", Annals of
    Mathematical Statistics 12, 1941): the error of a servo goes with its torque, so that the ratio is far below 1.
    """
    used = log.enabled[:, joint] & ~log.failed[:, joint]
    if used.sum() < _FEWEST or np.ptp(log.q_ref[used, joint]) < log.sized(joint, MOVED):
        return False
    error = (log.q_ref - log.q)[used, joint]
    return bool(np.mean(np.diff(error) ** 2) > np.var(error))


def _copied(measured: Array, command: Array, on: BoolArray) -> int:
    """Return the samples by which a command that copies the measurement is ahead of it, or behind it; 0 for none."""
    count = len(measured)
    for lag in (value * sign for value in range(1, _MOST_LAG + 1) for sign in (1, -1)):
        now, then = np.arange(max(0, -lag), count - max(0, lag)), np.arange(max(0, lag), count + min(0, lag))
        moves = on[now] & (np.abs(np.gradient(measured)[then]) > 0)
        if moves.sum() > _FEWEST and np.mean(np.abs(command[now] - measured[then])[moves] < 1e-9) > _COPIED:
            return lag
    return 0


def kp_values(logs: Sequence[ServoLog]) -> tuple[float, ...]:
    """Return the position gains of logs, sorted, without repeats."""
    return tuple(sorted({log.kp for log in logs if np.isfinite(log.kp)}))


def is_outside(kp: float, gains: Sequence[float]) -> bool:
    """Return whether a position gain is outside the range of others; never where there are none."""
    return bool(gains) and not min(gains) <= kp <= max(gains)


def laws_of(setup: ServoSetup, logs: Sequence[ServoLog]) -> tuple[DriveLaw, ...]:
    """Return the drive laws of a case, without gain where no log states one.

    A gain that is not known is small enough that no sample is at the limit of the duty: the search for saturation goes
    on from there.
    """
    is_known = any(np.isfinite(log.kp) for log in logs)
    laws = setup.laws if is_known else tuple(law.without_gain for law in setup.laws)
    return tuple(_below_limit(law, joint, logs) if law.gain_is_free else law for joint, law in enumerate(laws))


def _below_limit(law: DriveLaw, joint: int, logs: Sequence[ServoLog]) -> DriveLaw:
    """Return a law whose gain is not known with one by which no sample of a joint is beyond the limit of the duty."""
    largest = 0.0
    for log in logs:
        used = log.enabled[:, joint] & ~log.failed[:, joint]
        error = float(np.max(np.abs(log.q_ref - log.q)[used, joint], initial=0.0))
        largest = max(largest, error * (log.kp if np.isfinite(log.kp) else 1.0))
    return replace(law, error_gain=law.limit / largest) if law.error_gain * largest > law.limit else law


def check_gains(logs: Sequence[ServoLog], kp: float | None) -> list[ServoLog]:
    """Return logs in which each has a gain; ``kp`` where the log states none.

    Raises:
        BadOption: Some logs state gains and others do not.
    """
    stated = [np.isfinite(log.kp) for log in logs]
    if all(stated):
        return list(logs)
    if any(stated):
        raise BadOption("servo.kp", None, f"{logs[stated.index(False)].name} states no kp, other logs do; state all")
    return [ServoLog(**{**vars(log), "kp": 1.0 if kp is None else kp}) for log in logs]
