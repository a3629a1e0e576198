"""Look for collisions in a log: torques from outside by a momentum observer, alarms at a chosen rate of false ones.

Thresholds come from clean runs, by default the logs of the fit: per joint the torque band of the estimate times a
factor, so that the observer's residual of clean runs rises above it --rate times an hour. Tails beyond the
range of the clean runs are extrapolated. Velocities and torques are used as a controller would have them: filters are
causal. The exit code is 1 where there is an alarm.

  dynident monitor estimate.json run.csv --rate 1
  dynident monitor estimate.json run.csv --clean monday.csv tuesday.csv --json
  record-the-robot | dynident monitor estimate.json - --clean monday.csv

The log - is a text on standard input that is still being written: a header and a line a sample, columns and units as
those of the fit, or of --case. Each alarm is printed as it begins; with --json each is one object on a line, and the
last line is the total.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING

from dynident.cli import console, jobs
from dynident.cli.jobs import add_log_case
from dynident.errors import BadOption

if TYPE_CHECKING:
    from dynident.applications.monitor import Monitor, Monitored
    from dynident.case.case import Case

#: Samples of a stream after which its rate is known.
_RATE_SAMPLES = 50

SUMMARY = "alarms where torques from outside exceed what clean runs show"


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument("estimate", metavar="ESTIMATE", help="file that 'dynident identify -o' has written")
    parser.add_argument("logs", nargs="+", metavar="LOG", help="logs to look at; - for standard input")
    add_log_case(parser)
    parser.add_argument("--clean", nargs="+", metavar="LOG", help="logs without contact; default: those of the fit")
    parser.add_argument(
        "--rate",
        default="1",
        metavar="N",
        help="false alarms an hour of each joint (1); or one number for each with commas between them",
    )
    parser.add_argument("--gain", type=float, default=50.0, metavar="1/S", help="how fast the observer follows (50)")
    parser.add_argument("--json", action="store_true", help="print one JSON object instead of tables")
    parser.add_argument("--quiet", action="store_true", help="no progress and no remarks")


def run(options: argparse.Namespace) -> int:
    """Run the command."""
    from dynident.api.applications import logs_of_fit, monitor
    from dynident.identification.files.estimate_file import read_estimate

    rates = _rates(options.rate)
    if "-" in options.logs and len(options.logs) > 1:
        raise BadOption("LOG", "-", "standard input is looked at alone: name no other log beside it")
    live = options.logs == ["-"]
    with console.progress(3, options.quiet or options.json) as progress:
        progress.step("reading")
        estimate = read_estimate(options.estimate)
        names = options.clean or logs_of_fit(estimate)
        wanted = rates if len(rates) > 1 else rates[0]
        logs = [] if live else options.logs
        case = jobs.log_case(options)
        found = monitor(
            estimate, logs, clean=options.clean, rates=wanted, gain=options.gain, case=case, progress=progress.step
        )
        if live:
            progress.stop()
            return _watch(found.monitor, options.json, case)
    if options.json:
        limits = found.monitor
        console.answer_json(
            {
                "factors": [float(one) for one in limits.factors],
                "false_alarms_an_hour": [3600.0 * float(rate) for rate in limits.rates],
                "clean": list(names),
                "gain": options.gain,
                "tails": [vars(tail) for tail in limits.tails],
                "logs": [one.figures() for one in found.logs],
            }
        )
    else:
        _show(found.monitor, found.logs, names)
    return 1 if any(one.alarms for one in found.logs) else 0


def _watch(monitor: Monitor, as_json: bool, case: Case | None) -> int:
    """Tell the alarms of standard input as they begin."""
    from dynident.api.validate import reading_of
    from dynident.applications.monitor import watch
    from dynident.results.text import counted, label

    names = monitor.observer.joint_names
    samples = alarms = starts = 0
    first = last = 0.0
    steps: list[float] = []
    held = [0.0] * len(names)
    columns, robot, _ = reading_of(monitor.observer.estimate, case)
    for reading in watch(monitor, sys.stdin, columns, robot):
        if 0 < samples <= _RATE_SAMPLES:
            steps.append(reading.time - last)
        first, last = (reading.time if samples == 0 else first), reading.time
        samples, starts = samples + 1, starts + reading.is_new
        held = [max(pair) for pair in zip(held, reading.held.tolist(), strict=True)]
        if samples == _RATE_SAMPLES and (told := monitor.other_rate(sorted(steps)[len(steps) // 2])):
            console.answer_line({"remark": told}) if as_json else console.answer(f"remark: {told}")
        for name in reading.alarms:
            j = names.index(name)
            alarms += 1
            size, threshold = float(reading.residual[j]), float(reading.threshold[j])
            if as_json:
                told = {"alarm": name, "time": reading.time, "torque": size, "threshold": threshold}
                console.answer_line(told)
            else:
                console.answer(f"alarm: {label(name)}, at {reading.time:.4f} s: {size:.4g} against {threshold:.4g}")
            sys.stdout.flush()
    if remark := _resting(monitor, held):
        console.answer_line({"remark": remark}) if as_json else console.answer(f"remark: {remark}")
    gaps = max(starts - 1, 0)
    if remark := _anew(gaps):
        console.answer_line({"remark": remark}) if as_json else console.answer(f"remark: {remark}")
    if as_json:
        console.answer_line({"samples": samples, "seconds": last - first, "alarms": alarms, "gaps": gaps})
    else:
        console.answer(f"{counted(alarms, 'alarm')} in {samples} samples, {last - first:.4g} s")
    return 1 if alarms else 0


def _resting(monitor: Monitor, held: Sequence[float]) -> str:
    """Return what is to be said of joints that rest, whose static friction holds so much at most; empty for nothing."""
    from dynident.results.text import format_number, label, pretty_unit

    model = monitor.observer.model
    robot = model.robot
    told = [
        f"{label(name)} {format_number(size, 3)} {pretty_unit(unit)}"
        for name, unit, size in zip(robot.joint_names, robot.units, held, strict=True)
        if size > 0.0
    ]
    start = ", and until presliding has moved on from the start," if any(part.lags for part in model.friction) else ""
    text = f"at rest{start} friction can hold a contact, which shows in no torque: thresholds are higher there by up to"
    return f"{text} {', '.join(told)}" if told else ""


def _anew(gaps: int) -> str:
    """Return what is to be said of gaps in time; empty for none."""
    from dynident.results.text import counted

    text = "the observer began anew behind each, and a contact within one is seen behind it, if it lasts"
    return f"{counted(gaps, 'gap')} in time: {text}" if gaps else ""


def _rates(text: str) -> list[float]:
    try:
        found = [float(part) for part in text.split(",")]
    except ValueError:
        found = []
    if not found or not all(0 < one < float("inf") for one in found):
        raise BadOption("--rate", text, "give false alarms an hour, above 0: one number, or one for each joint")
    return found


def _show(monitor: Monitor, found: Sequence[Monitored], clean: Sequence[str]) -> None:
    from dynident.diagnosis.finding import brakes_closed
    from dynident.results.text import Column, Table, columns_of, counted, format_number, label, pretty_unit

    robot = monitor.observer.model.robot
    seconds = monitor.tails[0].seconds
    logs, gain = counted(len(clean), "clean log"), monitor.observer.gain
    console.answer(f"thresholds from {logs} of {seconds:.4g} s, observer {gain:g} 1/s")
    columns = ("median threshold", "largest", "of threshold", "false alarms/h", "alarms")
    note = "Thresholds follow the state; 'of threshold' is the largest share of them that was reached at any moment."
    for one in found:
        rows = []
        for j, (name, unit) in enumerate(zip(robot.joint_names, robot.units, strict=True)):
            figures = one.figures()["joints"][j]
            share = figures["largest_share_of_threshold"]
            largest = float(abs(one.residual[:, j]).max())
            values = (figures["threshold"], largest, share, 3600.0 * float(monitor.rates[j]))
            numbers = [format_number(value, 3) for value in values]
            rows.append((label(name), *numbers, str(figures["alarms"]), pretty_unit(unit)))
        heads = columns_of("joint", *(Column(text, numeric=True) for text in columns), "unit")
        console.answer(f"\n{label(one.log)}: {one.seconds:.4g} s\n")
        console.answer_table(Table(heads, tuple(rows)))
        console.answer(note)
        if one.other_rate:
            console.answer(f"remark: {one.other_rate}")
        for alarm in one.alarms:
            times = f"{alarm.start:.4f} to {alarm.end:.4f} s"
            sizes = f"{alarm.peak:.4g} against {alarm.threshold:.4g}"
            console.answer(f"alarm: {label(alarm.joint)}, {times}: {sizes}")
        unseen = f"nothing is watched {brakes_closed(one.braked)}" if one.braked else ""
        for remark in (_resting(monitor, [own["held"] for own in one.figures()["joints"]]), _anew(one.gaps), unseen):
            if remark:
                console.answer(f"remark: {remark}")
        if one.mostly_above:
            console.answer(
                f"remark: {', '.join(label(name) for name in one.mostly_above)}: above the threshold for most of the "
                "log; that is no contact as a rule, but another robot, load or mounting than that of the fit, or other "
                "units, signs or order of columns"
            )
    shortest = min(1.0 / float(rate) for rate in monitor.rates)
    if shortest > seconds:
        low, high = (format_number(3600.0 * rate, 2) for rate in monitor.rate_range())
        console.answer(
            f"remark: the clean runs are shorter than the time between false alarms ({shortest:.4g} s): the "
            f"thresholds are extrapolated. A joint's true rate lies between {low} and {high} an hour (90 %), if other "
            "motions leave residuals as the clean runs do; longer clean runs of several motions (--clean) narrow it"
        )
