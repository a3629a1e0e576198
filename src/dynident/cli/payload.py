"""Find the mass, the centre of mass and the inertia of a tool or load from a run with it.

The payload is the difference to the robot that was identified without it. What the robot's own parameters are unsure
of, friction that may have changed since, and drive gains (where their deviations are stated) are part of its intervals.
A log in which the arm mostly stands is read posture by posture: gravity tells mass and centre of mass only. The payload
is stated in the frame of the flange: --flange, else the tool of the robot model, else its last link, of a robot with
several ends (two arms) that one at which a load explains the torques best.

The exit code is 1 where the log does not tell mass and centre of mass.

  dynident payload estimate.json loaded.csv
  dynident payload estimate.json loaded.csv --mass 2.6 --mass-std 0.01 --flange tool0 --json
  dynident payload estimate.json postures.csv --rows poses
"""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from dynident.cli import console, jobs
from dynident.cli.jobs import add_log_case

if TYPE_CHECKING:
    from dynident.applications.payload import CarriedLoad

SUMMARY = "mass, centre of mass and inertia of a load from a run with it"

#: Options in the short help.
FREQUENT = ("--mass", "--flange", "--rows", "--json")


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument("estimate", metavar="ESTIMATE", help="file that 'dynident identify -o' has written")
    parser.add_argument("logs", nargs="+", metavar="LOG", help="logs with the payload")
    add_log_case(parser)
    known = parser.add_argument_group("what is known")
    known.add_argument("--mass", type=float, metavar="KG", help="its mass; default: to be found")
    known.add_argument("--mass-std", type=float, default=0.0, metavar="KG", help="standard deviation of --mass")
    known.add_argument("--flange", default="", metavar="NAME", help="link or frame that it is stated in")
    known.add_argument(
        "--friction-share",
        type=float,
        default=1.0,
        metavar="SHARE",
        help="how far friction may have changed, as a share of all friction of a joint (std); 1; 0: not at all",
    )
    known.add_argument(
        "--gain-std", type=float, metavar="SHARE", help="relative std of each drive gain; default: that of the case"
    )
    how = parser.add_argument_group("method")
    how.add_argument("--rows", default="auto", choices=("auto", "motion", "poses"), help="auto: look at the log")
    how.add_argument("--level", type=float, default=0.95, metavar="SHARE", help="confidence of the intervals (0.95)")
    output = parser.add_argument_group("output")
    output.add_argument("--json", action="store_true", help="print one JSON object instead of tables")
    output.add_argument("--quiet", action="store_true", help="no progress and no remarks")


def run(options: argparse.Namespace) -> int:
    """Run the command."""
    from dynident.api.applications import payload
    from dynident.applications.payload import BeforeRun, vendor_forms
    from dynident.applications.payload.vendor_forms import unplaced_reason
    from dynident.identification.files.estimate_file import read_estimate

    with console.progress(6, options.quiet or options.json) as progress:
        progress.step("reading")
        found = payload(
            read_estimate(options.estimate),
            options.logs,
            flange=options.flange,
            known=BeforeRun(options.mass, options.mass_std, options.friction_share, options.gain_std),
            rows=options.rows,
            level=options.level,
            case=jobs.log_case(options),
            progress=progress.step,
        )
    forms = vendor_forms(found) if found.placed else {}
    if options.json:
        facts = {**found.figures(), "vendors": forms, "vendors_have_inertia": bool(forms) and found.inertia_known}
        console.answer_json(facts)
    else:
        _show(found, forms, weighed=None if options.mass_std else options.mass)
    if found.placed:
        return 0
    unknown = "" if found.contradiction else f"{', '.join(found.unknown)} not determined well enough: "
    console.remark(f"error: {', '.join(found.logs)}: {unknown}{unplaced_reason(found)}")
    return 1


def _show(found: CarriedLoad, forms: dict[str, str], *, weighed: float | None) -> None:
    from dynident.applications.payload.vendor_forms import unplaced_reason
    from dynident.results.text import (
        MISSING,
        Column,
        Table,
        columns_of,
        format_number,
        format_value,
        label,
        pretty_unit,
    )

    rows, stated = [], "stated, contradicted" if found.contradiction else "stated"
    for one in (found.mass, *found.centre, *found.parameters[:9]):
        shown = (MISSING, MISSING)
        if one.label != "not determined":
            shown = (format_value(one.value, one.half_width)[0], format_number(one.half_width, 2))
        if one is found.mass and weighed:
            rows.append((one.name, f"{weighed:.10g}", MISSING, pretty_unit(one.unit), stated))
            continue
        rows.append((one.name, *shown, pretty_unit(one.unit), one.verdict))
    columns = columns_of(
        "parameter", ">value", Column(f"half width ({100 * found.level:g} %)", numeric=True), "unit", "verdict"
    )
    counted = f"{found.samples} rows" if found.rows == "motion" else f"{found.samples} postures"
    console.answer(f"payload in {label(found.place)}; from {counted}")
    console.answer()
    console.answer_table(Table(columns, tuple(rows)))
    console.answer("\nmoments are about the origin of the frame")
    if not weighed:
        parts = ", ".join(f"{name} {format_number(value, 2)}" for name, value in found.parts.items() if value > 0)
        console.answer(f"standard deviation of the mass by source, in kg: {parts}")
    console.answer("\nroot mean square torque that is left, without and with the payload in the model:")
    for name, (without, with_it) in found.residual.items():
        console.answer(f"  {label(name)}: {format_number(without, 3)}, {format_number(with_it, 3)}")
    why = ""
    if forms:
        inertia = "" if found.inertia_known else " (inertia left out: the log does not tell all of it)"
        console.answer(f"\nfor controllers, from the origin of {label(found.frame)}{inertia}:")
        for name, text in forms.items():
            console.answer_verbatim(f"  {name}: {text}")
    else:
        unknown = "" if found.contradiction else f"{', '.join(found.unknown)} not determined well enough; "
        console.answer()
        why = unplaced_reason(found)
        console.answer(f"no form for controllers: {unknown}{why}")
    for remark in found.remarks:
        if remark != why:
            console.answer(f"remark: {remark}")
