"""What several commands share: a case and its logs from the options of the command line, and where tasks are done."""

from __future__ import annotations

import argparse
import shlex
import sys
from collections.abc import Mapping
from typing import TYPE_CHECKING

from dynident.cli import console
from dynident.errors import BadOption

if TYPE_CHECKING:
    from dynident.case.case import Case


def add_case_options(parser: argparse.ArgumentParser) -> None:
    """Add the options that change a case: model, filter, split."""
    model = parser.add_argument_group("model (a case file states these for good)")
    model.add_argument(
        "--friction",
        nargs="+",
        metavar="NAME",
        help="friction parts, such as: coulomb viscous offset rotor_inertia; see 'dynident list friction'; "
        "'auto' chooses them, as drafts of init do, on held-out blocks of the training logs",
    )
    data = parser.add_argument_group("data")
    data.add_argument(
        "--split", metavar="HOW", help="first:0.67, or samples:0:24750,29250:45000: train on one, test on the other"
    )
    data.add_argument(
        "--cutoff", type=_hertz, metavar="HZ", help="cut-off of the Butterworth filter on both sides, or 'auto'"
    )
    data.add_argument("--rate", metavar="HZ", help="samples a second that are used, 'all' or 'auto'")
    data.add_argument(
        "--delay", metavar="S", help="seconds by which torques lag behind positions, or 'auto': found for each log"
    )


def add_accept(group: argparse._ActionsContainer) -> None:
    """Add the option that states acceptance criteria."""
    group.add_argument(
        "--accept",
        nargs="+",
        default=[],
        metavar="CRITERION[=LIMIT]",
        help="what the estimate must meet, beside accept: of the case file: total_error=5%% joint_error=10%% "
        "interval=5%% better_than_nominal consistent plausible log_checks; exit code 3 where it does not",
    )


def add_log_case(group: argparse._ActionsContainer) -> None:
    """Add the option that says how logs are read that are not as those of the fit."""
    group.add_argument(
        "--case",
        metavar="CASE",
        help="case file of these logs, as 'dynident init' drafts it, where their columns, units or format are others "
        "than those of the fit",
    )


def log_case(options: argparse.Namespace) -> Case | None:
    """Return the case that says how the logs are read; None where they are read as those of the fit."""
    from dynident.case.case import read_case

    return read_case(options.case, open_gains=True) if options.case else None


#: Options that change how logs become triangles.
_MODEL_OPTIONS = ("friction", "cutoff", "rate", "delay")


def model_options(options: argparse.Namespace) -> dict[str, str | list[str]]:
    """Return the options that change model and preprocessing of a case, as they were given."""
    return {name: getattr(options, name) for name in _MODEL_OPTIONS if getattr(options, name) is not None}


def take_model_options(options: argparse.Namespace, found: Mapping[str, str | list[str]]) -> None:
    """Take options that triangles were reduced with, where the command line does not give them."""
    for name in _MODEL_OPTIONS:
        if getattr(options, name) is None and name in found:
            setattr(options, name, found[name])


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
    from dynident.api.case_options import CaseOptions, case_with

    own = CaseOptions(
        friction=tuple(options.friction or ()),
        split=options.split,
        has_test_logs=bool(options.test),
        cutoff=options.cutoff,
        rate=options.rate,
        delay=options.delay,
        prior=getattr(options, "prior", None),  # not every command has these three
        constraints=getattr(options, "constraints", None),
        bodies=getattr(options, "bodies", None),
    )
    return case_with(options.case, own, open_gains)


def with_logs(case: Case, options: argparse.Namespace) -> Case:
    """Return the case with the logs of the command line in place of its own, each a file or an address.

    Raises:
        FileError: A pattern or a folder without logs, or an address that cannot be reached.
        MissingDependency: An address, and fsspec is not installed.
    """
    from dynident.api.case_logs import with_logs as with_named

    given = options.logs or getattr(options, "triangles", None)  # not every command has them
    test = options.test or (() if options.logs else None)
    case, others = with_named(case, options.logs if given else None, test)
    if others:
        console.remark(f"no logs by their suffix, left out: {', '.join(others)}", options.quiet or options.json)
    return case


def repeat_command() -> str:
    """Return the command line as it was typed, to be repeated."""
    return shlex.join(["dynident", *sys.argv[1:]])


if TYPE_CHECKING:
    from dynident.workers.processes import Pool


def add_pool_option(group: argparse._ArgumentGroup) -> None:
    """Add the option that names a cluster."""
    group.add_argument(
        "--scheduler",
        metavar="ADDRESS",
        help="in place of --jobs: a Dask cluster, such as tcp://host:8786, its JSON file, or local:N (docs/scale.md)",
    )


def cluster_of(options: argparse.Namespace) -> Pool | None:
    """Return the cluster that the options name; None where they name none.

    Raises:
        BadOption: It stands beside --jobs, or is no scheduler.
    """
    if options.scheduler is None:
        return None
    from dynident.workers.dask_pool import DaskPool

    if options.jobs != 1:
        raise BadOption("--jobs", options.jobs, "it does not go with --scheduler; give one of the two")
    return DaskPool(options.scheduler)
