"""Show a robot model, a case or a plan.

Of a robot: joints, limits, links and their inertias, base parameters. Of a plan of 'dynident excite -o': what it was
designed for, and its check made again: what needs no model from the plan alone, everything with --case. A plan that
passes a bound is shown and then refused, with exit code 1. --html draws joints, limits and the path of the tool.

  dynident inspect robot.urdf
  dynident inspect er16 --friction coulomb viscous
  dynident inspect arm.urdf --symbolic gravity
  dynident inspect case.yaml --json
  dynident inspect plan.json --case case.yaml --html plan.html
"""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

from dynident.cli import console, plans
from dynident.cli.plans import is_plan
from dynident.errors import BadOption, SolverFailed
from dynident.files import check_outputs, check_place

if TYPE_CHECKING:
    from dynident.applications.symbolic import SymbolicModel
    from dynident.case.case import Case
    from dynident.model.base_parameters import BaseParameters
    from dynident.model.dynamic_model import DynamicModel
    from dynident.model.robot import Robot

SUMMARY = "a robot's joints, limits and base parameters; a plan's check"


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument(
        "case", metavar="CASE|ROBOT|PLAN", help="case file, robot model, built-in example robot, or a plan"
    )
    parser.add_argument("--friction", nargs="*", metavar="NAME", help="friction parts; none: inertial parameters only")
    parser.add_argument(
        "--symbolic",
        nargs="+",
        choices=("gravity", "regressor"),
        metavar="WHAT",
        help="print gravity, regressor or both as SymPy expressions, of an arm of up to 3 joints",
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object instead of tables")
    parser.add_argument("--quiet", action="store_true", help="no remarks")
    plan = parser.add_argument_group("of a plan")
    plan.add_argument(
        "--case",
        dest="plan_case",
        metavar="CASE|ROBOT",
        help="its robot and workspace: check torques, clearances and tool speed as well, draw the path of the tool",
    )
    plan.add_argument("--model", metavar="ESTIMATE", help="compute the torques with an estimate, as in excite --model")
    plan.add_argument(
        "--sigmas", type=float, metavar="N", help="standard deviations of --model's torque that stay free (2); 0: none"
    )
    plan.add_argument("--html", metavar="FILE", help="write the plan as one page that opens offline")


def run(options: argparse.Namespace) -> int:
    """Run the command."""
    return _run_plan(options) if is_plan(options.case) else _run_robot(options)


def _run_plan(options: argparse.Namespace) -> int:
    from dynident.results.plan_view import inspection_data

    if options.friction is not None:
        raise BadOption("--friction", options.friction, "a plan knows the friction it was designed with; leave it out")
    if options.symbolic:
        raise BadOption("--symbolic", options.symbolic, "it goes with a robot or a case, not with a plan")
    if options.html:
        check_outputs((options.html,), (options.case, *plans.files_of(options.plan_case), options.model or ""))
        check_place(options.html)
    view = plans.plan_view(options.case, options.plan_case, options.model, options.sigmas)
    if options.json:
        console.answer_json(inspection_data(view))
    else:
        plans.show_plan(view)
    if options.html:
        from dynident.results.report import write_plan_page

        write_plan_page(options.html, view)
        console.remark(f"wrote {options.html}", options.quiet or options.json)
        if view.robot is None:
            text = "without the path of the tool, which needs the robot: give it with --case"
            console.remark(text, options.quiet or options.json)
    plans.check_kept(view, options.case)
    return 0


def _run_robot(options: argparse.Namespace) -> int:
    from dataclasses import replace

    from dynident.case.case import read_case
    from dynident.model.base_parameters import base_parameters
    from dynident.model.friction import FRICTION

    case = read_case(options.case)
    for name, value in (
        ("--case", options.plan_case),
        ("--model", options.model),
        ("--sigmas", options.sigmas),
        ("--html", options.html),
    ):
        if value is not None:
            raise BadOption(name, value, "it goes with a plan, a file that 'dynident excite -o' has written")
    if options.friction is not None:
        case = replace(case, friction=tuple(FRICTION.make(name) for name in options.friction))
    base = base_parameters(case.model)
    inertial = base_parameters(case.model, inertial_only=True)
    exact = _exact_count(case.model)
    equations = _equations(case.model, options.symbolic) if options.symbolic else None
    if options.json:
        data = {**_data(case.robot, base, inertial), "exact_base_parameters": exact}
        console.answer_json(data if equations is None else {**data, "symbolic": _texts(equations, options.symbolic)})
        return 0
    _show(case.robot, base, inertial)
    _show_meshes(case)
    if exact is not None:
        console.answer(f"\nexact count by the geometry of the joints: {exact}, {_agreement(base, exact)}")
    if equations is not None:
        _show_equations(equations, options.symbolic)
    return 0


def _equations(model: DynamicModel, chosen: list[str]) -> SymbolicModel:
    from dynident.applications.symbolic import symbolic_model

    try:
        return symbolic_model(model)
    except BadOption as problem:
        raise BadOption("--symbolic", " ".join(chosen), problem.step) from problem


def _texts(equations: SymbolicModel, chosen: list[str]) -> dict[str, Any]:
    """Return the expressions by name in the syntax of SymPy: gravity by joint, the regressor by joint and column."""
    found: dict[str, Any] = {"base_parameters": list(map(equations.text, equations.combinations))}
    if "gravity" in chosen:
        found["gravity"] = list(map(equations.text, equations.gravity))
    if "regressor" in chosen:
        rows = equations.regressor.tolist()
        found["regressor"] = [list(map(equations.text, row)) for row in rows]
        found["known_torque"] = list(map(equations.text, equations.known_torque))
    return found


def _show_equations(equations: SymbolicModel, chosen: list[str]) -> None:
    from dynident.results.text import label

    texts, names = _texts(equations, chosen), equations.model.robot.joint_names
    if "gravity" in chosen:
        console.answer(
            "\ngravity torque; beta1 is the base parameter 1 of the table, q1 the position of the first joint:"
        )
        for name, text in zip(names, texts["gravity"], strict=True):
            console.answer(f"  {label(name)}: {text}")
    if "regressor" in chosen:
        known = [(name, text) for name, text in zip(names, texts["known_torque"], strict=True) if text != "0"]
        whole = "Y beta + known" if known else "Y beta"
        console.answer(
            f"\nregressor Y[joint, base parameter] of torque = {whole}; entries that are not there are zero:"
        )
        for joint, row in enumerate(texts["regressor"], start=1):
            for column, text in enumerate(row, start=1):
                if text != "0":
                    console.answer(f"  Y[{joint}, {column}] = {text}")
        if known:
            console.answer("\nknown torque, of rotor inertias and bias that the robot model states; else zero:")
        for name, text in known:
            console.answer(f"  {label(name)}: {text}")
    if equations.weak_terms:
        console.answer(
            f"\n{equations.weak_terms} terms of Y have a coefficient below 1e-4 of the largest of their entry. Where\n"
            "the robot model rounds an angle, such as 1.5708 for a right one, write it with all digits, and they go."
        )


def _agreement(base: BaseParameters, exact: int) -> str:
    if exact == base.count:
        return "the rank of the regressor too"
    near = len(base.weak) or base.neglected > 0
    return "which draws the line elsewhere among those that hardly show" if near else "NOT the rank of the regressor"


def _exact_count(model: DynamicModel) -> int | None:
    """Return the number of base parameters without any sampling; None where the geometry leaves it open."""
    from dynident.applications.identifiability import structure

    springs = any(part.is_spring for part in model.friction)  # they act as weight
    if model.robot.chain.has_mimic or springs:
        return None
    try:
        return structure(model).count
    except SolverFailed:
        return None


def _data(robot: Robot, base: BaseParameters, inertial: BaseParameters) -> dict[str, Any]:
    from dynident.arrays import finite
    from dynident.model.plausible import consistency_defects

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
        "impossible_links": {
            **consistency_defects(robot.links),
            **{link.name: link.impossible for link in robot.links if link.impossible},
        },
        "gravity": robot.gravity.tolist(),
        "note": robot.note,
        "standard_parameters": [
            {"name": parameter.name, "unit": parameter.unit, "verdict": verdict}
            for parameter, verdict in zip(base.parameters, base.verdicts, strict=True)
        ],
        "base_parameters": list(base.names),
        "inertial_base_parameters": inertial.count,
        "weakly_identifiable": [{"name": base.names[k], "share": float(base.shares[k])} for k in base.weak],
        "neglected_share": base.neglected,
    }


def _show(robot: Robot, base: BaseParameters, inertial: BaseParameters) -> None:
    from dynident.arrays import vector_text
    from dynident.results.plausibility import nominal_state
    from dynident.results.text import Column, Table, columns_of, format_given, label, pretty_unit

    links, gravity = len(robot.links), vector_text(robot.gravity)
    console.answer(f"{label(robot.name)}: {robot.dof} joints, {links} links, gravity ({gravity}) m/s²")
    for remark in robot.note.split("; ")[1:] if robot.note.startswith("read from ") else []:
        console.answer(f"note: {label(remark)}")
    heads = ("joint", "kind", "lower", "upper", "speed", "effort", "unit of effort", "link", "mass [kg]", "inertia")
    columns = tuple(Column(head, numeric=head in heads[2:6] or head == "mass [kg]") for head in heads)
    rows = []
    for joint, link in zip(robot.joints, robot.links, strict=True):
        limits = joint.limits
        numbers = [format_given(value) for value in (limits.lower, limits.upper, limits.velocity, limits.effort)]
        kind = joint.kind if joint.mimic is None else f"follows {label(joint.mimic.joint)}"
        state = nominal_state(link)
        mass = format_given(None if link.inertia is None else link.inertia.mass)
        rows.append((label(joint.name), kind, *numbers, pretty_unit(joint.unit), label(link.name), mass, state))
    console.answer_table(Table(columns, tuple(rows)))
    friction = base.count - inertial.count
    console.answer(
        f"\n{len(base.parameters)} standard -> {base.count} base parameters "
        f"({inertial.count} inertial, {friction} friction and drive)"
    )
    numbered = tuple((str(i), label(name)) for i, name in enumerate(base.names, start=1))
    console.answer_table(Table(columns_of(">#", "base parameter"), numbered))
    lost: dict[str, list[str]] = {}
    for parameter, verdict in zip(base.parameters, base.verdicts, strict=True):
        if verdict == "not identifiable":
            lost.setdefault(parameter.owner, []).append(parameter.symbol)
    if lost:
        console.answer("\nunidentifiable parameters (for any motion):")
        for owner, symbols in lost.items():
            console.answer(f"  {label(owner)}: {' '.join(symbols)}")
    _show_weak(base)


def _show_meshes(case: Case) -> None:
    """Say where mesh files are missing, or say nothing about their links: clearances and sizes of bodies need them."""
    from dynident.case.mesh_bounds import with_mesh_points
    from dynident.results.text import label
    from dynident.robot_files.meshes import mesh_count, missing_meshes
    from dynident.robot_files.xacro import split_arguments

    folders = case.workspace.mesh_folders if case.workspace is not None else ()
    missing = missing_meshes(case.robot, split_arguments(case.robot_path)[0], folders)
    if missing:
        console.answer(
            f"\n{len(missing)} of {mesh_count(case.robot)} meshes are missing. Clearance checks need what touches; so "
            "do the sizes of bodies, of a link without one the visual ones. Name their folders under "
            "workspace.mesh_folders, or in ROS_PACKAGE_PATH (a package is a folder with a package.xml of that name):"
        )
        for reason in dict.fromkeys(mesh.reason for mesh in missing):
            console.answer(f"  {label(reason)}:")
            for mesh in (one for one in missing if one.reason == reason):
                console.answer(f"    {label(mesh.link)}: {label(mesh.file)}{' (visual)' * mesh.is_visual}")
    lacking = {mesh.link for mesh in missing}
    faults = [fault for fault in with_mesh_points(case.robot, case.robot_path, folders)[1] if fault.link not in lacking]
    if faults:
        console.answer("\nmeshes that say nothing about the size of their link:")
        for fault in faults:
            console.answer(f"  {label(fault.link)}: {label(fault.evidence)}; {label(fault.remedy)}")


def _show_weak(base: BaseParameters) -> None:
    from dynident.results.text import Table, columns_of, label

    if len(base.weak):
        console.answer(
            "\nweakly identifiable parameters: axes are nearly, but not exactly, parallel, intersecting or vertical,\n"
            "or friction parts are nearly collinear. The share is the part of a column that is independent of the\n"
            "others. Use the torques; do not rely on these values:"
        )
        columns = columns_of(">#", "base parameter", ">share")
        rows = tuple((str(k + 1), label(base.names[k]), f"{base.shares[k]:.1e}") for k in base.weak)
        console.answer_table(Table(columns, rows))
    if base.neglected > 0:
        console.answer(
            f"\nneglected as rounding: combinations that change the torque by a share of {base.neglected:.1e} or less"
        )
