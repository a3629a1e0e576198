"""List the parts of a family with their options: estimators, friction models, criteria, filters, log formats, robots.

dynident list
dynident list estimators
dynident list friction --json
"""

from __future__ import annotations

import argparse
import sys

from dynident.cli import console
from dynident.cli.parser import KINDS

SUMMARY = "the parts to choose from, with their options"

FAMILIES = (
    "estimators",
    "friction",
    "filters",
    "formats",
    "profiles",
    "checks",
    "trajectories",
    "criteria",
    "controllers",
    "motion_exporters",
    "model_exporters",
    "robots",
)


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument("family", nargs="?", choices=FAMILIES, metavar="FAMILY", help=", ".join(FAMILIES))
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def run(options: argparse.Namespace) -> int:
    """Run the command."""
    chosen = [options.family] if options.family else list(FAMILIES)
    data = {}
    with console.progress(len(chosen), options.json or not sys.stderr.isatty()) as progress:
        for name in chosen:
            progress.step(name)
            data[name] = _parts(name)
    if options.json:
        console.answer_json(data)
        return 0
    for name, parts in data.items():
        console.answer(f"{name}")
        for part in parts:
            also = f" (also: {', '.join(part['also'])})" if part["also"] else ""
            console.answer(f"  {part['name']:<16} {part['summary']}{also}")
            for option in part["options"] if options.family else []:
                console.answer(
                    f"      {option['name']} ({_kind(option['kind'])}{_default(option['default'])}): {option['help']}"
                )
        console.answer()
    if not options.family:
        console.answer("'dynident list FAMILY' shows the options of each part")
    return 0


def _kind(kind: str) -> str:
    """Return what values an option takes, in words: ``float | None`` is ``a number, or none``."""
    found = [KINDS.get(part.strip(), part.strip()) for part in kind.split(" | ")]
    return ", or ".join(found)


def _default(value: object) -> str:
    """Return the default of an option in words; empty where it has none."""
    from dynident.results.text import plain_value

    return "" if value is None or value == "" else f", default {plain_value(value)}"


def _parts(name: str) -> list[dict]:
    from dynident.data.formats import FORMATS
    from dynident.data.preprocessing import FILTERS
    from dynident.data.profiles import PROFILES
    from dynident.diagnosis.checks import CHECKS
    from dynident.excitation.criteria import CRITERIA
    from dynident.excitation.trajectories import TRAJECTORIES
    from dynident.exports.models import MODEL_EXPORTERS
    from dynident.exports.motions import MOTION_EXPORTERS
    from dynident.identification.estimators import ESTIMATORS
    from dynident.model.friction import FRICTION
    from dynident.robot_files import read_robot, shipped_robots
    from dynident.simulation.controllers import CONTROLLERS

    if name == "robots":
        robots = [read_robot(robot) for robot in shipped_robots()]
        names = zip(shipped_robots(), robots, strict=True)
        return [
            {"name": file, "summary": f"{robot.name}: {robot.dof} joints", "also": [], "options": []}
            for file, robot in names
        ]
    families = {
        "estimators": ESTIMATORS,
        "friction": FRICTION,
        "filters": FILTERS,
        "formats": FORMATS,
        "profiles": PROFILES,
        "checks": CHECKS,
        "trajectories": TRAJECTORIES,
        "criteria": CRITERIA,
        "controllers": CONTROLLERS,
        "motion_exporters": MOTION_EXPORTERS,
        "model_exporters": MODEL_EXPORTERS,
    }
    family = families[name]
    return [
        {
            "name": part,
            "summary": family.summary(part),
            "also": [alias for alias, own in family.aliases.items() if own == part],
            "options": [
                {"name": o.name, "kind": o.kind, "default": o.default, "help": o.help} for o in family.options(part)
            ],
        }
        for part in family.names()
    ]
