"""Validate an estimate on test logs, preprocessed as in training.

dynident validate estimate.json other-run.csv --report report.html
dynident validate estimate.json other-run.csv --accept total_error=5% better_than_nominal
dynident validate estimate.json run.mcap --case bag.yaml

Of actuators (a case with servo:) the answer is the error of each roll-out, by default over the test logs of the case.

The answer takes one screen, the new logs first; --full shows all tables. Criteria are those of the identification and
of --accept, judged on these logs. Where the error is far beyond that of the training, or log_checks is a criterion, the
log checks look for the cause in these logs.
Exit codes: 0 accepted or no criteria, 1 an error of the input, 2 wrong usage, 3 criteria not met, 4 an error-level
finding in these logs or the training's, or worse than a constant torque at most joints, 130 interrupted.
"""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from dynident.cli import console, verdicts
from dynident.cli.jobs import add_accept, add_log_case
from dynident.errors import BadOption
from dynident.files import check_outputs, check_place, files_behind

if TYPE_CHECKING:
    from collections.abc import Sequence

    from dynident.diagnosis.verdict import Verdict
    from dynident.identification.estimate.estimate import Estimate
    from dynident.identification.estimate.validation import Validation

SUMMARY = "validate an estimate on test logs"


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument("estimate", metavar="ESTIMATE", help="file that 'dynident identify -o' has written")
    text = "logs to compare with; of actuators none is needed"
    logs = parser.add_argument("logs", nargs="+", default=[], metavar="LOG", help=text)
    logs.required = False  # of actuators they are those of the case
    add_log_case(parser)
    add_accept(parser)
    parser.add_argument("--split", metavar="HOW", help="use only the test part of each log: first:0.67 or samples:...")
    parser.add_argument("--report", metavar="FILE", help="write the report (one HTML file) here")
    parser.add_argument("--full", action="store_true", help="show all tables: also samples in motion, correlation, R2")
    parser.add_argument("--json", action="store_true", help="print one JSON object instead of tables")
    parser.add_argument("--quiet", action="store_true", help="no progress and no remarks")


def run(options: argparse.Namespace) -> int:
    """Run the command."""
    from dynident.actuators import is_actuators
    from dynident.api.case_logs import check_unseen, seen_logs
    from dynident.api.estimate_output import summary
    from dynident.api.validate import compared, judged_logs, read_log
    from dynident.case.acceptance import Acceptance, with_accept
    from dynident.cli import actuators, console, jobs, verdicts
    from dynident.data.split import Split
    from dynident.diagnosis.verdict import verdict_of
    from dynident.diagnosis.warnings import warnings_of
    from dynident.identification.files.estimate_file import read_estimate

    if is_actuators(options.estimate):
        return actuators.validate(options)
    if not options.logs:
        raise BadOption("LOG", None, "name the logs to compare with")
    if options.report:
        check_place(options.report)
    with console.progress(3, options.quiet or options.json) as progress:
        progress.step("reading")
        estimate = read_estimate(options.estimate)
        check_outputs((options.report,), (options.estimate, *options.logs, *files_behind(estimate.provenance)))
        acceptance = with_accept(Acceptance(estimate.provenance.get("accept") or {}), options.accept)
        case = jobs.log_case(options)
        logs = [read_log(estimate, name, case) for name in options.logs]
        seen = [] if options.split else seen_logs(estimate, logs)
        if options.report and seen:
            check_unseen(estimate, logs)
        if options.split:
            split = Split.parse(options.split)
            logs = [split.apply(log)[1] for log in logs]
        progress.step("validating")
        test = compared(estimate, logs)
        new = judged_logs(estimate, test, logs, case, options.estimate, acceptance, progress.step)
        if options.report:
            from dynident.results.report import write_report

            progress.step("writing the report")
            sources = [log.source for log in logs]
            write_report(options.report, estimate, (test,), command=jobs.repeat_command(), sources=sources)
    optimistic = [f"{name}: this log was used for training, so its metrics are optimistic" for name in seen]
    warnings = [*optimistic, *warnings_of(estimate, test, new)]
    verdict = verdict_of(estimate, test, acceptance, is_held_out=not seen, new=new)
    if options.json:
        console.answer_json(summary(estimate, test, verdict, warnings))
        return verdict.code
    if options.full:
        _show(estimate, test, verdict, warnings)
    else:
        verdicts.show_short(estimate, test, verdict)
        for name in optimistic:
            console.answer(f"warning: {name}")
    console.remark(verdicts.next_step(options.estimate, estimate, verdict), options.quiet)
    return verdict.code


def _show(estimate: Estimate, test: Validation, verdict: Verdict, warnings: Sequence[str]) -> None:
    """Print the verdict, all tables of the comparison and the warnings."""
    from dynident.cli.identify import consistency_line
    from dynident.results.text import fits_table, in_words, total_error

    verdicts.show(verdict)
    console.answer(f"{estimate.model.robot.name}: estimator {estimate.estimator}, {test.samples} samples")
    console.answer(f"filter {in_words(test.filter)}\n")
    console.answer_table(fits_table(test), f"total relative error {total_error(test)}")
    console.answer()
    console.answer_table(fits_table(test, moving=True), "moving samples only")
    verdicts.show_rest(test)
    verdicts.show_nominal(estimate, test)
    console.answer()
    console.answer(consistency_line(estimate))
    for warning in warnings:
        console.answer(f"warning: {warning}")
