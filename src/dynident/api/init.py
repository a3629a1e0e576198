"""init: the draft of a case file from a robot model and its logs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from dynident.api.case_logs import logs_named
from dynident.api.log_checks import case_of_model
from dynident.case.case_draft import Draft, draft_case, told_gravity
from dynident.data.log_places import is_address
from dynident.diagnosis.causes.gravity_direction import followed_gravity
from dynident.diagnosis.causes.thin_fit import quick_fit
from dynident.errors import BadArgument, BadOption
from dynident.files import resolved
from dynident.model.dynamic_model import DynamicModel
from dynident.model.threads import one_blas_thread


@dataclass(frozen=True)
class LogKind:
    """What is stated of the files of logs; empty or None: found from the columns and the suffix.

    Attributes:
        profile: Profile of their vendor.
        format: Format of the files.
        format_options: Options of the format, as text.
        rate_hz: Samples a second, where no column has the time.
    """

    profile: str = ""
    format: str = ""
    format_options: Mapping[str, str | None] = field(default_factory=dict)
    rate_hz: float | None = None


def init(
    robot: str,
    logs: str | Sequence[str],
    folder: str | Path = ".",
    *,
    test: Sequence[str] = (),
    kind: LogKind | None = None,
) -> Draft:
    """Return the draft of a case file: its text, what it asks, and what was recognised.

    Args:
        robot: Robot model, or the name of a built-in robot.
        logs: Log of a motion, or several with the same columns: files, folders or patterns.
        folder: Where the case file will stand; paths in it are relative to it.
        test: Logs to test on, named alike.
        kind: What is stated of the files of the logs.

    Raises:
        BadArgument: Arrays in place of a file.
        FileError: A file cannot be read.
        DescriptionError: A fault in the robot model.
        LogFormatError: No sound log.
        UnknownChoice: No such profile or format.
        BadOption: A log that is named twice, or a profile or a rate that does not fit.
    """
    train = (logs,) if isinstance(logs, str | Mapping) else tuple(logs)
    for log in train:
        if not isinstance(log, str | Path):
            step = "give the name of a file; arrays need no draft: di.identify(robot, log)"
            raise BadArgument("logs", f"{type(log).__name__} where a file is wanted", step)
    kind = kind or LogKind()
    train, held = _named(train), _named(test)
    _check_once((*train, *held))
    draft = draft_case(
        robot,
        train,
        folder,
        test=held,
        profile=kind.profile,
        form=kind.format,
        form_options=kind.format_options,
        rate_hz=kind.rate_hz,
    )
    sample = draft.recognition.sample
    if sample is None or draft.recognition.effort != "torque":
        return draft
    with one_blas_thread():
        fit = quick_fit(case_of_model(DynamicModel(sample[0])), sample[1])
        return draft if fit is None else told_gravity(draft, followed_gravity(fit))


def _named(logs: Sequence[str]) -> tuple[str, ...]:
    """Return the logs that files, folders and patterns stand for; addresses are as they are."""
    return tuple(one for log in logs for one in ([log] if is_address(str(log)) else logs_named([str(log)], Path)[0]))


def _check_once(logs: Sequence[str]) -> None:
    """Refuse a log that is named twice: it would count twice in the fit, or be tested on after it was learned from."""
    seen: dict[Path, str] = {}
    for log in logs:
        place = resolved(log)
        if place in seen:
            raise BadOption("LOG", log, f"it is the same file as {seen[place]}: name each log once")
        seen[place] = log
