"""Write the report of an estimate: one HTML file that opens offline.

dynident report estimate.json -o report.html
dynident report estimate.json --test other-run.csv -o report.html
dynident report estimate.json --plan plan.json --case case.yaml -o report.html
"""

from __future__ import annotations

import argparse

SUMMARY = "one self-contained HTML file from an estimate"


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument("estimate", metavar="ESTIMATE", help="file that 'dynident identify -o' has written")
    parser.add_argument("--test", nargs="+", default=[], metavar="LOG", help="logs to validate on")
    parser.add_argument("--plan", metavar="PLAN", help="add the designed motion, a file of 'dynident excite -o'")
    parser.add_argument(
        "--case",
        metavar="CASE|ROBOT",
        help="with --plan: its robot and workspace, to check torques, clearances and tool speed again",
    )
    parser.add_argument("-o", "--output", metavar="FILE", default="report.html", help="default: report.html")
    parser.add_argument("--quiet", action="store_true", help="no remarks")


def run(options: argparse.Namespace) -> int:
    """Run the command."""
    from dynident.cli import console, jobs, plans
    from dynident.errors import BadOption
    from dynident.estimation.estimate_file import read_estimate
    from dynident.estimation.identify import validate
    from dynident.experiment.case_file.case import read_with
    from dynident.results.report import write_report

    estimate = read_estimate(options.estimate)
    if options.case and not options.plan:
        raise BadOption("--case", options.case, "it goes with --plan, the motion that is to be checked again")
    beside = (*jobs.files_behind(estimate), options.plan or "", *plans.files_of(options.case))
    jobs.check_outputs((options.output,), (options.estimate, *options.test, *beside))
    logs = [read_with(name, estimate.columns, estimate.model.robot) for name in options.test]
    jobs.check_unseen(estimate, logs)
    tests = (validate(estimate, logs),) if logs else ()
    sources = [log.source for log in logs]
    plan = plans.plan_view(options.plan, options.case, robot=estimate.model.robot) if options.plan else None
    write_report(options.output, estimate, tests, command=jobs.repeat_command(), sources=sources, plan=plan)
    console.remark(f"wrote {options.output}", options.quiet)
    return 0
