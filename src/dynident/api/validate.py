"""validate: an estimate against logs that had no part in its fit, in memory or named."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from dynident.data.log import Log
from dynident.data.log_of_robot import read_with
from dynident.data.preprocessing import Preprocessing
from dynident.identification import validate as bare
from dynident.identification.estimate.estimate import Estimate
from dynident.identification.estimate.validation import Validation


def validate(
    estimate: Estimate, logs: Sequence[Log | str | Path], preprocessing: Preprocessing | None = None
) -> Validation:
    """Compare an estimate with logs that had no part in its fit; they are prepared as those of the fit.

    Args:
        estimate: The estimate.
        logs: Raw logs with positions and torques; names are read as the logs of the fit were.
        preprocessing: Another preparation than that of the fit.

    Raises:
        FileError: A log cannot be read.
        LogFormatError: A file is no sound log.
        LogMismatch: A log does not fit the robot, or is too short.
    """
    return bare.validate(
        estimate, [log if isinstance(log, Log) else read_log(estimate, log) for log in logs], preprocessing
    )


def read_log(estimate: Estimate, name: str | Path) -> Log:
    """Return a log that is read as those of the fit were.

    Raises:
        DynidentError: Any fault of the log.
    """
    return read_with(name, estimate.columns, estimate.model.robot)
