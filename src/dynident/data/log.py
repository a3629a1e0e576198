"""Log: what was recorded, in SI units, with its provenance; select, split, join."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from dynident.arrays import Array, BoolArray, IntArray, frozen
from dynident.errors import BadOption, LogMismatch
from dynident.methods import ShortText

_SIGNALS = ("q", "dq", "ddq", "torque", "current", "raw_torque", "temperature", "q_ref", "dq_ref")


@dataclass(frozen=True)
class Source:
    """Where a log comes from.

    Attributes:
        path: File as it was given; empty for a simulated log.
        sha256: Hash of the file's bytes; empty for a simulated log.
        rows: Rows of the file.
        steps: What was done to the rows since, in order, in words.
        split: How ``--split`` takes this training part, and the test part beside it, from the file; empty for all.
        gap_samples: Samples that were left out near gaps in time and where brakes are closed.
        braked: Start and end in s of the spells with closed brakes.
    """

    path: str = ""
    sha256: str = ""
    rows: int = 0
    steps: tuple[str, ...] = ()
    split: str = ""
    gap_samples: int = 0
    braked: tuple[tuple[float, float], ...] = ()


@dataclass(frozen=True, repr=False)
class Log(ShortText):
    """Samples of a motion. Every signal but time and position may be missing (None).

    Attributes:
        joints: Names of the n joints, in the order of the columns.
        time: Shape (N,), in s.
        q: Positions, shape (N, n), in rad or m.
        dq: Velocities, shape (N, n), in rad/s or m/s.
        ddq: Accelerations, shape (N, n), in rad/s^2 or m/s^2.
        torque: Joint torques, shape (N, n), in N m or N.
        current: Motor currents, shape (N, n), in A.
        raw_torque: Torques before any filter, at the same rows, shape (N, n), in N m or N.
        temperature: Drive temperatures, shape (N, n), in degrees Celsius.
        q_ref: Positions that the controller was told to reach, shape (N, n), in rad or m.
        dq_ref: Commanded velocities, shape (N, n), in rad/s or m/s.
        source: Where it comes from.
        gaps: Start and end in s of the gaps in time that were bridged when it was made uniform, shape (g, 2).
        before: The motion of the recording up to the first sample, or the states of friction at it, shape (n, s); None
            where the recording begins with it.
    """

    joints: tuple[str, ...]
    time: Array
    q: Array
    dq: Array | None = None
    ddq: Array | None = None
    torque: Array | None = None
    current: Array | None = None
    raw_torque: Array | None = None
    temperature: Array | None = None
    q_ref: Array | None = None
    dq_ref: Array | None = None
    source: Source = field(default_factory=Source)
    gaps: Array | None = None
    before: Log | Array | None = None

    def __post_init__(self) -> None:
        if len(set(self.joints)) != len(self.joints):
            raise ValueError(f"two joints of the log share a name: {list(self.joints)}")
        object.__setattr__(self, "time", frozen(self.time, (None,), "time"))
        if self.gaps is not None:
            object.__setattr__(self, "gaps", frozen(self.gaps, (None, 2), "gaps"))
        shape = (len(self.time), len(self.joints))
        for name in _SIGNALS:
            values = getattr(self, name)
            if values is not None:
                object.__setattr__(self, name, frozen(values, shape, name))

    @property
    def samples(self) -> int:
        """N."""
        return len(self.time)

    @property
    def name(self) -> str:
        """Name for messages: the path, or 'simulated log'."""
        return self.source.path or "simulated log"

    @property
    def duration(self) -> float:
        """Time from the first to the last sample, in s."""
        return float(self.time[-1] - self.time[0]) if self.samples > 1 else 0.0

    @cached_property
    def rate(self) -> float:
        """Samples per second by the median step, in Hz; of the steps above 0 where most stamps repeat."""
        steps = np.diff(self.time)
        return 1.0 / float(np.median(steps) or np.median(steps[steps > 0]))

    @cached_property
    def resolution(self) -> Array:
        """Smallest step of each position, shape (n,), in rad or m; 0 where none shows."""
        return np.array([smallest_step(column) for column in self.q.T])

    def signals(self) -> dict[str, Array]:
        """Return the signals that are there, by field name."""
        return {name: getattr(self, name) for name in _SIGNALS if getattr(self, name) is not None}

    def with_step(self, step: str) -> Log:
        """Return the log with a step noted in its provenance."""
        return replace(self, source=replace(self.source, steps=(*self.source.steps, step)))

    def rows(self, keep: slice | BoolArray | IntArray, step: str) -> Log:
        """Return some rows only; ``step`` says which in words."""
        chosen = {name: values[keep] for name, values in self.signals().items()}
        return replace(self.with_step(step), time=self.time[keep], **chosen)

    def part(self, start: int, stop: int, step: str) -> Log:
        """Return samples that follow each other, with the motion before them; ``step`` says which in words."""
        if start < 10:  # too few for a filter
            return self.rows(slice(start, stop), step)
        motion = Log(
            self.joints, self.time, self.q, self.dq, self.ddq, temperature=self.temperature, before=self.before
        )
        return replace(self.rows(slice(start, stop), step), before=motion.rows(slice(start + 1), "before"))

    def on_one_clock(self, ratio: float) -> Log:
        """Return the log with torques and currents of a clock ``ratio`` times as fast at the times of the positions.

        Both clocks showed the same at the first sample; in between, values are on straight lines. Rows at the end whose
        torque was logged after the last row are left out.
        """
        if ratio == 1.0:
            return self
        time = self.time[0] + ratio * (self.time - self.time[0])
        moved = {
            name: np.column_stack([np.interp(time, self.time, column) for column in values.T])
            for name, values in self.signals().items()
            if name in ("torque", "current", "raw_torque")
        }
        step = f"torques of a clock {ratio:.6g} times as fast put beside positions"
        return replace(self, **moved).rows(time <= self.time[-1], step)

    def ordered(self, joints: Sequence[str]) -> Log:
        """Return the columns in the order of ``joints``, matched by name.

        Raises:
            LogMismatch: A joint is not in the log.
        """
        if tuple(joints) == self.joints:
            return self
        missing = [name for name in joints if name not in self.joints]
        if missing:
            step = f"the log has {', '.join(self.joints)}; name the joints in the order of the columns (joints: [...])"
            raise LogMismatch(self.name, f"no joint called '{missing[0]}'", step)
        order = [self.joints.index(name) for name in joints]
        chosen: dict[str, Any] = {name: values[:, order] for name, values in self.signals().items()}
        if isinstance(self.before, Log):
            chosen["before"] = self.before.ordered(joints)
        return replace(self, joints=tuple(joints), **chosen)

    def split(self, first: float) -> tuple[Log, Log]:
        """Return the first share of the duration and the rest.

        Raises:
            BadOption: The share is not between 0 and 1.
        """
        if not 0 < first < 1:
            raise BadOption("split", first, "give the share of the first part, such as first:0.67")
        cut = int(np.count_nonzero(self.time < self.time[0] + first * self.duration))
        train = self.part(0, cut, f"first {first:g} of the duration")
        return (
            replace(train, source=replace(train.source, split=f"first:{first:g}")),
            self.part(cut, self.samples, f"all after the first {first:g} of the duration"),
        )


def smallest_step(column: Array) -> float:
    """Return the smallest difference of two values that a signal (N,) takes, its levels; 0 where it has none.

    Levels are values that occur many times over, or lie on equal steps of which many are taken; rounded text has few.
    """
    gaps = np.diff(levels := np.unique(column))
    step = float(np.quantile(gaps, 0.1, method="lower")) if len(gaps) else 0.0
    if not step or len(levels) <= len(column) / 4:
        return step
    counts = np.round(gaps / step)
    gaps, counts = gaps[counts <= 3], counts[counts <= 3]
    step = float(gaps.sum() / counts.sum())
    return step if np.quantile(np.abs(gaps / step - counts), 0.99) < 0.1 <= np.mean(counts == 1) else 0.0


def measured_torque(log: Log) -> Array:
    """Return the torques of a log, shape (N, n).

    Raises:
        LogMismatch: It has none.
    """
    if log.torque is None:
        raise LogMismatch(log.name, "no torques", "map torque columns, or currents with drive gains, in the case file")
    return log.torque


def torque_from_current(log: Log, gains: Mapping[str, float], coupling: Array | None = None) -> Log:
    """Return the log with torques K I, equation (16), from its currents and the gain of each joint in N m/A.

    Args:
        log: With currents.
        gains: Drive gain by joint.
        coupling: C with motor speed = C dq, shape (n, n), in the log's order of joints; the torques at the joints are
            then C' K I. None where each motor moves one joint.

    Raises:
        LogMismatch: The log has no currents, or a joint no gain.
    """
    if log.current is None:
        raise LogMismatch(log.name, "no motor currents", "map them with 'current' in the case file")
    missing = [name for name in log.joints if name not in gains]
    if missing:
        step = "state 'gain' (N m at the joint per A, or per percent of the current) under drives in the case file"
        raise LogMismatch(log.name, f"currents but no drive gain for {', '.join(missing)}", step)
    torque = log.current * np.array([gains[name] for name in log.joints])
    if coupling is None:
        return replace(log.with_step("torque = gain x current"), torque=torque)
    return replace(log.with_step("torque = coupling' x gain x current"), torque=torque @ np.asarray(coupling))
