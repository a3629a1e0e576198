"""Repairs that change no measurement: rows sorted, repeated or empty rows left out, encoder jumps taken back."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dynident.arrays import Array, BoolArray
from dynident.case.evidence.rows import same_as_before
from dynident.data.log import Log
from dynident.data.turns import jumps_of_a_turn
from dynident.diagnosis.recording import Recording
from dynident.model.robot import Robot

#: Rows with a value that is not finite are left out up to this share; above it a recording is not repaired.
MOST_LOST = 0.05

#: A sorted log whose rows were only out of order has no step shorter than this share of the median one.
SHORTEST_STEP = 0.2


@dataclass(frozen=True)
class Repaired:
    """A recording after the safe repairs.

    Attributes:
        recording: What is left.
        repairs: What was done, in words with counts.
    """

    recording: Recording
    repairs: tuple[str, ...]


def repair(recording: Recording, robot: Robot) -> Repaired:
    """Return the recording with all that is safe to repair repaired."""
    repairs = []
    bad = broken_rows(recording.log)
    if 0 < bad.sum() <= MOST_LOST * len(bad):
        recording = recording.kept(~bad, "rows with values that are not finite left out")
        repairs.append(f"{bad.sum()} rows with values that are not finite left out")
    repeated = repeated_rows(recording.log)
    if repeated.any():
        recording = recording.kept(~repeated, "repeated rows left out")
        repairs.append(f"{repeated.sum()} repeated rows left out")
    moved = out_of_order(recording.log.time)
    if moved and sortable(recording.log.time):
        recording = recording.kept(np.argsort(recording.log.time, kind="stable"), "rows sorted by time")
        repairs.append(f"rows sorted by time, {moved} of them were out of order")
        again = repeated_rows(recording.log)
        if again.any():
            recording = recording.kept(~again, "repeated rows left out")
            repairs.append(f"{again.sum()} repeated rows left out")
    counts = wraps(recording.log, robot)
    if any(counts.values()):
        recording = replace(recording, log=_unwrapped(recording.log, list(counts)))
        told = ", ".join(f"{joint} {count}" for joint, count in counts.items() if count)
        repairs.append(f"jumps of a whole turn taken back: {told}")
    return Repaired(recording, tuple(repairs))


def broken_rows(log: Log) -> BoolArray:
    """Return which rows hold a value that is not finite, shape (N,)."""
    bad = ~np.isfinite(log.time)
    for values in log.signals().values():
        bad |= ~np.isfinite(values).all(axis=1)
    return bad


def repeated_rows(log: Log) -> BoolArray:
    """Return which rows have time and values of the row before, shape (N,)."""
    return same_as_before([log.time, *log.signals().values()])


def out_of_order(time: Array) -> int:
    """Return how many rows are earlier than one before them."""
    return int(np.count_nonzero(time < np.maximum.accumulate(time)))


def sortable(time: Array) -> bool:
    """Return whether rows are merely out of order: sorted, they are one recording and not two laid together."""
    if not np.isfinite(time).all():
        return False
    steps = np.diff(np.sort(time))
    steps = steps[steps > 0]
    if not len(steps) or out_of_order(time) > MOST_LOST * len(time):
        return False
    return bool(steps.min() >= SHORTEST_STEP * np.median(steps))


def wraps(log: Log, robot: Robot) -> dict[str, int]:
    """Return how often the position of each revolute joint jumps by a whole turn between two samples."""
    counts = zip(robot.active, jumps_of_a_turn(log.q).tolist(), strict=True)
    return {joint.name: count for joint, count in counts if count and joint.kind == "revolute"}


def _unwrapped(log: Log, joints: list[str]) -> Log:
    """Return the log with the turns of some joints counted on, nearest to where most of the samples were."""
    q = np.array(log.q)
    for name in joints:
        k = log.joints.index(name)
        plain = np.unwrap(q[:, k])
        turns = np.round(np.median((q[:, k] - plain) / (2 * np.pi)))
        q[:, k] = plain + 2 * np.pi * turns
    return replace(log.with_step("encoder jumps taken back"), q=q)
