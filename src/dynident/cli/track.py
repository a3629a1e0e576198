"""Follow the parameters of a robot along a log: friction that drifts, loads and friction that change at once.

The parameters go with the last --memory seconds and, where the motion shows nothing, back to the estimate. The last
--window seconds are compared with what was before them: a load on the last link, or other friction of a joint, is named
with its time; of clean runs, by default the logs of the fit, at most --rate an hour raise such an alarm falsely. The
log is filtered as those of the fit, to both sides; rows of a running robot go into dynident.applications.tracking. The
exit code is 1 where something has changed at once.

  dynident track estimate.json shift.csv -o course.csv
  dynident track estimate.json run.csv --clean monday.csv tuesday.csv --rate 0.1 --json
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from typing import TYPE_CHECKING

from dynident.cli import console, jobs
from dynident.cli.jobs import add_log_case
from dynident.files import check_outputs, check_place, files_behind, write_atomically

if TYPE_CHECKING:
    from dynident.applications.tracking import Tracked
    from dynident.identification.estimate.estimate import Estimate

SUMMARY = "parameters that drift along a log, and loads that change"

#: Parameters that the table on the terminal shows.
SHOWN = 12


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument("estimate", metavar="ESTIMATE", help="file that 'dynident identify -o' has written")
    parser.add_argument("log", metavar="LOG", help="log to follow")
    parser.add_argument("--clean", nargs="+", metavar="LOG", help="logs without a change; default: those of the fit")
    add_log_case(parser)
    parser.add_argument("--rate", type=float, default=1.0, metavar="N", help="false alarms an hour at most (1)")
    parser.add_argument("--memory", type=float, default=10.0, metavar="S", help="after which a row counts 1 / e (10)")
    parser.add_argument("--window", type=float, default=1.0, metavar="S", help="in which changes are looked for (1)")
    parser.add_argument(
        "--loosen", type=float, default=30.0, metavar="X", help="parameters may leave the estimate by X deviations (30)"
    )
    parser.add_argument("-o", "--output", metavar="FILE", help="write the parameters over time (CSV) here")
    parser.add_argument("--json", action="store_true", help="print one JSON object instead of tables")
    parser.add_argument("--quiet", action="store_true", help="no progress and no remarks")


def run(options: argparse.Namespace) -> int:
    """Run the command."""
    from dynident.api.applications import logs_of_fit, track
    from dynident.applications.tracking import Pace
    from dynident.identification.files.estimate_file import read_estimate

    pace = Pace(options.memory, options.window, options.loosen)
    if options.output:
        check_place(options.output)
    with console.progress(3, options.quiet or options.json) as progress:
        progress.step("reading")
        estimate = read_estimate(options.estimate)
        names = options.clean or logs_of_fit(estimate)
        if options.output:
            inputs = (options.estimate, options.log, *names, *files_behind(estimate.provenance))
            check_outputs((options.output,), inputs)
        followed = track(
            estimate,
            options.log,
            clean=options.clean,
            rate=options.rate,
            pace=pace,
            case=jobs.log_case(options),
            progress=progress.step,
        )
    found, seconds = followed.found, followed.clean_seconds
    if options.output:
        write_atomically(options.output, _csv(estimate, found))
    if options.json:
        told = {"clean": list(names), "clean_seconds": seconds, "false_alarms_an_hour": options.rate}
        console.answer_json({**found.figures(estimate), **told})
    else:
        _show(estimate, found, names, seconds)
    if options.output:
        console.remark(f"saved {options.output}", options.quiet or options.json)
    return 1 if found.events else 0


def _csv(estimate: Estimate, found: Tracked) -> str:
    """Return time, each base parameter and half of its 95 % interval."""
    import csv
    import io

    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    units = zip(estimate.base.names, estimate.base.units, strict=True)
    heads = [f"{name} [{unit}]" for name, unit in units]
    writer.writerow(["t", *heads, *(f"half {head}" for head in heads)])
    for time, beta, half in zip(found.time, found.beta, found.half_widths(), strict=True):
        writer.writerow([f"{time:.6f}", *(f"{value:.9g}" for value in (*beta, *half))])
    return text.getvalue()


def _show(estimate: Estimate, found: Tracked, clean: Sequence[str], seconds: float) -> None:
    from dynident.results.text import Table, columns_of, format_number, format_value, label, pretty_unit
    from dynident.results.text import shorten as shortened

    figures = found.figures(estimate)
    console.answer(
        f"{label(found.log)}: {figures['seconds']:.4g} s followed, thresholds from {seconds:.4g} s of clean runs\n"
    )
    told = sorted(figures["parameters"], key=lambda one: -abs(one["t"] or 0.0))[:SHOWN]
    heads = columns_of("base parameter", ">estimate", ">at the end", ">std", ">moved by [std]", "unit")
    rows = []
    for one in told:
        value, std = format_value(one["value"], one["std"])
        name = shortened(label(one["name"]), console.NAME_WIDTH)
        moved = format_number(one["t"] or 0.0, 2)
        rows.append((name, format_number(one["estimate"], 4), value, std, moved, pretty_unit(one["unit"])))
    console.answer_table(Table(heads, tuple(rows)))
    if len(told) < len(figures["parameters"]):
        console.answer(f"... and {len(figures['parameters']) - len(told)} that moved less; --json has all")
    if below := found.no_friction(estimate):
        names = ", ".join(map(label, below))
        console.answer(f"below zero, which no friction is: {names}; another change shows in it, such as a load")
    console.answer()
    for event in found.events:
        mass = ""
        if event.mass is not None:
            value, half = event.mass[0], 1.96 * event.mass[1]
            mass = f", {value:+.3g} kg +- {half:.2g}"
        console.answer(
            f"change: {label(event.change.name)} at {event.time:.4g} s{mass} (square {event.evidence.square:.4g} "
            f"against {event.threshold:.4g})"
        )
    if not found.events:
        console.answer("nothing changed at once")
