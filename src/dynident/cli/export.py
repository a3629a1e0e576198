"""Write a plan for a controller: tables, ROS 2 messages and bags, programs for UR, KUKA and ABB, libfranka.

PLAN is a file of 'dynident excite -o'. The path is never changed; --speed slows it down for a first run. The motion
begins and ends at rest, after a slow approach to its first posture: from the posture that is stated, or by a move of
the controller's own. A plan that passes a bound is not written. --check tells what would be written.

  dynident export plan.json --to urscript -o excite.script --speed 20
  dynident export plan.json --to joint_trajectory -o excite.yaml --from-posture 0,-1.57,0,-1.57,0,0
  dynident export plan.json --to csv -o motion.csv --rate 250 --from-posture start --option degrees=true
"""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from dynident.experiment.design.plan import Plan
    from dynident.results.exporters import Export

SUMMARY = "a plan as a program or as messages for a controller"


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument("plan", metavar="PLAN", help="file that 'dynident excite -o' has written")
    parser.add_argument("--to", required=True, metavar="NAME", help="the target; see 'dynident list exporters'")
    parser.add_argument("-o", "--output", required=True, metavar="FILE", help="file (for a bag: folder) to write")
    parser.add_argument("--option", action="append", default=[], metavar="KEY=VALUE", help="an option of the exporter")
    motion = parser.add_argument_group("motion")
    motion.add_argument("--rate", type=float, metavar="HZ", help="samples a second; default: those of the target")
    motion.add_argument("--repeats", type=int, default=1, metavar="N", help="periods (1)")
    motion.add_argument(
        "--speed", type=float, default=100.0, metavar="PERCENT", help="10 to 100 per cent of the designed speed (100)"
    )
    motion.add_argument(
        "--from-posture",
        metavar="Q1,Q2,..",
        help="where the robot stands, or 'start': at the first posture",
    )
    motion.add_argument(
        "--units", choices=("rad", "deg"), default="rad", help="of turning joints in --from-posture (rad); others: m"
    )
    output = parser.add_argument_group("output")
    output.add_argument("--check", action="store_true", help="write nothing, tell what would be written")
    output.add_argument("--json", action="store_true", help="print one JSON object instead of tables")
    output.add_argument("--quiet", action="store_true", help="no remarks")


def run(options: argparse.Namespace) -> int:
    """Run the command."""
    from dynident.cli import console, jobs
    from dynident.experiment.design.plan import read_plan
    from dynident.results.exporters import EXPORTERS, export, export_data

    plan = read_plan(options.plan)
    part = EXPORTERS.make_from_text(options.to, _pairs(options.option))
    posture = _posture(options.from_posture, plan, options.units)
    asked: dict[str, Any] = {"rate": options.rate, "repeats": options.repeats, "speed": options.speed}
    jobs.check_outputs((options.output,), (options.plan,))
    found = export(plan, part, options.output, **asked, from_posture=posture, write=False)
    jobs.check_outputs(found.files, (options.plan,))
    if not options.json:
        _show(found)
    if not options.check:
        export(plan, part, options.output, **asked, from_posture=posture)
    if options.json:
        console.answer_json(export_data(found))
        return 0
    for file in found.files:
        console.remark(f"{'would write' if options.check else 'saved'} {file}", options.quiet)
    return 0


def _pairs(items: list[str]) -> dict[str, str | None]:
    from dynident.errors import BadOption

    found: dict[str, str | None] = {}
    for item in items:
        key, equals, value = item.partition("=")
        if not equals:
            raise BadOption("--option", item, "write key=value, such as --option degrees=true")
        found[key] = value
    return found


def _posture(text: str | None, plan: Plan, units: str) -> Any:
    """Return the posture in SI units, the word for the first posture, or None."""
    import math

    from dynident.errors import BadOption

    if text is None or text.strip() == "start":
        return text and text.strip()
    try:
        values = [float(word) for word in text.split(",")]
    except ValueError:
        raise BadOption("--from-posture", text, "give numbers with commas between them, or 'start'") from None
    turns = plan.limits.revolute
    if len(values) != len(turns):
        raise BadOption("--from-posture", text, f"give {len(turns)} numbers, one for each joint, or 'start'")
    return [math.radians(v) if turn and units == "deg" else v for v, turn in zip(values, turns, strict=True)]


def _show(export: Export) -> None:
    from dynident.cli import console
    from dynident.results.plan_view import rows_table
    from dynident.results.text import label

    points = f"{export.points} points" + (f" at {export.rate:g} Hz" if export.rate else "")
    length = f"{export.duration:.6g} s at {100 * export.speed:g} % speed"
    console.answer(f"{label(export.robot)} to {export.exporter}: {length}, {points}")
    console.answer(f"approach: {export.approach}\n")
    table = rows_table(export.rows, "limits at this speed, margins taken off")
    console.answer_table(table, table.note)
    console.answer(f"\nlargest round-off of a position: {max(export.round_off.values()):.2g} rad or m")
    for key, value in export.facts.items():
        worst = max(value.values()) if isinstance(value, dict) else value
        console.answer(f"{key.replace('_', ' ')}: {worst:.4g}" if isinstance(worst, float) else f"{key}: {worst}")
    for note in export.notes:
        console.answer(f"note: {label(note)}")
