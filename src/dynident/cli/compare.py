"""Compare estimators on one problem by their error on test logs.

Logs are read, preprocessed and compressed to QR factors once; each estimator starts from there with its default
options, or with those that are named. The order is that of the error on the test logs. A method that fails is a line
of the table with its reason. Each is told as it ends: of all, first those that solve at once, last those that
simulate or search a box, which take most of the time ('quick' leaves them out). Ctrl-C shows the table of those that
are done. The log checks look at the training logs first: the exit code is 4 after a finding at error level, which
stands above the table.

  dynident compare case.yaml                            all estimators; test part as in the case file
  dynident compare case.yaml a.csv --test b.csv --estimators wls,consistent,huber,huber:bound=2
  dynident compare case.yaml --estimators all,abc:iterations=4000 --time-limit 120 --jobs 2 --report page.html
"""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

from dynident.cli import console, jobs, verdicts
from dynident.cli.jobs import add_case_options, repeat_command
from dynident.errors import SolverFailed
from dynident.files import check_outputs, check_place

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from dynident.api.case_logs import CaseData
    from dynident.case.case import Case
    from dynident.cli.console import Progress
    from dynident.studies.comparison.contest import Contest, Method, Outcome

SUMMARY = "many estimators on one problem, by their error on unseen logs"

#: Options in the short help.
FREQUENT = ("--test", "--estimators", "--split", "--time-limit", "--jobs", "--report", "--json")

#: Held-out error of a stated truth over that of the best method from which it is not what made the logs.
NOT_THE_TRUTH = 1.5


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument("case", metavar="CASE|ROBOT", help="case file or robot model")
    parser.add_argument("logs", nargs="*", metavar="LOG", help="logs to learn from; default: those of the case file")
    parser.add_argument("--test", nargs="+", default=[], metavar="LOG", help="logs to test on, not used in the fit")
    method = parser.add_argument_group("estimators")
    method.add_argument(
        "--estimators",
        default="all",
        metavar="NAMES",
        help="all (default), quick (without those that simulate or search a box), or names with commas between them; "
        "options behind a name as NAME:KEY=VALUE:KEY=VALUE",
    )
    method.add_argument("--seed", type=int, metavar="N", help="seed of the methods that are random; default: their own")
    method.add_argument("--time-limit", type=float, metavar="S", help="wall-clock time of a method; it fails after it")
    method.add_argument(
        "--jobs",
        type=int,
        metavar="N",
        help="methods that run side by side; default: one a processor of those that simulate or search a box, else 1",
    )
    known = parser.add_argument_group("what is known beforehand (a case file states prior and constraints for good)")
    known.add_argument("--prior", metavar="FILE", help="robot model or estimate whose inertias are the prior")
    known.add_argument("--constraints", metavar="FILE", help="masses, centres, hulls: YAML as in the case file")
    known.add_argument(
        "--truth",
        metavar="FILE",
        help="truth that simulate wrote, robot model or estimate of the virtual robot: adds the parameter error",
    )
    add_case_options(parser)
    checks = parser.add_argument_group("diagnostics")
    checks.add_argument("--no-check", action="store_true", help="skip the log checks of the training logs")
    output = parser.add_argument_group("output")
    output.add_argument("--report", metavar="FILE", help="write the report (one HTML file) here")
    output.add_argument("--json", action="store_true", help="print one JSON object instead of tables")
    output.add_argument("--quiet", action="store_true", help="no progress and no remarks")


def run(options: argparse.Namespace) -> int:
    """Run the command."""
    from dynident.api.case_logs import read_data
    from dynident.api.case_options import with_drive_friction
    from dynident.api.compare import contest_of_case, methods_of
    from dynident.api.log_checks import check_logs, refuse_faulty
    from dynident.diagnosis.verdict import Verdict, check_lines, errors_in
    from dynident.studies.comparison.compare import ranked

    if options.report:
        check_place(options.report)
    case = jobs.case_from(options)
    case = case if options.friction else with_drive_friction(case)
    methods = methods_of(case, options.estimators, options.seed)
    outcomes: list[Outcome] = []
    with console.progress(6 + len(methods), options.quiet or options.json) as progress:
        progress.step("reading")
        inputs = (options.case, options.truth or "", *case.files)
        case = jobs.with_logs(case, options)
        check_outputs((options.report,), (*inputs, *case.files))
        data = read_data(case)
        quality = [] if options.no_check else check_logs(case, data.train, progress.step)
        refuse_faulty(quality)
        contest = contest_of_case(case, data, truth=options.truth, progress=progress.step)
        stopped = _solve(contest, methods, options, progress, outcomes)
        table = ranked(outcomes)
        if options.report and not stopped:
            progress.step("writing the report")
            _report(options.report, case, table, data, quality)
    verdict = Verdict(errors_in(quality), (), not options.no_check)
    if options.json:
        warnings = check_lines(quality)
        console.answer_json({"verdict": verdict.figures(), "warnings": warnings, **_figures(contest, table, stopped)})
    else:
        verdicts.show(verdict)
        _show(contest, table)
        for warning in check_lines(quality):
            console.answer(f"warning: {warning}")
    if stopped:
        console.remark(f"stopped: {len(outcomes)} of {len(methods)} methods done")
        return 130
    return verdict.code


def _solve(
    contest: Contest, methods: Sequence[Method], options: Any, progress: Progress, outcomes: list[Outcome]
) -> bool:
    """Fill in the outcomes as they come; return whether the user has broken it off."""
    from dynident.api.compare import jobs_that_pay
    from dynident.results.text import format_number
    from dynident.studies.comparison.compare import compare
    from dynident.studies.comparison.comparison_view import percent

    of = "test error" if contest.tests else "training error"
    try:
        progress.step("weighted least squares, the reference")
        _ = contest.least
        limit, jobs = options.time_limit, jobs_that_pay(methods) if options.jobs is None else options.jobs
        for outcome in compare(contest, methods, time_limit=limit, jobs=jobs, progress=progress.step):
            outcomes.append(outcome)
            told = f"{of} {percent(outcome.figure)}" if outcome.estimate is not None else outcome.failure
            progress.line(f"{outcome.method}: {told}, {format_number(outcome.seconds, 2)} s")
    except KeyboardInterrupt:
        return True
    return False


def _report(
    place: str, case: Case, table: Sequence[Outcome], data: CaseData, quality: Sequence[Mapping[str, Any]]
) -> None:
    """Write the report about the case's estimator: the best of the table is chosen by what it would be tested on."""
    from dataclasses import replace

    from dynident.results.report import write_report
    from dynident.studies.comparison.comparison_view import comparison_of

    solved = [outcome for outcome in table if outcome.estimate is not None]
    if not solved:
        raise SolverFailed("the comparison", "every method failed", "look at the table without --report")
    own = [outcome for outcome in solved if outcome.method.partition(":")[0] == case.estimator.name]
    chosen = (own or solved)[0]
    assert chosen.estimate is not None
    facts = {"log_quality": quality} if quality else {}
    write_report(
        place,
        replace(chosen.estimate, provenance={**chosen.estimate.provenance, **facts}),
        () if chosen.test is None else (chosen.test,),
        comparison=comparison_of(table),
        command=repeat_command(),
        sources=[log.source for log in data.test],
    )


def _figures(contest: Contest, table: Sequence[Outcome], stopped: bool) -> dict[str, Any]:
    from dynident.arrays import finite, plain

    problem = contest.problem
    return {
        "robot": problem.model.robot.name,
        "samples": problem.samples,
        "test_samples": sum(len(log.keep) for log in contest.tests),
        "filter": plain(problem.logs[0].statement()),
        "base_parameters": [
            {"name": name, "unit": unit} for name, unit in zip(problem.base.names, problem.base.units, strict=True)
        ],
        "truth_error": None if contest.truth_error is None else finite(contest.truth_error),
        "methods": [_with_rank(outcome, table) for outcome in table],
        "stopped": stopped,
        "command": repeat_command(),
    }


def _with_rank(outcome: Outcome, table: Sequence[Outcome]) -> dict[str, Any]:
    from dynident.studies.comparison.contest import like_the_best

    best = table[0].test
    same = None if outcome.test is None or best is None else like_the_best(outcome.test, best)
    return {**outcome.figures(), "as_the_best": same}


def _show(contest: Contest, table: Sequence[Outcome]) -> None:
    from dynident.results.text import comparison_table, in_words
    from dynident.studies.comparison.comparison_view import comparison_rows, percent

    problem = contest.problem
    tested = sum(len(log.keep) for log in contest.tests)
    console.answer(
        f"{problem.model.robot.name}: {problem.model.robot.dof} joints, {problem.base.count} base parameters, "
        f"{problem.samples} samples, {tested} to test on"
    )
    console.answer(f"filter {in_words(problem.logs[0].statement())}\n")
    if table:
        rows = [{key: cell for key, cell in row.items() if key != "remark"} for row in comparison_rows(table)]
        console.answer_table(comparison_table(rows))
        console.answer()
    for outcome in table:
        if outcome.failure or outcome.verdict:
            console.answer(f"{outcome.method}: {outcome.failure or outcome.verdict}")
    if contest.truth_error is not None:
        far = bool(table) and contest.truth_error > NOT_THE_TRUTH * table[0].figure
        lacking = "these logs do not fit the given truth (friction that a robot model does not state counts as zero)"
        meaning = lacking if far else "that is noise"
        console.answer(f"the known truth has a test error of {percent(contest.truth_error)}: {meaning}")
    if not contest.tests:
        console.answer(
            "no test logs: the order is that of the training error, which is optimistic for flexible methods"
        )
