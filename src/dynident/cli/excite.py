"""Design a motion that determines the dynamic model as well as the robot's limits allow.

CASE is a case file or a robot model. The motion is a Fourier series of every joint that starts and ends at rest
(--trajectory bspline: a spline). It keeps the limits of the robot model (position to torque rate) less a margin and,
where the case has a workspace, the clearances; the worst of every joint is shown, and a motion that
passes a bound is not written.

  dynident excite robot.urdf -o plan.json --csv plan.csv --rate 1000
  dynident excite case.yaml -o plan.json --period 20 --criterion unit_condition --starts 8

The torque is that of the nominal masses, with 20 % of every effort limit to spare. The model of a first run with its
uncertainty is better, and its information matrix decides what to record next:

  dynident excite case.yaml -o next.json --model estimate.json --torque-margin 0.1 --earlier estimate.json

A long search: --resume keeps finished starts, so that the same command goes on after Ctrl-C, and --starts 16 adds to 8.

A case with the key servo has position servos whose logs have no torque. Chirp, steps, ramps and release of each joint
are then written into the folder of -o, as commands for the servos, with the intervals that their logs would give. Of
the options, --kp, --pose, --period (6), --rate (100), --margin and --model with an estimate of actuators apply:

  dynident excite servos.yaml --kp 100 400 -o motions

Watch the first run at low speed. What has not been checked is said under the table.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import TYPE_CHECKING

from dynident.cli import console
from dynident.cli.jobs import add_pool_option, cluster_of
from dynident.cli.knowledge import add_options, files_of, knowledge_of
from dynident.cli.plans import is_plan
from dynident.errors import BadOption, FileError
from dynident.files import check_outputs, check_place

if TYPE_CHECKING:
    from dynident.case.case import Case
    from dynident.cli.console import Progress
    from dynident.cli.knowledge import Knowledge
    from dynident.excitation.collision.clearance import Clearance
    from dynident.excitation.design.multistart import SearchState
    from dynident.excitation.design.plan import Plan
    from dynident.model.dynamic_model import DynamicModel
    from dynident.model.friction import Friction

SUMMARY = "design the motion to record"

#: Options in the short help.
FREQUENT = (
    "--friction",
    "--period",
    "--harmonics",
    "--margin",
    "--model",
    "--criterion",
    "--starts",
    "-o",
    "--csv",
    "--rate",
    "--json",
)

#: Samples a second of --csv, and period in s, where none are stated.
RATE, PERIOD = 1000.0, 10.0

#: Rows of the table for the pairs that come nearest.
PAIRS = 6


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument("case", metavar="CASE|ROBOT", help="case file, robot model or built-in example robot")
    parser.add_argument("--friction", nargs="*", metavar="NAME", help="friction parts; default: those of the case")
    motion = parser.add_argument_group("motion")
    motion.add_argument("--period", type=float, metavar="S", help="period in s (10); with servos of a motion (6)")
    motion.add_argument(
        "--harmonics",
        type=int,
        default=5,
        metavar="N",
        help="sine and cosine pairs a joint (5); bspline: as many free numbers as that",
    )
    motion.add_argument(
        "--trajectory",
        default="rest_fourier",
        metavar="NAME",
        help="rest_fourier (default) or bspline, at rest at both ends, or fourier, with a run-in and a run-out",
    )
    motion.add_argument(
        "--margin", type=float, default=0.05, metavar="SHARE", help="share of each limit left unused (0.05)"
    )
    motion.add_argument(
        "--torque-margin", type=float, default=0.2, metavar="SHARE", help="share of each torque left unused (0.2)"
    )
    _add_servo_options(motion)
    add_options(parser)
    search = parser.add_argument_group("search")
    search.add_argument(
        "--criterion", default="d_optimal", metavar="NAME", help="see 'dynident list criteria' (d_optimal)"
    )
    search.add_argument("--starts", type=int, default=4, metavar="N", help="random starts (4)")
    search.add_argument("--seed", type=int, default=0, help="seed of the starts (0)")
    search.add_argument("--time-limit", type=float, default=60.0, metavar="S", help="longest search in s (60)")
    search.add_argument(
        "--jobs", type=int, default=1, metavar="N", help="processes for the starts (1); the plan is the same"
    )
    add_pool_option(search)
    search.add_argument(
        "--resume",
        nargs="?",
        const="",
        metavar="FILE",
        help="keep finished starts in FILE (default: beside the output) and go on from those that are there",
    )
    output = parser.add_argument_group("output")
    output.add_argument("-o", "--output", metavar="FILE", help="write the plan (JSON) here; servos: a folder")
    output.add_argument("--csv", metavar="FILE", help="write t, q, dq, ddq for the controller here, in SI units")
    output.add_argument(
        "--rate", type=float, metavar="HZ", help="samples a second of --csv (1000), or of commands for servos (100)"
    )
    output.add_argument("--repeats", type=int, default=1, metavar="N", help="periods in --csv (1)")
    output.add_argument("--json", action="store_true", help="print one JSON object instead of tables")
    output.add_argument("--quiet", action="store_true", help="no progress and no remarks")


def _add_servo_options(motion: argparse._ArgumentGroup) -> None:
    """Add the options of a case with servos."""
    motion.add_argument(
        "--kp", type=float, nargs="+", metavar="GAIN", help="servos: position gains to record at; default: the case's"
    )
    motion.add_argument(
        "--pose", metavar="Q1,Q2,...", help="servos: where the joints are held; default: the middles of their ranges"
    )


def run(options: argparse.Namespace) -> int:
    """Run the command."""
    from dynident.case.case import read_case

    if is_plan(options.case):
        step = "give the case or robot to design for; 'dynident inspect' shows a plan, 'dynident export' writes it"
        raise FileError(options.case, "it is a plan", step)
    case = read_case(options.case)
    if case.servo is not None:
        from dynident.cli import actuators

        parser = argparse.ArgumentParser()
        configure(parser)
        return actuators.excite(case, options, parser.parse_args([options.case]))
    for name in ("kp", "pose"):
        if getattr(options, name) is not None:
            step = "leave it out: it is for a case with servo:, and this one has none"
            raise BadOption(f"--{name}", getattr(options, name), step)
    options.rate = RATE if options.rate is None else options.rate
    options.period = PERIOD if options.period is None else options.period
    return _designed(case, options)


def _designed(case: Case, options: argparse.Namespace) -> int:
    """Design, show and write one motion of all joints for logs with torques."""
    from dataclasses import replace

    from dynident.api.excite import case_clearance
    from dynident.excitation.design.plan import plan_data, write_plan, write_samples
    from dynident.model.friction import FRICTION

    resume = _checked(case, options)
    if options.friction is not None:
        case = replace(case, friction=tuple(FRICTION.make(name) for name in options.friction))
    else:
        case = replace(case, friction=_known_before(case.friction, options.quiet or options.json))
    plan = _design(options, case, knowledge_of(options, case, case.model), resume)
    if options.json:
        console.answer_json(plan_data(plan))
    else:
        _show(plan, case.model, case_clearance(case), bool(options.earlier or options.earlier_logs))
    if options.output:
        write_plan(plan, options.output)
        console.remark(f"saved {options.output}", options.quiet or options.json)
    if options.csv:
        rows = write_samples(plan, options.csv, options.rate, options.repeats)
        length = plan.motion(options.repeats).duration
        text = f"saved {options.csv}: {rows} rows at {options.rate:g} Hz, {length:g} s"
        console.remark(text, options.quiet or options.json)
    return 0


def _known_before(friction: tuple[Friction, ...], quiet: bool) -> tuple[Friction, ...]:
    """Return the parts whose columns follow from the motion alone; those that depend on a log are named."""
    from dynident.api.excite import friction_of_motion
    from dynident.model.friction import FRICTION

    kept = friction_of_motion(friction)
    for part in friction:
        if part not in kept:
            unknown = f"its {' and '.join(sorted(part.needs))}" if part.needs else "whether it is there"
            console.remark(f"designed without {FRICTION.name_of(part)}: {unknown} is known from a log only", quiet)
    return kept


def _checked(case: Case, options: argparse.Namespace) -> str | None:
    """Return the file of finished starts, all names of files and numbers checked."""
    resume = options.resume
    if resume == "":
        if not options.output:
            raise BadOption("--resume", "", "name a file, or give the plan's with -o")
        resume = f"{options.output}.search.json"
    outputs = (options.output, options.csv, resume)
    check_outputs(outputs, (options.case, *case.files, *files_of(options, case)))
    for place in filter(None, outputs):
        check_place(place)
    if options.seed < 0:
        raise BadOption("--seed", options.seed, "give 0 or more")
    if not 0 < options.rate < float("inf"):
        raise BadOption("--rate", options.rate, "give samples a second, above 0")
    if not 0 < options.period < float("inf"):
        raise BadOption("--period", options.period, "give the period in s, above 0")
    if options.repeats < 1:
        raise BadOption("--repeats", options.repeats, "give 1 or more")
    return resume


def _design(options: argparse.Namespace, case: Case, known: Knowledge, resume: str | None) -> Plan:
    from dataclasses import replace

    from dynident.api.excite import excite
    from dynident.excitation.design.excitation import ROWS_A_SECOND
    from dynident.excitation.design.limits import limits_of
    from dynident.excitation.design.options import DesignKnowledge, SearchOptions, TrajectoryOptions

    rate = known.rate or case.preprocessing.rate_hz or ROWS_A_SECOND
    with console.progress(max(options.starts, 1), options.quiet or options.json) as progress:
        plan = excite(
            case,
            options.criterion,
            limits=limits_of(case.robot, options.margin, options.torque_margin),
            trajectory=TrajectoryOptions(options.trajectory, options.period, options.harmonics),
            knowledge=DesignKnowledge(
                known.noise,
                known.theta,
                known.uncertainty,
                known.earlier,
                rate * options.period * options.repeats if options.rows is None else options.rows,
            ),
            search=SearchOptions(
                options.starts, options.seed, options.time_limit, options.jobs, cluster_of(options), resume
            ),
            friction=case.friction,
            progress=_teller(progress, options.criterion),
        )
    facts = dict(plan.settings)
    if known.source:
        facts["noise_source"] = known.source
    if known.model:
        sigmas = f", {known.uncertainty.sigmas:g} sigmas free" if known.uncertainty else ""
        facts["torque_limits"] = f"{known.model}{sigmas}"
    return replace(plan, settings=facts)


def _teller(progress: Progress, criterion: str) -> Callable[[SearchState], None]:
    """Return what tells the news of a search: a line a finished start, and on a terminal how far it is between."""
    from dynident.results.text import format_number

    finished = 0

    def told(state: SearchState) -> None:
        nonlocal finished
        figure = f"{criterion} {format_number(state.figure)}"
        use = f"; {100 * state.used:.0f} % of {state.worst}" if state.worst else ""
        text = f"start {state.start} of {state.starts}: {figure}{use}, {state.evaluations} evaluations"
        if state.finished > finished:
            finished = state.finished
            progress.step(text)
        else:
            progress.update(text)

    return told


def _show(plan: Plan, model: DynamicModel, clearance: Clearance | None, earlier: bool) -> None:
    from dynident.excitation.design.plan import slow_joints
    from dynident.results.plan_view import figures_table, outlook_table
    from dynident.results.text import label

    facts = plan.settings
    console.answer(
        f"{label(plan.robot)}: {len(plan.joints)} joints, {facts['base_parameters']} base parameters, "
        f"{plan.trajectory.period:g} s, {plan.trajectory.detail}, criterion {plan.criterion}"
    )
    where = f"run-in and run-out of {plan.run_in:g} s" if plan.run_in else "starts and ends at rest"
    console.answer(f"{where}; noise: {facts['noise_source']}; torque limits: {facts['torque_limits']}\n")
    console.answer_table(figures_table(plan))
    outlook = outlook_table(plan, console.NAME_WIDTH) if earlier else None
    if outlook is not None:
        console.answer()
        console.answer_table(outlook, outlook.note)
    console.answer()
    _show_limits(plan)
    for line in _not_checked(plan, clearance):
        console.answer(line)
    for line in slow_joints(plan, model):
        console.answer(f"warning: {line}")


def _show_limits(plan: Plan) -> None:
    from dynident.results.plan_view import rows_table

    pairs = sorted((row for row in plan.rows if row.quantity == "clearance"), key=lambda row: -row.used)
    shown = [row for row in plan.rows if row.quantity != "clearance"] + pairs[:PAIRS]
    table = rows_table(shown, f"limits, checked at {plan.samples} samples, margins taken off")
    console.answer_table(table, table.note)
    if len(pairs) > PAIRS:
        console.answer(f"and {len(pairs) - PAIRS} pairs that stay further apart")


def _not_checked(plan: Plan, clearance: Clearance | None) -> list[str]:
    """Return lines that say what nobody has looked at."""
    lines = [] if clearance is None else [f"clearance: {line}" for line in clearance.summary()[1:]]
    if clearance is None:
        lines.append("not checked: floor, obstacles, the robot itself (the case has no workspace)")
    checked = {row.quantity for row in plan.rows}
    if "torque" not in checked:
        lines.append("not checked: torque, torque rate (no masses are known)")
    open_ = {row.quantity for row in plan.rows if row.limit == float("inf")} | {"torque rate"} - checked
    if open_:
        lines.append(f"not bounded, as no limit is stated: {', '.join(sorted(open_))} of some joint")
    return lines
