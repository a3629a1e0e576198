"""A log through a tracker: parameters over time, and the moments at which something changed at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from dynident.applications.tracking.tracker import Change, ChangeEvidence, Pace, Tracker, changes_of, threshold
from dynident.arrays import Array, finite
from dynident.data.log import Log
from dynident.data.preprocessing import Prepared, preprocess
from dynident.errors import BadOption, LogMismatch
from dynident.identification.estimate.estimate import Estimate
from dynident.identification.estimate.validation import Z_95
from dynident.identification.problem.problem import counting_rows
from dynident.identification.problem.regressor_stream import RegressorStream, rows_in_time

#: Looks at the window per length of the window.
LOOKS = 5

#: Place of the mass among the ten parameters of a load.
_MASS = 9


@dataclass(frozen=True)
class Thresholds:
    """Squares above which a change is taken for real.

    Attributes:
        squares: Of each change, shape (h,).
        false_alarms: That all together raise at most, in one over an hour.
        seconds: Length of the clean runs.
    """

    squares: Array
    false_alarms: float
    seconds: float


@dataclass(frozen=True)
class Event:
    """Something that changed at once.

    Attributes:
        time: When the first threshold was passed, in s of the log.
        change: What it was, named when the window had only rows since.
        evidence: For it, then.
        threshold: Of its square.
    """

    time: float
    change: Change
    evidence: ChangeEvidence
    threshold: float

    @property
    def mass(self) -> tuple[float, float] | None:
        """Mass and its deviation, in kg, of a load; None where the rows do not show it."""
        if self.change.kind != "load" or not np.isfinite(self.evidence.deviations[_MASS]):
            return None
        return float(self.evidence.x[_MASS]), float(self.evidence.deviations[_MASS])

    def figures(self) -> dict[str, Any]:
        """Return the event as plain data."""
        found = {
            "time": self.time,
            "kind": self.change.kind,
            "owner": self.change.owner,
            "chi_square": self.evidence.square,
            "rank": self.evidence.rank,
            "threshold": self.threshold,
        }
        mass = self.mass
        return found | {"mass": None if mass is None else mass[0], "mass_std": None if mass is None else mass[1]}


@dataclass(frozen=True)
class Tracked:
    """A log as a tracker followed it.

    Attributes:
        log: Its name.
        time: Of the looks, in s, shape (m,).
        beta: Base parameters then, shape (m, b).
        deviations: Their standard deviations, shape (m, b).
        squares: Of each change then, shape (m, h).
        events: In order of time.
    """

    log: str
    time: Array
    beta: Array
    deviations: Array
    squares: Array
    events: tuple[Event, ...]

    def figures(self, estimate: Estimate) -> dict[str, Any]:
        """Return events, and each parameter at the end beside the estimate, as plain data."""
        last, spread = self.beta[-1], self.deviations[-1]
        moved = (last - estimate.beta) / np.hypot(spread, estimate.std)
        return {
            "log": self.log,
            "seconds": float(self.time[-1] - self.time[0]),
            "evaluations": len(self.time),
            "events": [event.figures() for event in self.events],
            "parameters": [
                {
                    "name": name,
                    "unit": unit,
                    "estimate": float(before),
                    "value": float(value),
                    "std": float(std),
                    "t": finite(float(by)),
                }
                for name, unit, before, value, std, by in zip(
                    estimate.base.names, estimate.base.units, estimate.beta, last, spread, moved, strict=True
                )
            ],
        }

    def no_friction(self, estimate: Estimate) -> list[str]:
        """Return the friction parameters that at the end are significantly below zero, which no friction is."""
        base, limit = estimate.base, self.beta[-1] + self.half_widths()[-1]
        friction = [base.parameters[k].kind == "friction" and base.parameters[k].nonnegative for k in base.independent]
        return [base.names[k] for k in np.flatnonzero(friction & (limit < 0)) if estimate.beta[k] >= 0]

    def half_widths(self) -> Array:
        """Return half of the 95 % interval of each parameter at each look, shape (m, b)."""
        return Z_95 * np.asarray(self.deviations)


def tracked(estimate: Estimate, log: Log, pace: Pace, thresholds: Thresholds | None = None) -> Tracked:
    """Return a log as a tracker follows it; without thresholds it looks for no events.

    Args:
        estimate: What is known beforehand.
        log: Raw, with positions and torques.
        pace: How it forgets.
        thresholds: Squares above which a change is real.

    Raises:
        BadOption: The covariance of the estimate is singular.
        LogMismatch: The log does not fit the robot, has no torques, or is shorter than the memory's window.
    """
    prepared = preprocess(log.ordered(estimate.model.robot.joint_names), estimate.preprocessing)
    rate = prepared.log.rate / prepared.every
    time = prepared.log.time[prepared.keep]
    tracker = Tracker(estimate, rate, pace, looked_for(estimate))
    every = max(1, round(pace.window * rate / LOOKS))
    if len(time) < 2 * max(2, round(pace.window * rate)):
        evidence = f"{len(time)} rows of {1 / rate:.3g} s, fewer than two windows of {pace.window:g} s hold"
        raise LogMismatch(log.name, evidence, "give a longer log or a shorter window")
    looks: list[tuple[float, Array, Array, list[float]]] = []
    events: list[Event] = []
    since: float | None = None
    for inside, matrix, torque in _rows(estimate, prepared, every):
        for one, right in zip(matrix, torque, strict=True):
            tracker.update(one, right)
        now = float(time[inside.stop - 1])
        if not tracker.full:
            continue
        evidence = tracker.evidence()
        squares = np.array([found.square for found in evidence])
        if thresholds is not None:
            if since is None and np.any(squares > thresholds.squares):
                since = now
                tracker.hold()
            if since is not None and now - since >= pace.window:
                most = int(np.argmax(squares - thresholds.squares))
                events.append(Event(since, tracker.changes[most], evidence[most], float(thresholds.squares[most])))
                tracker.restart(tracker.changes[most])
                since = None
        beta, covariance = tracker.now()
        looks.append((now, beta, np.sqrt(np.diag(covariance)), squares.tolist()))
    when, values, spreads, found = zip(*looks, strict=True)
    return Tracked(log.name, np.array(when), np.array(values), np.array(spreads), np.array(found), tuple(events))


def looked_for(estimate: Estimate) -> tuple[Change, ...]:
    """Return the changes that a tracker of an estimate looks for."""
    torque = np.sqrt(np.mean(np.asarray(estimate.train.measured) ** 2, axis=0))
    return changes_of(estimate.model, estimate.base, torque)


def _rows(estimate: Estimate, prepared: Prepared, size: int) -> Any:
    regressor = RegressorStream(estimate.model, estimate.base, estimate.beta)
    return rows_in_time(regressor, prepared, counting_rows(estimate.model, prepared), size)


def thresholds_of(estimate: Estimate, clean: Sequence[Log], pace: Pace, false_alarms: float) -> Thresholds:
    """Return thresholds by which clean runs raise at most so many false alarms an hour.

    Each change gets its share of the rate, and each look counts as an independent one though windows overlap, which
    errs on the safe side. The squares of the clean runs say by how much those of an exact model are exceeded.

    Args:
        estimate: The estimate.
        clean: Runs in which nothing changes.
        pace: As of the tracker.
        false_alarms: In one over an hour, above 0.

    Raises:
        BadOption: A rate that is not above 0 or too high for the looks, or no run.
        LogMismatch: A log does not fit.
    """
    looks = LOOKS * 3600.0 / pace.window
    if not 0 < false_alarms < looks:
        raise BadOption("false alarms", false_alarms, f"give a number an hour, above 0 and below {looks:.4g}")
    if not clean:
        raise BadOption("clean runs", "none", "give at least one log in which nothing changes")
    found = [tracked(estimate, log, pace) for log in clean]
    squares = np.concatenate([one.squares for one in found])
    seconds = float(sum(one.time[-1] - one.time[0] for one in found))
    changes = looked_for(estimate)
    chance = false_alarms / looks / len(changes)
    ranks = [change.columns.shape[1] for change in changes]
    return Thresholds(
        np.array(
            [threshold(own, rank, seconds / pace.window, chance) for own, rank in zip(squares.T, ranks, strict=True)]
        ),
        false_alarms,
        seconds,
    )
