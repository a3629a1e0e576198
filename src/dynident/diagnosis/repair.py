"""Repairs that change no measurement: rows sorted, repeated, empty or late ones left out, encoder jumps taken back."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from dynident.arrays import Array, BoolArray
from dynident.case.evidence.rows import MOST_LOST, out_of_order, same_as_before, sortable
from dynident.data.log import Log
from dynident.data.turns import jumps_of_a_turn
from dynident.diagnosis.recording import Recording
from dynident.model.robot import Robot


@dataclass(frozen=True)
class Repaired:
    """A recording after the safe repairs.

    Attributes:
        recording: What is left.
        repairs: What was done, in words with counts.
        turns: Whole turns that were added to the positions of its samples, by joint, each of shape (N,).
    """

    recording: Recording
    repairs: tuple[str, ...]
    turns: Mapping[str, Array] = field(default_factory=dict)


def repair(recording: Recording, robot: Robot) -> Repaired:
    """Return the recording with all that is safe to repair repaired."""
    repairs: list[str] = []
    turns: dict[str, Array] = {}
    bad = broken_rows(recording.log)
    if 0 < bad.sum() <= MOST_LOST * len(bad):
        recording = recording.kept(~bad, "rows with values that are not finite left out")
        repairs.append(f"{_rows(bad.sum())} with values that are not finite left out")
    repeated = repeated_rows(recording.log)
    if repeated.any():
        recording = recording.kept(~repeated, "repeated rows left out")
        repairs.append(f"{_rows(repeated.sum(), 'repeated ')} left out")
    log = recording.log
    moved = np.count_nonzero(out_of_order(log.time)) if np.isfinite(log.time).all() else 0
    if moved and sortable(log.time, list(log.signals().values())):
        recording = recording.kept(np.argsort(log.time, kind="stable"), "rows sorted by time")
        repairs.append(f"rows sorted by time, {moved} of them out of order")
        again = repeated_rows(recording.log)
        if again.any():
            recording = recording.kept(~again, "repeated rows left out")
            repairs.append(f"{_rows(again.sum(), 'repeated ')} left out")
    late = equal_times(recording.log)
    if 0 < late.sum() <= MOST_LOST * len(late):
        recording = recording.kept(~late, "rows with the time of the row before left out")
        repairs.append(f"{_rows(late.sum())} with the time of the row before left out")
    counts = wraps(recording.log, robot)
    if any(counts.values()):
        turns = {joint: _turns_taken_back(recording.log, joint) for joint in counts}
        recording = replace(recording, log=_turned(recording.log, turns))
        told = ", ".join(f"{joint} {count}" for joint, count in counts.items() if count)
        repairs.append(f"jumps of a whole turn taken back: {told}")
    return Repaired(recording, tuple(repairs), turns)


def _rows(count: int, what: str = "") -> str:
    return f"{count} {what}row{'s' if count != 1 else ''}"


def broken_rows(log: Log) -> BoolArray:
    """Return which rows hold a value that is not finite, shape (N,)."""
    bad = ~np.isfinite(log.time)
    for values in log.signals().values():
        bad |= ~np.isfinite(values).all(axis=1)
    return bad


def equal_times(log: Log) -> BoolArray:
    """Return which rows have the time of the row before, shape (N,): of two values at one time one is not of it."""
    return np.diff(log.time, prepend=-np.inf) == 0


def repeated_rows(log: Log) -> BoolArray:
    """Return which rows have time and values of the row before, shape (N,)."""
    return same_as_before([log.time, *log.signals().values()])


def wraps(log: Log, robot: Robot) -> dict[str, int]:
    """Return how often the position of each revolute joint jumps by a whole turn between two samples."""
    counts = zip(robot.active, jumps_of_a_turn(log.q).tolist(), strict=True)
    return {joint.name: count for joint, count in counts if count and joint.kind == "revolute"}


def _turns_taken_back(log: Log, joint: str) -> Array:
    """Return the turns (N,) that take back the jumps of a joint, nearest to where most of the samples were."""
    q = log.q[:, log.joints.index(joint)]
    added = np.round((np.unwrap(q) - q) / (2 * np.pi))
    return added - np.round(np.median(added))


def _turned(log: Log, turns: Mapping[str, Array]) -> Log:
    """Return the log with turns added to the positions of some joints."""
    q = np.array(log.q)
    for joint, added in turns.items():
        q[:, log.joints.index(joint)] += 2 * np.pi * added
    return replace(log.with_step("encoder jumps taken back"), q=q)
