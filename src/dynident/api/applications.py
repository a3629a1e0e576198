"""payload, monitor and track: what uses an estimate, on logs in memory or named, which are read as those of the fit."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from dynident.api.estimate_output import file_of_fit
from dynident.api.given_robots import RobotLike, robot_of
from dynident.api.validate import read_log
from dynident.applications import symbolic
from dynident.applications.monitor import MomentumObserver, Monitor, Monitored, calibrated, run_monitor
from dynident.applications.monitor.signals import signals_of
from dynident.applications.payload import BeforeRun, CarriedLoad, identify_payload
from dynident.applications.tracking import Pace, Tracked, thresholds_of, tracked
from dynident.case.case import Case
from dynident.data.log import Log
from dynident.errors import LogMismatch
from dynident.identification.estimate.estimate import Estimate
from dynident.model.dynamic_model import DynamicModel

Named = Log | str | Path


@dataclass(frozen=True)
class MonitorRun:
    """Logs that a monitor looked at.

    Attributes:
        monitor: With the thresholds of the clean runs.
        logs: What it saw in each log.
    """

    monitor: Monitor
    logs: tuple[Monitored, ...]


@dataclass(frozen=True)
class TrackRun:
    """A log that was followed.

    Attributes:
        found: Parameters along the log, and what changed at once.
        clean_seconds: Length of the runs that the thresholds come from, in s.
    """

    found: Tracked
    clean_seconds: float


def payload(
    estimate: Estimate,
    logs: Sequence[Named],
    *,
    flange: str = "",
    known: BeforeRun | None = None,
    rows: str = "auto",
    level: float = 0.95,
    case: Case | None = None,
    progress: Callable[[str], None] = lambda step: None,
) -> CarriedLoad:
    """Return mass, centre of mass and inertia of what the robot carried in some logs.

    Args:
        estimate: Of the robot without it; its covariance is part of the payload's.
        logs: With the payload.
        flange: Link or frame that the payload is stated in; empty for the tool, or the last link, or of several ends of
            a robot that at which a payload explains the torques best.
        known: What is known before the run; None for nothing.
        rows: ``motion``; ``poses`` takes one sample from each posture at which the arm stands; ``auto`` decides.
        level: Confidence of the intervals.
        case: How files are read, where their columns or units are others than those of the logs of the fit.
        progress: Called with each step in words.

    Raises:
        DynidentError: As ``identify_payload``, or a log cannot be read.
    """
    known = known or BeforeRun()
    return identify_payload(
        estimate, _read(estimate, logs, case), flange=flange, known=known, rows=rows, level=level, progress=progress
    )


def monitor(
    estimate: Estimate,
    logs: Sequence[Named],
    *,
    clean: Sequence[Named] | None = None,
    rates: npt.ArrayLike = 1.0,
    gain: float = 50.0,
    case: Case | None = None,
    progress: Callable[[str], None] = lambda step: None,
) -> MonitorRun:
    """Look for torques from outside in some logs by a momentum observer.

    Args:
        estimate: The robot.
        logs: To look at.
        clean: Runs without contact, for the thresholds; None for the logs of the fit.
        rates: False alarms an hour, one number or one per joint.
        gain: How fast the observer follows, in 1/s.
        case: As of :func:`payload`; also of ``clean``, where given.
        progress: Called with each step in words.

    Raises:
        BadOption: A rate or gain that is not above 0.
        LogMismatch: A log does not fit the robot, or the logs of the fit are not there as they were.
        DynidentError: A log cannot be read.
    """
    runs = [signals_of(estimate, log) for log in _clean(estimate, clean, case)]
    seen = _read(estimate, logs, case)
    progress("thresholds of the clean runs")
    thresholds = calibrated(MomentumObserver(estimate, gain), runs, np.asarray(rates, dtype=float) / 3600.0)
    progress("looking")
    return MonitorRun(thresholds, tuple(run_monitor(thresholds, log) for log in seen))


def track(
    estimate: Estimate,
    log: Named,
    *,
    clean: Sequence[Named] | None = None,
    rate: float = 1.0,
    pace: Pace | None = None,
    case: Case | None = None,
    progress: Callable[[str], None] = lambda step: None,
) -> TrackRun:
    """Follow the parameters along a log, and look for loads and friction that change at once.

    Args:
        estimate: What is known beforehand.
        log: To follow.
        clean: Runs in which nothing changes, for the thresholds; None for the logs of the fit.
        rate: False alarms an hour at most.
        pace: How the tracker forgets; None for the default.
        case: As of :func:`monitor`.
        progress: Called with each step in words.

    Raises:
        BadOption: A rate that is not above 0, or the covariance of the estimate is singular.
        LogMismatch: A log does not fit the robot, or the logs of the fit are not there as they were.
        DynidentError: A log cannot be read.
    """
    pace = pace or Pace()
    runs, (followed,) = _clean(estimate, clean, case), _read(estimate, (log,), case)
    progress("thresholds of the clean runs")
    thresholds = thresholds_of(estimate, runs, pace, rate)
    progress("following")
    return TrackRun(tracked(estimate, followed, pace, thresholds), thresholds.seconds)


def logs_of_fit(estimate: Estimate) -> list[str]:
    """Return where the logs are that the estimate was made from, as :func:`file_of_fit` finds them.

    Raises:
        LogMismatch: One is not there as it was, or the estimate names none.
    """
    step, found = "name logs without contact or change: --clean LOG ...", []
    for log in estimate.provenance.get("logs", ()):
        path = str(log.get("path", ""))
        place = file_of_fit(estimate, log)
        if not place:
            evidence = "this log of the fit is not there as it was, nor where the estimate or its case lies"
            raise LogMismatch(path or "simulated log", evidence, step)
        found.append(place)
    if not found:
        raise LogMismatch("the estimate", "it names no logs", step)
    return found


def _clean(estimate: Estimate, logs: Sequence[Named] | None, case: Case | None) -> list[Log]:
    """Return the clean runs that are named, or the logs of the fit."""
    return _read(estimate, logs_of_fit(estimate)) if logs is None else _read(estimate, logs, case)


def _read(estimate: Estimate, logs: Sequence[Named], case: Case | None = None) -> list[Log]:
    return [log if isinstance(log, Log) else read_log(estimate, log, case) for log in logs]


def symbolic_model(subject: RobotLike | Case | Estimate) -> symbolic.SymbolicModel:
    """Return regressor, gravity torque and base parameters of an arm of up to three joints as SymPy expressions.

    Args:
        subject: A dynamic model, a case or an estimate, with its friction; a robot in any form that :func:`robot_of`
            takes, without friction.

    Raises:
        MissingDependency: SymPy is not installed (extra ``symbolic``).
        BadOption: An arm of more than three joints.
        BadArgument: Something else.
    """
    owner = subject.model if isinstance(subject, Case | Estimate) else subject
    return symbolic.symbolic_model(owner if isinstance(owner, DynamicModel) else robot_of(owner))
