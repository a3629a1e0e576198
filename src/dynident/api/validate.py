"""validate: an estimate against logs that had no part in its fit, in memory or named."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

from dynident.api.case_logs import read_data, seen_logs
from dynident.api.estimate_output import file_of_fit
from dynident.api.given_logs import LogLike, logs_of
from dynident.api.log_checks import check_logs
from dynident.applications.standstill import with_rest
from dynident.applications.start_states import with_starts
from dynident.case.acceptance import Acceptance
from dynident.case.case import Case, read_case
from dynident.data.formats import ColumnMap, open_log
from dynident.data.log import Log
from dynident.data.log_of_robot import LOCKED_TOLERANCE, read_with
from dynident.data.preprocessing import Preprocessing, preprocess
from dynident.diagnosis.new_log import NewLog, check_command, new_log
from dynident.errors import BadArgument, DynidentError, LogFormatError, LogMismatch
from dynident.identification import validate as bare
from dynident.identification.estimate.estimate import Estimate
from dynident.identification.estimate.validation import Validation
from dynident.model.robot import Robot
from dynident.model.threads import one_blas_thread

#: What reads a log of another format than those of the fit.
OTHER_FORMAT = (
    "a log of another format than those of the fit is read with a case file of its own, as 'dynident init' drafts it: "
    "--case FILE of validate, predict, payload, monitor and track"
)


def validate(
    estimate: Estimate,
    logs: LogLike | Sequence[LogLike] | None = None,
    preprocessing: Preprocessing | None = None,
    case: Case | None = None,
) -> Validation:
    """Compare an estimate with logs that had no part in its fit; they are prepared as those of the fit.

    Args:
        estimate: The estimate.
        logs: One raw log with positions and torques or several, as :func:`log_of` takes them; files are read as the
            logs of the fit were; None for the test logs of the case file of the fit.
        preprocessing: Another preparation than that of the fit.
        case: How files are read, where their columns or units are others than those of the logs of the fit.

    A log that was used for training gives a Python warning.

    Raises:
        BadArgument: Something that is no log, arrays of a wrong shape, or None without test logs in a case file.
        FileError: A log cannot be read.
        LogFormatError: A file is no sound log.
        LogMismatch: A log does not fit the robot, or is too short.
    """
    if not isinstance(estimate, Estimate):
        step = "write di.validate(estimate, log); di.read_estimate(path) reads one from a file"
        raise BadArgument("estimate", f"{type(estimate).__name__} where an Estimate is wanted", step)
    if logs is None:
        logs = _test_logs(estimate)
    given = logs_of(logs, estimate.model.robot, lambda name: read_log(estimate, name, case))
    if seen := seen_logs(estimate, given, parts_apart=True):
        text = f"{', '.join(seen)}: used for training, so the errors are optimistic; validate on another log"
        warnings.warn(text, stacklevel=2)
    return compared(estimate, given, preprocessing)


def _test_logs(estimate: Estimate) -> Sequence[Log]:
    """Return the test logs of the case file of a fit, or the test part of its split."""
    stated = estimate.provenance.get("case", {})
    path = file_of_fit(estimate, stated) or str(stated.get("path", ""))
    step = "write di.validate(estimate, log), with a log that had no part in the fit"
    if not path:
        raise BadArgument("logs", "none given, and no case file of the fit to name test logs", step)
    logs = read_data(read_case(path)).test
    if not logs:
        raise BadArgument("logs", f"none given, and {path} names no test logs", step)
    return logs


@one_blas_thread()
def compared(
    estimate: Estimate, logs: Sequence[Log], preprocessing: Preprocessing | None = None, interval_at_rest: bool = True
) -> Validation:
    """Compare an estimate with raw logs, and its samples at rest with what static friction can hold.

    How warm the drives are at the start of a log, where friction depends on it, is found from the log.

    Args:
        estimate: The estimate.
        logs: Raw logs with positions and torques.
        preprocessing: Another preparation than that of the fit.
        interval_at_rest: False counts samples at rest against the model's torque, as other tools do.

    Raises:
        LogMismatch: A log does not fit the robot, or is too short.
    """
    how, names = preprocessing or estimate.preprocessing, estimate.model.robot.joint_names
    prepared = [preprocess(log.ordered(names), how) for log in logs]
    logs_from, starts = with_starts(estimate, prepared)
    found = replace(bare.validate(estimate, logs_from), start_states=starts)
    return with_rest(estimate, found, logs_from) if interval_at_rest else found


def judged_logs(
    estimate: Estimate,
    test: Validation,
    logs: Sequence[Log],
    case: Case | None = None,
    place: str = "ESTIMATE",
    acceptance: Acceptance | None = None,
    progress: Callable[[str], None] = lambda step: None,
) -> NewLog:
    """Return what a comparison says of the logs; where they err far beyond the training their log checks are made.

    Args:
        estimate: The estimate, whose bodies take the place of the robot model's in the checks.
        test: Its comparison with the logs.
        logs: The logs.
        case: The case that they were read by; None where they were read as those of the fit.
        place: The file of the estimate, for messages.
        acceptance: Criteria, of which one may ask for the checks in any case.
        progress: Called with each step in words.
    """
    path = str(estimate.provenance.get("case", {}).get("path", "")) if case is None else case.path

    def check() -> list[dict[str, Any]]:
        columns, robot, _ = reading_of(estimate, case)
        subject = Case(robot, tuple(estimate.model.friction), columns, estimate.preprocessing, path=path)
        return check_logs(subject, logs, progress, estimate)

    command = check_command([log.name for log in logs], place, path)
    return new_log(estimate, test, command, check, acceptance is not None and "log_checks" in acceptance.limits)


def read_log(estimate: Estimate, name: str | Path, case: Case | None = None) -> Log:
    """Return a log that is read as those of the fit were, or as a case of its robot states.

    Raises:
        LogFormatError: The file is no sound log, or has other columns.
        DynidentError: Any other fault of the log.
    """
    columns, robot, locked = reading_of(estimate, case)
    with other_columns(columns, case):
        log = read_with(name if case is None else case.place(name), columns, robot, locked)
    return log.ordered(estimate.model.robot.joint_names)


@contextmanager
def other_columns(columns: ColumnMap, case: Case | None = None) -> Iterator[None]:
    """Say what reads a log of another format than those of the fit; a faulty row further down is none.

    Args:
        columns: Those with which it is read.
        case: The case that states them; None for those of the fit.

    Raises:
        LogFormatError: As raised inside, with that step.
    """
    try:
        yield
    except LogFormatError as error:
        if case is None and not _is_read(error, columns):
            error = LogFormatError(error.path, error.line, error.evidence, f"{error.step}; {OTHER_FORMAT}")
        raise error from None


def _is_read(error: LogFormatError, columns: ColumnMap) -> bool:
    """Return whether the header of a log has the columns, and the fault is below its first row."""
    try:
        table = open_log(error.path, columns)
        columns.resolved(table.header, table.path, table.line)
    except DynidentError:
        return False
    return error.line is None or table.line is None or error.line > table.line + 1


def reading_of(estimate: Estimate, case: Case | None) -> tuple[ColumnMap, Robot, Mapping[str, float]]:
    """Return columns, robot and locked joints with which a log is read: those of the fit, or of a case.

    Drive gains that the case does not state are those of the estimate. Commanded motions, which an estimate does not
    need, are read where they are there.

    Raises:
        LogMismatch: The case locks a joint elsewhere than that of the fit did.
    """
    own = estimate.model.robot
    if case is None:
        commanded = [name for name in ("q_ref", "dq_ref") if getattr(estimate.columns, name)]
        optional = tuple(dict.fromkeys((*estimate.columns.optional, *commanded)))
        columns = replace(estimate.columns, optional=optional, leave_out=())  # another log may have the same name
        return columns, own, {}
    check_same_lock(own, case.robot, case.path)
    gains = {joint.name: joint.drive.gain for joint in own.active}
    drives = {
        joint.name: replace(joint.drive, gain=gains[joint.name])
        for joint in case.robot.active
        if joint.drive.gain is None and gains.get(joint.name) is not None
    }
    return case.columns, case.robot.with_drives(drives), case.locked


def check_same_lock(ours: Robot, theirs: Robot, path: str) -> None:
    """Refuse a case that locks a joint elsewhere than the case of a fit did, where joints move beyond it.

    Args:
        ours: The robot of the estimate.
        theirs: The robot of the case.
        path: The case file.

    Raises:
        LogMismatch: It does.
    """
    for name, at in ours.held.items():
        if abs(theirs.held.get(name, at) - at) > LOCKED_TOLERANCE:
            evidence = f"{name} is locked at {theirs.held[name]:g}, and at {at:g} in the estimate"
            raise LogMismatch(path, evidence, "identify with it locked where it stands in the new log, or not locked")
