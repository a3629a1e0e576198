"""validate: an estimate against logs that had no part in its fit, in memory or named."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from pathlib import Path

from dynident.api.case_logs import seen_logs
from dynident.api.given_logs import LogLike, logs_of
from dynident.applications.standstill import with_rest
from dynident.data.log import Log
from dynident.data.log_of_robot import read_with
from dynident.data.preprocessing import Preprocessing, preprocess
from dynident.errors import BadArgument
from dynident.identification import validate as bare
from dynident.identification.estimate.estimate import Estimate
from dynident.identification.estimate.validation import Validation
from dynident.model.threads import one_blas_thread


def validate(
    estimate: Estimate, logs: LogLike | Sequence[LogLike], preprocessing: Preprocessing | None = None
) -> Validation:
    """Compare an estimate with logs that had no part in its fit; they are prepared as those of the fit.

    Args:
        estimate: The estimate.
        logs: One raw log with positions and torques or several, as :func:`log_of` takes them; files are read as the
            logs of the fit were.
        preprocessing: Another preparation than that of the fit.

    A log that was used for training gives a Python warning.

    Raises:
        BadArgument: Something that is no log, or arrays of a wrong shape.
        FileError: A log cannot be read.
        LogFormatError: A file is no sound log.
        LogMismatch: A log does not fit the robot, or is too short.
    """
    if not isinstance(estimate, Estimate):
        step = "write di.validate(estimate, log); di.read_estimate(path) reads one from a file"
        raise BadArgument("estimate", f"{type(estimate).__name__} where an Estimate is wanted", step)
    given = logs_of(logs, estimate.model.robot, lambda name: read_log(estimate, name))
    if seen := seen_logs(estimate, given, parts_apart=True):
        text = f"{', '.join(seen)}: used for training, so the errors are optimistic; validate on another log"
        warnings.warn(text, stacklevel=2)
    return compared(estimate, given, preprocessing)


@one_blas_thread()
def compared(estimate: Estimate, logs: Sequence[Log], preprocessing: Preprocessing | None = None) -> Validation:
    """Compare an estimate with raw logs, and its samples at rest with what static friction can hold.

    Args:
        estimate: The estimate.
        logs: Raw logs with positions and torques.
        preprocessing: Another preparation than that of the fit.

    Raises:
        LogMismatch: A log does not fit the robot, or is too short.
    """
    how, names = preprocessing or estimate.preprocessing, estimate.model.robot.joint_names
    prepared = [preprocess(log.ordered(names), how) for log in logs]
    found = bare.validate(estimate, prepared)
    return with_rest(estimate, found, prepared) if found.rests else found


def read_log(estimate: Estimate, name: str | Path) -> Log:
    """Return a log that is read as those of the fit were.

    Raises:
        DynidentError: Any fault of the log.
    """
    return read_with(name, estimate.columns, estimate.model.robot)
