"""What several commands share: a case from the command line's options, logs read and split, parts from text."""

from __future__ import annotations

import argparse
import shlex
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from dynident.estimation.consistency.scale import BodyPrior
    from dynident.estimation.estimate import Estimate
    from dynident.estimation.estimators import Estimator
    from dynident.experiment.case_file.case import Case
    from dynident.experiment.log import Log


def add_case_options(parser: argparse.ArgumentParser) -> None:
    """Add the options that change a case: model, filter, split."""
    model = parser.add_argument_group("model (a case file states these for good)")
    model.add_argument(
        "--friction",
        nargs="+",
        metavar="NAME",
        help="friction parts, such as: coulomb viscous offset rotor_inertia; see 'dynident list friction'; "
        "'auto' chooses them joint by joint on held-out blocks of the training logs",
    )
    data = parser.add_argument_group("data")
    data.add_argument(
        "--split", metavar="HOW", help="first:0.67, or rows:0:24750,29250:45000: train on one, test on the other"
    )
    data.add_argument(
        "--cutoff", type=_hertz, metavar="HZ", help="cut-off of the Butterworth filter on both sides, or 'auto'"
    )
    data.add_argument("--rate", metavar="HZ", help="rows a second that are used, 'all' or 'auto'")
    data.add_argument(
        "--delay", metavar="S", help="seconds by which torques lag behind positions, or 'auto': found for each log"
    )


def _hertz(text: str) -> str:
    """Return a frequency as it was written, or 'auto'."""
    if text != "auto":
        float(text)
    return text


def case_from(options: argparse.Namespace, open_gains: bool = False) -> Case:
    """Return the case named on the command line with its options applied; ``open_gains`` as of :func:`read_case`.

    Raises:
        DynidentError: Any fault of the case or of an option.
    """
    from dynident.errors import BadOption
    from dynident.experiment.case_file.case import AUTO, DEFAULT_FRICTION, default_preprocessing, read_case
    from dynident.experiment.case_file.split import Split
    from dynident.experiment.preprocessing import FILTERS
    from dynident.model.friction import FRICTION

    case = read_case(options.case, open_gains)
    if options.friction:
        chosen = options.friction == [AUTO]
        names = DEFAULT_FRICTION if chosen else options.friction
        case = replace(case, friction=tuple(FRICTION.make(name) for name in names), choose_friction=chosen)
    if options.split and options.test:
        raise BadOption("--split", options.split, "it does not go with --test; give one of the two")
    if options.split or options.test:  # test logs on the command line take the place of the case's split
        case = replace(case, split=Split.parse(options.split) if options.split else None)
    how = case.preprocessing
    if options.cutoff is not None:
        how = replace(how, filter=FILTERS.make_from_text("butterworth", {"cutoff_hz": options.cutoff}))
    if options.rate is not None:
        try:
            rate = None if options.rate in ("all", AUTO) else float(options.rate)
            rows = default_preprocessing().rows_per_period if options.rate == AUTO else None
            how = replace(how, rate_hz=rate, rows_per_period=rows)
        except ValueError:
            raise BadOption("rate", options.rate, "give rows a second, 'all' or 'auto'") from None
    if options.delay is not None:
        try:
            how = replace(how, delay_s=None if options.delay == AUTO else float(options.delay))
        except ValueError:
            raise BadOption("delay", options.delay, "give seconds, or 'auto'") from None
    return replace(case, preprocessing=how)


@dataclass(frozen=True)
class Data:
    """Logs to learn from and logs to test on."""

    train: tuple[Log, ...]
    test: tuple[Log, ...]


def with_knowledge(case: Case, prior: str | None, constraints: str | None) -> Case:
    """Return the case with a prior and constraints from files in place of its own.

    Raises:
        DynidentError: A fault of the constraints file.
    """
    from dynident.experiment.case_file.constraints_file import read_constraints

    if prior:
        case = replace(case, prior=prior)
    return replace(case, constraints=read_constraints(constraints, case.robot)) if constraints else case


def prior_of(case: Case) -> BodyPrior | None:
    """Return the prior that a case names, read; None where it names none.

    Raises:
        DynidentError: The file is no description or estimate, or of another robot.
    """
    from dynident.estimation.consistency.prior_file import read_prior

    return read_prior(case.find(case.prior), case.robot, case.locked) if case.prior else None


def with_logs(case: Case, options: argparse.Namespace) -> Case:
    """Return the case with the logs of the command line in place of its own, each a file or an address.

    Folders, patterns and folders of buckets are replaced by the logs that they stand for, as `reduce` does.

    Raises:
        FileError: A pattern or a folder without logs, or an address that cannot be reached.
        MissingDependency: An address, and fsspec is not installed.
    """
    from dynident.cli import console
    from dynident.experiment.log_places import logs_named

    given = options.logs or getattr(options, "triangles", None)  # not every command has them
    train, others = logs_named(options.logs if given else case.train, case.find)
    test, more = logs_named(options.test or (() if options.logs else case.test), case.find)
    if others or more:
        named = ", ".join((*others, *more))
        console.remark(f"no logs by their suffix, left out: {named}", options.quiet or options.json)
    return replace(case, train=tuple(train), test=tuple(test))


def read_data(case: Case) -> Data:
    """Read the logs of a case, and split them where that is asked.

    Raises:
        DynidentError: No log named, or any fault of a log.
    """
    from dynident.errors import BadOption, DescriptionError

    if case.split is not None and case.test:
        raise DescriptionError(case.path, "split", "it stands beside 'test'", "keep one of the two")
    if not case.train:
        raise BadOption("LOG", "", "name a log on the command line, or under train: in the case file")
    train, given = ([case.read(name) for name in names] for names in (case.train, case.test))
    _check_distinct(train, given)
    if given or case.split is None:
        return Data(tuple(train), tuple(given))
    parts = [case.split.apply(log) for log in train]
    return Data(tuple(a for a, _ in parts), tuple(b for _, b in parts))


def _check_distinct(train: Sequence[Log], test: Sequence[Log]) -> None:
    """Refuse a log that counts twice: its rows would look like new ones."""
    from dynident.errors import LogMismatch

    seen: dict[str, str] = {}
    for log in (*train, *test):
        if log.source.sha256 in seen:
            step = "give each log once, and test on logs that are not trained on"
            raise LogMismatch(log.name, f"the same content as {seen[log.source.sha256]}", step)
        seen[log.source.sha256] = log.name


def log_quality(case: Case) -> list[dict[str, Any]]:
    """Return what the doctor finds in the logs to learn from of the case."""
    from dynident.estimation.doctor import examine

    return [examine(case, name).figures() for name in case.train]


def cut(text: str, mark: str) -> list[str]:
    """Return the text cut at a mark outside brackets, blanks around the parts left out."""
    parts, depth = [""], 0
    for character in text:
        depth += (character in "[(") - (character in ")]")
        if character == mark and depth == 0:
            parts.append("")
        else:
            parts[-1] += character
    return [part.strip() for part in parts]


def estimator_from(case: Case, name: str | None, options: Sequence[str]) -> Estimator:
    """Return the estimator of the case, or the named one, with ``key=value`` options, also behind the name with colons.

    Raises:
        UnknownChoice: No such estimator.
        BadOption: No such option, or not of the form key=value.
    """
    from dynident.errors import BadOption, DescriptionError, DynidentError
    from dynident.estimation.estimators import ESTIMATORS

    chosen = case.estimator
    written: list[str] = []
    if name is not None:
        name, *written = cut(name, ":")
    texts: dict[str, str | None] = dict(chosen.options) if name in (None, chosen.name) else {}
    for item in (*written, *options):
        key, equals, value = item.partition("=")
        if not equals:
            raise BadOption("--option", item, "write key=value, such as --option iterations=500")
        texts[key] = value
    try:
        return ESTIMATORS.make_from_text(name or chosen.name, texts)
    except DynidentError as error:
        if name is None and case.path and not options:
            raise DescriptionError(case.path, "estimator", str(error), "see docs/case-file.md") from error
        raise


def check_outputs(outputs: Sequence[str | None], inputs: Sequence[str | Path]) -> None:
    """Refuse an output that would overwrite an input or another output, before anything is computed.

    Raises:
        FileError: Two of the files are the same.
    """
    from dynident.errors import FileError

    taken = {Path(name).resolve(): "it is an input of this command" for name in inputs if name}
    for name in filter(None, outputs):
        place = Path(str(name)).resolve()
        if place in taken:
            raise FileError(name, f"{taken[place]} and would be overwritten", "choose another name for the output")
        taken[place] = "two outputs have this name"


def files_behind(estimate: Estimate) -> list[str]:
    """Return the files that an estimate stands on: its logs and its case file."""
    logs = [str(log.get("path", "")) for log in estimate.provenance.get("logs", ())]
    return [*logs, str(estimate.provenance.get("case", {}).get("path", ""))]


def seen_logs(estimate: Estimate, logs: Sequence[Log]) -> list[str]:
    """Return the names of logs with the content of one that trained the estimate, whole or in part."""
    trained = {log.get("sha256") for log in estimate.provenance.get("logs", ())} - {"", None}
    return [log.name for log in logs if log.source.sha256 in trained]


def check_unseen(estimate: Estimate, logs: Sequence[Log]) -> None:
    """Refuse a log that trained the estimate where a report would call it unseen.

    Raises:
        LogMismatch: A log has the content of one of the fit.
    """
    from dynident.errors import LogMismatch

    for name in seen_logs(estimate, logs)[:1]:
        step = "test on another log, or on the rest of this one with --split as in the fit"
        raise LogMismatch(name, "the fit has seen this log", step)


def repeat_command() -> str:
    """Return the command line as it was typed, to be repeated."""
    return shlex.join(["dynident", *sys.argv[1:]])


def provenance_of(case: Case) -> dict[str, Any]:
    """Return the facts of this run that go with an estimate."""
    from dynident.files import sha256_of

    facts: dict[str, Any] = {"command": repeat_command()}
    if case.path:
        facts["case"] = {"path": case.path, "sha256": sha256_of(case.path)}
    if Path(case.robot_path).is_file():
        facts["robot"] = {"path": case.robot_path, "sha256": sha256_of(case.robot_path)}
    return facts
