"""Write the report of an estimate: one HTML file that opens offline; its figures as files for a paper.

Without --test it validates on the test logs, or the test part of the split, of the case file or command.

dynident report estimate.json -o report.html
dynident report estimate.json --test other-run.csv --figures figures --format pdf
dynident report estimate.json --prove -o report.html
dynident report estimate.json --plan plan.json --case case.yaml -o report.html
"""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

from dynident.cli import jobs, plans, proving
from dynident.errors import BadOption, UnknownChoice
from dynident.files import check_outputs, check_place, files_behind, write_atomically

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from dynident.data.log import Log
    from dynident.identification.estimate.estimate import Estimate
    from dynident.results.report.builder import ReportPart
    from dynident.results.report.subject import Subject

SUMMARY = "one HTML file from an estimate, and its figures for a paper"


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument("estimate", metavar="ESTIMATE", help="file that 'dynident identify -o' has written")
    parser.add_argument("--test", nargs="+", default=[], metavar="LOG", help="logs to validate on")
    parser.add_argument("--split", metavar="HOW", help="use only the test part of each log: first:0.67 or samples:...")
    parser.add_argument("--plan", metavar="PLAN", help="add the designed motion, a file of 'dynident excite -o'")
    parser.add_argument(
        "--case",
        metavar="CASE|ROBOT",
        help="with --plan: its robot and workspace, to check torques, clearances and tool speed again",
    )
    parser.add_argument("--no-log-quality", action="store_true", help="do not examine the logs of the fit again")
    parser.add_argument(
        "--prove", action="store_true", help="simulate the model along the motion of a log, with MuJoCo where installed"
    )
    parser.add_argument(
        "--motion", metavar="LOG", help="with --prove: that log; default: the first test or training log of the fit"
    )
    output = parser.add_argument_group("output")
    output.add_argument("-o", "--output", metavar="FILE", default="report.html", help="default: report.html")
    output.add_argument("--figures", metavar="DIR", help="write each figure as a file into this folder as well")
    output.add_argument(
        "--format",
        metavar="NAME",
        help="of the figures: svg (default), pdf or png; the last two need dynident[figures]",
    )
    output.add_argument("--json", action="store_true", help="print one JSON object that lists what was written")
    output.add_argument("--quiet", action="store_true", help="no progress and no remarks")


def run(options: argparse.Namespace) -> int:
    """Run the command."""
    from dynident.actuators import is_actuators
    from dynident.cli import actuators, console, plans
    from dynident.identification.files.estimate_file import read_estimate
    from dynident.results.report.builder import parts_of, report_page

    if is_actuators(options.estimate):
        return actuators.report(options)
    _check(options)
    estimate = read_estimate(options.estimate)
    if options.case and not options.plan:
        raise BadOption("--case", options.case, "it goes with --plan, the motion that is to be checked again")
    beside = (*files_behind(estimate.provenance), options.plan or "", *plans.files_of(options.case))
    read = (options.estimate, *options.test, options.motion or "", *beside)
    check_outputs((options.output, options.figures), read)
    check_place(options.output)
    with console.progress(5, options.quiet or options.json) as progress:
        progress.step("reading the logs")
        subject = _subject(estimate, options, progress.step)
        progress.step("drawing")
        parts = parts_of(subject)
        write_atomically(options.output, report_page(subject, parts))
        figures = _figures(subject, parts, options, progress.step)
    if options.json:
        console.answer_json(_listed(subject, parts, figures, options))
        return 0
    causes = subject.verdict.causes
    if causes:
        console.remark(f"the estimate is not accepted: {causes[0].title}: {causes[0].evidence}", options.quiet)
    console.remark(f"wrote {options.output}", options.quiet)
    if options.figures:
        console.remark(f"wrote {len(figures)} figures into {options.figures}", options.quiet)
    return 0


def _check(options: argparse.Namespace) -> None:
    """Refuse options that do not go together, before anything is read.

    Raises:
        BadOption: ``--format`` without ``--figures``, ``--split`` without ``--test``, ``--motion`` without ``--prove``.
        UnknownChoice: No such format of figures.
    """
    from dynident.results.figures.files import FORMATS

    if options.format and not options.figures:
        raise BadOption("--format", options.format, "it goes with --figures DIR, the folder of the figures")
    if options.format and options.format not in FORMATS:
        raise UnknownChoice("figure format", options.format, FORMATS)
    if options.motion and not options.prove:
        raise BadOption("--motion", options.motion, "it goes with --prove")
    if options.split and not options.test:
        raise BadOption("--split", options.split, "it goes with --test LOG, the log of which it takes the test part")


def _subject(estimate: Estimate, options: argparse.Namespace, progress: Callable[[str], None]) -> Subject:
    """Return what the report is about: the estimate with its tests, the findings on its logs, the plan."""
    from dynident.api.validate import compared
    from dynident.cli.origin import origin_of
    from dynident.results.report.subject import Subject

    origin = origin_of(estimate)
    logs = _given(estimate, options) if options.test else list(origin.held_out)
    progress("validating")
    tests = (compared(estimate, logs),) if logs else ()
    quality: list[dict[str, Any]] = []
    if not (options.no_log_quality or estimate.provenance.get("log_quality")):
        progress("looking at the logs")
        quality = origin.log_quality()
    motion = None
    if options.prove:
        from dynident.exports.models.proving.motion_proof import prove_motion  # loads the simulator

        progress("simulating")
        motion = prove_motion(estimate, proving.motion_of(estimate, options))
    return Subject(
        estimate,
        tests,
        motion=motion,
        command=jobs.repeat_command(),
        sources=tuple(log.source for log in logs),
        plan=plans.plan_view(options.plan, options.case, robot=estimate.model.robot) if options.plan else None,
        log_quality=tuple(quality),
        why_no_test="" if logs else origin.why_not,
    )


def _given(estimate: Estimate, options: argparse.Namespace) -> list[Log]:
    """Return the logs of the command line, or the test part of each; none that the fit has seen."""
    from dynident.api.case_logs import check_unseen
    from dynident.api.validate import read_log
    from dynident.data.split import Split

    logs = [read_log(estimate, name) for name in options.test]
    if options.split:
        split = Split.parse(options.split)
        return [split.apply(log)[1] for log in logs]
    check_unseen(estimate, logs)
    return logs


def _figures(
    subject: Subject, parts: tuple[ReportPart, ...], options: argparse.Namespace, progress: Callable[[str], None]
) -> tuple[Path, ...]:
    """Write the figures where that is asked for, and return their files."""
    from dynident.results.report.figure_files import report_figures, write_figures

    if not options.figures:
        return ()
    progress("writing the figures")
    return write_figures(options.figures, report_figures(subject, parts), options.format or "svg")


def _listed(
    subject: Subject, parts: tuple[ReportPart, ...], figures: tuple[Path, ...], options: argparse.Namespace
) -> dict[str, Any]:
    """Return what was written, as plain data."""
    return {
        "report": options.output,
        "robot": subject.estimate.model.robot.name,
        "sections": [part.name for part in parts],
        "tests": [
            {"logs": list(test.logs), "relative_error": _number(test.total_relative_error)} for test in subject.tests
        ],
        "why_no_test": subject.why_no_test,
        "figures": [str(path) for path in figures],
    }


def _number(value: float) -> float | None:
    from math import isfinite

    return float(value) if isfinite(value) else None
