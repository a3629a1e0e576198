"""Design a motion that determines the dynamic model as well as the robot's limits allow.

CASE is a case file or a robot description. The motion is a Fourier series of every joint that starts and ends at rest.
It keeps the limits of the description less a margin; the worst of every joint is shown, and a motion that passes a
bound is not written. The torque is that of the description's own masses. Watch the first run at low speed: obstacles,
the floor and the robot itself are not looked at.

  dynident excite panda.urdf -o plan.json --csv plan.csv --rate 1000
  dynident excite case.yaml -o plan.json --period 20 --criterion unit_condition --starts 8
"""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from dynident.experiment.plan import Plan

SUMMARY = "design the motion to record"


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument("case", metavar="CASE|ROBOT", help="case file, robot description or a robot that ships")
    parser.add_argument("--friction", nargs="*", metavar="NAME", help="friction parts; default: those of the case")
    motion = parser.add_argument_group("motion")
    motion.add_argument("--period", type=float, default=10.0, metavar="S", help="period in s (10)")
    motion.add_argument("--harmonics", type=int, default=5, metavar="N", help="sine and cosine pairs a joint (5)")
    motion.add_argument(
        "--trajectory",
        default="rest_fourier",
        metavar="NAME",
        help="rest_fourier, at rest at both ends (default), or fourier, with a run-in and a run-out",
    )
    motion.add_argument(
        "--margin", type=float, default=0.05, metavar="SHARE", help="share of each limit left unused (0.05)"
    )
    motion.add_argument(
        "--torque-margin", type=float, default=0.2, metavar="SHARE", help="share of each torque left unused (0.2)"
    )
    search = parser.add_argument_group("search")
    search.add_argument(
        "--criterion", default="d_optimal", metavar="NAME", help="see 'dynident list criteria' (d_optimal)"
    )
    search.add_argument("--starts", type=int, default=4, metavar="N", help="random starts (4)")
    search.add_argument("--seed", type=int, default=0, help="seed of the starts (0)")
    search.add_argument("--time-limit", type=float, default=60.0, metavar="S", help="longest search in s (60)")
    output = parser.add_argument_group("output")
    output.add_argument("-o", "--output", metavar="FILE", help="write the plan (JSON) here")
    output.add_argument("--csv", metavar="FILE", help="write t, q, dq, ddq for the controller here, in SI units")
    output.add_argument("--rate", type=float, default=1000.0, metavar="HZ", help="rows a second of --csv (1000)")
    output.add_argument("--repeats", type=int, default=1, metavar="N", help="periods in --csv (1)")
    output.add_argument("--json", action="store_true", help="print one JSON object instead of tables")
    output.add_argument("--quiet", action="store_true", help="no progress and no remarks")


def run(options: argparse.Namespace) -> int:
    """Run the command."""
    from dynident.cli import console
    from dynident.experiment.plan import plan_data, write_plan, write_samples

    plan = _design(options)
    if options.output:
        write_plan(plan, options.output)
    rows = write_samples(plan, options.csv, options.rate, options.repeats) if options.csv else 0
    if options.json:
        console.answer_json(plan_data(plan))
        return 0
    _show(plan)
    if options.output:
        console.remark(f"saved {options.output}", options.quiet)
    if options.csv:
        length = plan.motion(options.repeats).duration
        console.remark(f"saved {options.csv}: {rows} rows at {options.rate:g} Hz, {length:g} s", options.quiet)
    return 0


def _design(options: argparse.Namespace) -> Plan:
    from dataclasses import replace

    from dynident.cli import console
    from dynident.cli.jobs import check_outputs
    from dynident.errors import BadOption
    from dynident.experiment.case import read_case
    from dynident.experiment.design_search import SearchState
    from dynident.experiment.excitation import design_excitation
    from dynident.experiment.limits import limits_of
    from dynident.files import check_place
    from dynident.model.friction import FRICTION

    case = read_case(options.case)
    check_outputs((options.output, options.csv), (options.case, *case.files))
    for place in filter(None, (options.output, options.csv)):
        check_place(place)
    if options.seed < 0:
        raise BadOption("--seed", options.seed, "give 0 or more")
    if options.friction is not None:
        case = replace(case, friction=tuple(FRICTION.make(name) for name in options.friction))
    limits = limits_of(case.robot, options.margin, options.torque_margin)
    last = 0
    with console.progress(max(options.starts, 1), options.quiet or options.json) as progress:

        def told(state: SearchState) -> None:
            nonlocal last
            if state.start != last:
                last = state.start
                progress.step(f"start {state.start} of {state.starts}")

        return design_excitation(
            case.model,
            limits,
            options.criterion,
            trajectory=options.trajectory,
            period=options.period,
            harmonics=options.harmonics,
            starts=options.starts,
            seed=options.seed,
            time_limit=options.time_limit,
            progress=told,
        )


def _show(plan: Plan) -> None:
    from dynident.cli import console
    from dynident.experiment.criteria import CRITERIA
    from dynident.results.text import Column, Table, format_given, format_number, label, pretty_unit

    facts = plan.settings
    console.answer(
        f"{label(plan.robot)}: {len(plan.joints)} joints, {facts['base_parameters']} base parameters, "
        f"{plan.trajectory.period:g} s, {plan.trajectory.harmonics} harmonics, criterion {plan.criterion}"
    )
    where = f"run-in and run-out of {plan.run_in:g} s" if plan.run_in else "starts and ends at rest"
    console.answer(f"{where}; noise: {facts['noise_source']}; torque limits: {facts['torque_limits']}\n")
    figures = tuple(
        (name, format_number(value), "larger" if CRITERIA.get(name).larger_is_better else "smaller")
        for name, value in plan.values.items()
    )
    console.answer_table(Table((Column("criterion"), Column("value", numeric=True), Column("better")), figures))
    console.answer()
    heads = ("joint", "quantity", "worst", "bound", "unit", "used [%]", "at [s]")
    columns = tuple(Column(head, numeric=head in (*heads[2:4], *heads[5:])) for head in heads)
    rows = tuple(
        (
            label(row.joint),
            row.quantity,
            format_number(row.value),
            format_given(row.limit),
            pretty_unit(row.unit),
            f"{100 * row.used:.1f}" if row.used else "–",
            f"{row.time:.2f}",
        )
        for row in plan.rows
    )
    console.answer_table(Table(columns, rows), f"limits, checked at {plan.samples} samples, margins taken off")
