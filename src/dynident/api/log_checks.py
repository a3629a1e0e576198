"""The log checks of a fit, made on the logs that it is given: what stops it, and what goes with its verdict."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from dynident.case.case import Case
from dynident.data.formats import ColumnMap
from dynident.data.log import Log
from dynident.data.preprocessing import default_preprocessing
from dynident.diagnosis.verdict import SUSPECT, ErrorFinding, errors_in
from dynident.errors import DynidentError, NotAccepted
from dynident.identification.estimate.estimate import Estimate
from dynident.model.dynamic_model import DynamicModel

#: Findings after which a fit says nothing: the time or the columns of the log have no meaning yet.
STOPS = (
    "time unit",
    "unreadable",
    "signal missing",
    "values that are not finite",
    "two publishers",
    "repeated rows",
    "time runs back",
    "equal time stamps",
    "too few rows",
    "torque never changes",
    "equal columns",
)


def case_of_model(model: DynamicModel) -> Case:
    """Return the case that stands for a model whose logs are in memory, in SI units."""
    columns = ColumnMap(joints=model.robot.joint_names)
    return Case(model.robot, tuple(model.friction), columns, default_preprocessing())


def check_logs(
    case: Case,
    logs: Sequence[Log],
    progress: Callable[[str], None] = lambda step: None,
    earlier: Estimate | None = None,
) -> list[dict[str, Any]]:
    """Return what the checks find in logs that were read, and in those together that are alike, as plain data.

    Args:
        case: Robot, units and preprocessing.
        logs: The logs, in the order of the robot's joints or not.
        progress: Called with the step in words.
        earlier: An estimate of the robot, whose bodies take the place of the robot model's.

    Raises:
        LogMismatch: A joint is missing.
    """
    from dynident.diagnosis.examination import examine_recordings  # a fit without checks needs neither
    from dynident.diagnosis.recording import recording_of

    progress("log checks")
    names = case.robot.joint_names
    recordings = [recording_of(case, log.ordered(names)) for log in logs]
    return [examination.figures() for examination in examine_recordings(case, recordings, earlier)]


def check_heads(case: Case, progress: Callable[[str], None] = lambda step: None) -> list[dict[str, Any]]:
    """Return what the checks find in the first minutes of the training logs of a case, too large for memory.

    Args:
        case: The case, with its logs.
        progress: Called with the step in words.

    Raises:
        LogFormatError: An unsound row.
        LogMismatch: A log lacks a signal or a joint.
    """
    from dynident.data.log_places import at_hand
    from dynident.identification.streaming.one_log import head_of  # few logs are as large

    setup, heads = case.stream_setup(), []
    progress("log checks of the first minutes")
    for place in map(str, map(case.place, case.train)):
        with at_hand(place) as path:
            heads.append(head_of(setup, path))
    return check_logs(case, heads)


def refuse_faulty(quality: Sequence[Mapping[str, Any]], strict: bool = False) -> None:
    """Refuse logs with findings that leave a fit without a meaning; with ``strict`` those with any at error level.

    Raises:
        NotAccepted: There is one; the message has its evidence and remedy.
    """
    for cause in errors_in(quality):
        if strict or cause.name in STOPS:
            raise NotAccepted(cause.log, f"{cause.title}: {cause.evidence}", cause.remedy)


def warn_of(causes: Sequence[ErrorFinding], command: str = "") -> None:
    """Give a Python warning, at the line that called the verb, for each finding at error level.

    None where a command was typed: it shows the verdict.
    """
    for cause in () if command else causes:
        warnings.warn(f"not accepted: {cause}", stacklevel=3)


def add_causes(error: DynidentError, quality: Sequence[Mapping[str, Any]]) -> None:
    """Put what the checks have found in the logs of a fit before the message of its error."""
    causes = errors_in(quality)
    if causes:
        error.args = (f"{SUSPECT} {'; '.join(str(cause) for cause in causes)}. With that, {error}",)
