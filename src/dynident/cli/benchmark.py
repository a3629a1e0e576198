"""Compare estimators where the truth is known, over noise, seeds and initial guesses; or on real logs.

NAME is a benchmark that ships or a file like it (docs/benchmark.md). Every result is kept in the folder --out as soon
as it is there: the same command goes on where it was stopped, even by kill -9, and nothing is computed twice.

  dynident benchmark tx40 --quick
  dynident benchmark tx40 --jobs 4 --out tx40 --html tx40.html
  dynident benchmark mine.yaml --draws 100 --methods wls,consistent

--real FOLDER runs every estimator on every set and split of the case files in a folder, with published figures of the
same sets beside ours where the folder's scoreboard.yml states them:

  DYNIDENT_DATA=... dynident benchmark --real examples/cases
"""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

from dynident.cli import console, jobs
from dynident.cli.jobs import add_pool_option, cluster_of
from dynident.errors import BadOption, FileError
from dynident.files import check_place

if TYPE_CHECKING:
    from collections.abc import Sequence

    from dynident.studies.benchmark.experiment import Experiment
    from dynident.studies.benchmark.page import Result
    from dynident.studies.benchmark.real_sets import Scoreboard
    from dynident.studies.benchmark.runner import Records
    from dynident.studies.benchmark.summary import MethodRow
    from dynident.studies.comparison.contest import Method
    from dynident.workers.processes import Pool

SUMMARY = "estimators where the truth is known, or on every real set"

#: Options in the short help.
FREQUENT = ("--real", "--quick", "--methods", "--out", "--jobs", "--html", "--json")


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument("name", nargs="?", metavar="NAME|FILE", help="benchmark that ships, such as tx40, or a file")
    parser.add_argument("--real", metavar="FOLDER", help="a folder of case files, in place of NAME")
    what = parser.add_argument_group("what is done")
    what.add_argument("--quick", action="store_true", help="the short form that the benchmark states")
    what.add_argument("--draws", type=int, metavar="N", help="logs of each condition; default: those of the benchmark")
    what.add_argument(
        "--methods", metavar="NAMES", help="with commas between them; default: all of the benchmark, or all estimators"
    )
    how = parser.add_argument_group("how")
    how.add_argument("--out", metavar="DIR", help="folder that keeps the results; default: dynident-benchmark-NAME")
    how.add_argument("--jobs", type=int, default=1, metavar="N", help="processes side by side; default 1: times count")
    add_pool_option(how)
    how.add_argument(
        "--time-limit", type=float, metavar="S", help="wall-clock time of a task; it fails after it; default: none"
    )
    how.add_argument(
        "--processor-limit",
        type=float,
        metavar="S",
        help="the same of its processor time, whatever else the machine does; in processes of this machine",
    )
    output = parser.add_argument_group("output")
    output.add_argument("--html", metavar="FILE", help="write one self-contained page here")
    output.add_argument("--json", action="store_true", help="print one JSON object instead of tables")
    output.add_argument("--quiet", action="store_true", help="no progress and no remarks")


def run(options: argparse.Namespace) -> int:
    """Run the command."""
    if (options.name is None) == (options.real is None):
        from dynident.studies.benchmark.experiment import shipped_benchmarks

        step = f"give a benchmark ({', '.join(shipped_benchmarks())}, or a file), or --real FOLDER"
        raise BadOption("NAME", options.name or "", step)
    if options.html:
        check_place(options.html)
    if options.real is not None and options.scheduler is not None:
        step = "its sets are files of this machine; --jobs does them in processes"
        raise BadOption("--scheduler", options.scheduler, step)
    return _virtual(options) if options.real is None else _real(options)


def _virtual(options: argparse.Namespace) -> int:
    from dynident.studies.benchmark.experiment import read_experiment
    from dynident.studies.benchmark.page import write_benchmark_page
    from dynident.studies.benchmark.runner import Records
    from dynident.studies.benchmark.summary import summary_of
    from dynident.studies.benchmark.virtual_tasks import VirtualWork, motions_of

    methods = None if options.methods is None else [name.strip() for name in options.methods.split(",")]
    experiment = read_experiment(options.name, quick=options.quick, draws=options.draws, methods=methods)
    records = Records(options.out or f"dynident-benchmark-{experiment.path.stem}")
    quiet = options.quiet or options.json
    pool = cluster_of(options)
    with console.progress(1, quiet) as designing:
        motions = motions_of(experiment, records.folder, designing.step)
    work = VirtualWork(experiment, motions)
    tasks = work.tasks()
    results, stopped = _done(work, tasks, records, options, pool)
    rows = summary_of(results)
    if options.html and rows:
        write_benchmark_page(options.html, experiment, rows, jobs.repeat_command())
    if options.json:
        console.answer_json(_figures(experiment, rows, len(results), len(tasks)))
    else:
        _show(experiment, rows)
        console.remark(f"{len(results)} of {len(tasks)} tasks; kept in {records.folder}", options.quiet)
    return _ended(stopped, len(results), len(tasks))


def _done(
    work: Any, tasks: Sequence[Any], records: Records, options: argparse.Namespace, pool: Pool | None = None
) -> tuple[list[Any], bool]:
    """Return the tasks that were done with their results, and whether Ctrl-C has ended the run."""
    from dynident.studies.benchmark.runner import run_tasks

    found: list[Any] = []
    with console.progress(len(tasks), options.quiet or options.json) as progress:
        try:
            for each in run_tasks(
                work,
                tasks,
                records,
                jobs=options.jobs,
                time_limit=options.time_limit,
                processor_limit=options.processor_limit,
                pool=pool,
                progress=progress.step,
            ):
                found.append(each)
        except KeyboardInterrupt:
            return found, True
    return found, False


def _ended(stopped: bool, done: int, total: int) -> int:
    """Return the exit code, and say where Ctrl-C has ended the run."""
    if stopped:
        console.remark(f"stopped: {done} of {total} tasks done")
    return 130 if stopped else 0


def _figures(experiment: Experiment, rows: tuple[MethodRow, ...], done: int, total: int) -> dict[str, Any]:
    return {
        "benchmark": experiment.title,
        "tasks": total,
        "done": done,
        "draws": experiment.draws,
        "rows": [row.figures() for row in rows],
        "command": jobs.repeat_command(),
    }


def _show(experiment: Experiment, rows: tuple[MethodRow, ...]) -> None:
    from dynident.results.text import counted, label
    from dynident.studies.benchmark import page

    console.answer(f"{label(experiment.title)}: {counted(experiment.draws, 'draw')} of each condition")
    console.answer(page.NOTE)
    for name, found in page.by_condition(rows, experiment).items():
        console.answer()
        console.answer_table(page.condition_table(found), name)
    for line in page.failure_lines(rows):
        console.answer(line)


def _real(options: argparse.Namespace) -> int:
    from dynident.studies.benchmark.page import write_scoreboard_page
    from dynident.studies.benchmark.real_sets import RealWork, read_scoreboard
    from dynident.studies.benchmark.runner import Records

    for name in ("quick", "draws"):
        if getattr(options, name):
            raise BadOption(f"--{name}", getattr(options, name), "it does not go with --real")
    board = read_scoreboard(options.real)
    work = RealWork({each.name: each for each in board.sets})
    tasks = work.tasks(_estimators(options.methods or "all"))
    missing = [each for each in board.sets if each.missing]
    if not tasks:
        step = "name the folder with the logs in DYNIDENT_DATA"
        raise FileError(missing[0].missing[0], "there is no such file, and so it is for every set", step)
    records = Records(options.out or "dynident-benchmark-real")
    done, stopped = _done(work, tasks, records, options)
    results = [(task.name, task.method.label, result) for task, result in done]
    if options.html:
        write_scoreboard_page(options.html, board, results, jobs.repeat_command())
    if options.json:
        console.answer_json(_real_figures(board, results, len(tasks)))
    else:
        _show_real(board, results)
    for each in missing:
        console.remark(f"left out: {each.name}; there is no {each.missing[0]}", options.json)
    return _ended(stopped, len(results), len(tasks))


def _estimators(text: str) -> list[Method]:
    """Return the methods that a text names, with their default options."""
    from dynident.api.compare import methods_of
    from dynident.case.case import case_of_robot

    return methods_of(case_of_robot("er16"), text)


def _real_figures(board: Scoreboard, results: list[Result], total: int) -> dict[str, Any]:
    from dataclasses import asdict

    return {
        "tasks": total,
        "done": len(results),
        "sets": [
            {
                "name": each.name,
                "missing": list(each.missing),
                "methods": [{**result, "method": method} for name, method, result in results if name == each.name],
                "published": [asdict(figure) for figure in board.published if figure.set == each.name],
            }
            for each in board.sets
        ],
        "command": jobs.repeat_command(),
    }


def _show_real(board: Scoreboard, results: list[Result]) -> None:
    from dynident.studies.benchmark import page as view

    table = view.scoreboard_table(board, results)
    console.answer_table(table, table.note)
    console.answer()
    for line in view.best_of_sets(board, results):
        console.answer(line)
