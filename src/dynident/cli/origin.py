"""What an estimate was fitted from, read again: logs held out, and the log checks of those of the fit.

The command that made the estimate stands in its provenance. It is repeated as far as the reading of the logs, and
believed only where case file and logs have the content that they had then.
"""

from __future__ import annotations

import argparse
import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from dynident.cli import jobs
from dynident.errors import DynidentError
from dynident.files import sha256_of

if TYPE_CHECKING:
    from dynident.case.case import Case
    from dynident.data.log import Log
    from dynident.identification.estimate.estimate import Estimate


@dataclass(frozen=True)
class Origin:
    """Case and logs of a fit.

    Attributes:
        held_out: Logs, or parts of logs, that the fit has kept apart for a test.
        train: Logs, or parts of logs, of the fit.
        case: The case with the logs of the fit; None where it could not be read again.
        why_not: Why nothing could be read again, with the next step; empty where it could.
    """

    held_out: tuple[Log, ...] = ()
    train: tuple[Log, ...] = ()
    case: Case | None = None
    why_not: str = ""

    def log_quality(self) -> list[dict[str, Any]]:
        """Return what the log checks find in the logs of the fit; nothing where they could not be read again."""
        from dynident.api.log_checks import check_logs

        return [] if self.case is None else check_logs(self.case, self.train)


class _Refused(Exception):
    """The reading cannot be repeated; its text says why to a person."""


def origin_of(estimate: Estimate) -> Origin:
    """Return the case and the logs that an estimate was fitted from, as far as they are still there and the same."""
    try:
        return _read_again(estimate)
    except _Refused as problem:
        return Origin(why_not=str(problem))
    except DynidentError as problem:
        return Origin(why_not=f"the logs of the fit cannot be read again ({problem})")


def _read_again(estimate: Estimate) -> Origin:
    from dynident.api.case_logs import read_data
    from dynident.api.estimate_output import file_of_fit

    options = _options(estimate.provenance.get("command"))
    if options.triangles or _is_large(estimate):
        raise _Refused("the fit was made from reduced or very large logs")
    options.prior = options.constraints = None  # reading logs takes neither
    options.case = file_of_fit(estimate, estimate.provenance.get("case", {})) or options.case
    for names in filter(None, (options.logs, options.test)):
        names[:] = [_place(estimate, name) for name in names]
    case = jobs.with_logs(jobs.case_from(options), options)
    _check_file(case.path, estimate.provenance.get("case"))
    data = read_data(case)
    trained = {log.get("sha256") for log in estimate.provenance.get("logs", ())}
    if {log.source.sha256 for log in data.train} != trained:
        raise _Refused("a log of the fit has another content now")
    if data.train and data.train[0].joints != estimate.model.robot.joint_names:
        raise _Refused("the case has other joints now")
    return Origin(data.test, data.train, case)


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        raise _Refused(f"the command in its provenance is not understood ({message})")


def _options(command: object) -> argparse.Namespace:
    """Return the options of the command that made an estimate."""
    from dynident.cli import identify

    try:
        words = shlex.split(command) if isinstance(command, str) else []
    except ValueError:
        words = []
    if words[1:2] != ["identify"]:
        raise _Refused("its provenance has no command of 'dynident identify'")
    parser = _Parser(prog="dynident identify", add_help=False)
    identify.configure(parser)
    return parser.parse_args(words[2:])


def _check_file(path: str, stated: object) -> None:
    known = stated.get("sha256") if isinstance(stated, dict) else None
    if path and known != sha256_of(path):
        raise _Refused(f"{path} has another content now")


def _is_large(estimate: Estimate) -> bool:
    """Say whether the logs of the fit, as far as they are there, are too large to be read into memory once more."""
    from dynident.data.formats import LARGE

    places = [Path(_place(estimate, str(log.get("path", "")))) for log in estimate.provenance.get("logs", ())]
    return sum(place.stat().st_size for place in places if place.is_file()) > LARGE


def _place(estimate: Estimate, name: str) -> str:
    """Return the first place of a log of the fit, or a folder of them, that is there; its name where none is."""
    from dynident.api.estimate_output import places_of_fit

    return next((str(place) for place in places_of_fit(estimate, name) if place.exists()), name)
