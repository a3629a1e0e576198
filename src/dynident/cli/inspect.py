"""Show what a robot description or case holds: joints, limits, links and their inertias, base parameters.

dynident inspect robot.urdf
dynident inspect er16 --friction coulomb viscous
dynident inspect case.yaml --json
"""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from dynident.model.base_parameters import BaseParameters
    from dynident.model.robot import Robot

SUMMARY = "joints, limits, nominal inertias and base parameters of a robot"


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument("case", metavar="CASE|ROBOT", help="case file, robot description or a robot that ships")
    parser.add_argument("--friction", nargs="*", metavar="NAME", help="friction parts; none: inertial parameters only")
    parser.add_argument("--json", action="store_true", help="print one JSON object instead of tables")


def run(options: argparse.Namespace) -> int:
    """Run the command."""
    from dataclasses import replace

    from dynident.cli import console
    from dynident.experiment.case import read_case
    from dynident.model.base_parameters import base_parameters
    from dynident.model.friction import FRICTION

    case = read_case(options.case)
    if options.friction is not None:
        case = replace(case, friction=tuple(FRICTION.make(name) for name in options.friction))
    base = base_parameters(case.model)
    inertial = base_parameters(case.model, inertial_only=True)
    if options.json:
        console.answer_json(_data(case.robot, base, inertial))
        return 0
    _show(case.robot, base, inertial)
    return 0


def _data(robot: Robot, base: BaseParameters, inertial: BaseParameters) -> dict[str, Any]:
    from dynident.estimation.estimate_file import finite
    from dynident.model.robot import consistency_defects

    return {
        "robot": robot.name,
        "joints": [
            {
                "name": joint.name,
                "kind": joint.kind,
                "lower": finite(joint.limits.lower),
                "upper": finite(joint.limits.upper),
                "velocity": finite(joint.limits.velocity),
                "effort": finite(joint.limits.effort),
            }
            for joint in robot.active
        ],
        "links": [link.name for link in robot.links],
        "impossible_links": consistency_defects(robot.links),
        "gravity": robot.gravity.tolist(),
        "standard_parameters": [
            {"name": parameter.name, "unit": parameter.unit, "verdict": verdict}
            for parameter, verdict in zip(base.parameters, base.verdicts, strict=True)
        ],
        "base_parameters": list(base.names),
        "inertial_base_parameters": inertial.count,
    }


def _show(robot: Robot, base: BaseParameters, inertial: BaseParameters) -> None:
    from dynident.cli import console
    from dynident.results.text import Column, Table, format_given, label, pretty_unit

    gravity = ", ".join(f"{g:g}" for g in robot.gravity)
    console.answer(f"{label(robot.name)}: {robot.dof} joints, {len(robot.links)} links, gravity ({gravity}) m/s²")
    heads = ("joint", "kind", "lower", "upper", "speed", "effort", "unit of effort", "link", "mass [kg]", "inertia")
    columns = tuple(Column(head, numeric=head in heads[2:6] or head == "mass [kg]") for head in heads)
    rows = []
    for joint, link in zip(robot.joints, robot.links, strict=True):
        limits = joint.limits
        numbers = [format_given(value) for value in (limits.lower, limits.upper, limits.velocity, limits.effort)]
        kind = joint.kind if joint.mimic is None else f"follows {label(joint.mimic.joint)}"
        state = "not stated" if link.inertia is None else link.inertia.defect() or "possible"
        mass = format_given(None if link.inertia is None else link.inertia.mass)
        rows.append((label(joint.name), kind, *numbers, pretty_unit(joint.unit), label(link.name), mass, state))
    console.answer_table(Table(columns, tuple(rows)))
    friction = base.count - inertial.count
    console.answer(
        f"\n{len(base.parameters)} standard parameters -> {base.count} base parameters "
        f"({inertial.count} inertial, {friction} friction and drive)"
    )
    numbered = tuple((str(i), label(name)) for i, name in enumerate(base.names, start=1))
    console.answer_table(Table((Column("#", numeric=True), Column("base parameter")), numbered))
    lost: dict[str, list[str]] = {}
    for parameter, verdict in zip(base.parameters, base.verdicts, strict=True):
        if verdict == "not identifiable":
            lost.setdefault(parameter.owner, []).append(parameter.symbol)
    if lost:
        console.answer("\nnot identifiable at all, whatever the motion:")
        for owner, symbols in lost.items():
            console.answer(f"  {label(owner)}: {' '.join(symbols)}")
