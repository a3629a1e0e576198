"""Validate an estimate on test logs, preprocessed as in training.

dynident validate estimate.json other-run.csv
dynident validate estimate.json other-run.csv --json --report report.html
"""

from __future__ import annotations

import argparse

SUMMARY = "validate an estimate on test logs"


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument("estimate", metavar="ESTIMATE", help="file that 'dynident identify -o' has written")
    parser.add_argument("logs", nargs="+", metavar="LOG", help="logs to compare with")
    parser.add_argument("--split", metavar="HOW", help="use only the test part of each log: first:0.67 or rows:...")
    parser.add_argument("--report", metavar="FILE", help="write the report (one HTML file) here")
    parser.add_argument("--json", action="store_true", help="print one JSON object instead of tables")
    parser.add_argument("--quiet", action="store_true", help="no progress and no remarks")


def run(options: argparse.Namespace) -> int:
    """Run the command."""
    from dynident.api.case_logs import check_unseen, seen_logs
    from dynident.api.estimate_output import files_behind
    from dynident.api.validate import read_log, validate
    from dynident.cli import console, jobs
    from dynident.cli.identify import consistency_line
    from dynident.data.split import Split
    from dynident.diagnosis.warnings import warnings_of
    from dynident.files import check_outputs, check_place
    from dynident.identification.files.estimate_file import read_estimate, summary
    from dynident.results.text import fits_table, statement, total_error

    if options.report:
        check_place(options.report)
    with console.progress(3, options.quiet or options.json) as progress:
        progress.step("reading")
        estimate = read_estimate(options.estimate)
        check_outputs((options.report,), (options.estimate, *options.logs, *files_behind(estimate)))
        logs = [read_log(estimate, name) for name in options.logs]
        seen = [] if options.split else seen_logs(estimate, logs)
        if options.report and seen:
            check_unseen(estimate, logs)
        if options.split:
            split = Split.parse(options.split)
            logs = [split.apply(log)[1] for log in logs]
        progress.step("validating")
        test = validate(estimate, logs)
        if options.report:
            from dynident.results.report import write_report

            progress.step("writing the report")
            sources = [log.source for log in logs]
            write_report(options.report, estimate, (test,), command=jobs.repeat_command(), sources=sources)
    warnings = [f"{name}: this log was used for training, so its metrics are optimistic" for name in seen]
    warnings += warnings_of(estimate, test)
    if options.json:
        console.answer_json(summary(estimate, test, warnings))
        return 0
    console.answer(f"{estimate.model.robot.name}: estimator {estimate.estimator}, {test.samples} samples")
    console.answer(f"filter {statement(test.filter)}\n")
    console.answer_table(fits_table(test), f"total relative error {total_error(test)}")
    console.answer()
    console.answer_table(fits_table(test, moving=True), "moving samples only")
    console.answer()
    console.answer(consistency_line(estimate))
    for warning in warnings:
        console.answer(f"warning: {warning}")
    return 0
