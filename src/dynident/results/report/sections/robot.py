"""The robot: joints, limits, drives, gravity, and whether the robot model's inertias are possible."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, ClassVar

import numpy as np

from dynident.model.friction import FRICTION, Friction
from dynident.model.robot import Robot
from dynident.results.plausibility import nominal_state
from dynident.results.report.sections.base import ReportSection
from dynident.results.report.subject import Subject
from dynident.results.text import MISSING, Table, columns_of, format_given, in_words, label, pretty_unit


@dataclass(frozen=True)
class RobotSection(ReportSection):
    """Joints, drives, links and gravity as the robot model states them."""

    title: ClassVar = "Robot"

    def context(self, subject: Subject) -> dict[str, Any]:
        model = subject.estimate.model
        robot = model.robot
        friction = ", ".join(_friction(part) for part in model.friction) or "none"
        gravity = " ".join(format_given(float(value)) for value in robot.gravity)
        facts = [
            ("Name", label(robot.name)),
            ("Joints and links", f"{robot.dof} joints that move on their own, {len(robot.links)} links"),
            ("Base", label(robot.base)),
            ("Gravity in the base frame", f"{gravity} m/s²"),
            ("Friction model", friction),
            ("Tool frame", label(robot.tool) if robot.tool else "frame of the last link"),
        ]
        return {
            "facts": facts,
            "joints": _joints(robot),
            "drives": _drives(robot),
            "links": _links(robot),
            "note": robot.note,
        }


def _friction(part: Friction) -> str:
    options = in_words(asdict(part)) if hasattr(part, "__dataclass_fields__") else ""  # type: ignore[call-overload]
    return FRICTION.name_of(part) + (f" ({options})" if options else "")


def _joints(robot: Robot) -> Table:
    columns = columns_of(
        "joint", "kind", ">from", ">to", "unit", ">speed [unit/s]", ">acceleration [unit/s²]", ">effort", "unit"
    )
    rows = []
    for joint in robot.joints:
        limits = joint.limits
        numbers = [format_given(value) for value in (limits.lower, limits.upper)]
        rates = [format_given(value) for value in (limits.velocity, limits.acceleration, limits.effort)]
        kind = joint.kind if joint.mimic is None else f"{joint.kind}, follows {label(joint.mimic.joint)}"
        place = "rad" if joint.kind == "revolute" else "m"
        rows.append((label(joint.name), kind, *numbers, place, *rates, pretty_unit(joint.unit)))
    return Table(columns, tuple(rows), f"{MISSING}: the robot model states no limit.")


def _drives(robot: Robot) -> Table | None:
    """Return the drives, None where all are as if there were no gear, rotor or current."""
    stated = [joint.drive for joint in robot.active]
    if all(d.gear_ratio == 1 and d.rotor_inertia == 0 and d.gain is None for d in stated) and not robot.is_coupled:
        return None
    columns = columns_of("joint", ">gear ratio", ">rotor inertia [kg·m²]", ">gain [N·m/A]")
    rows = tuple(
        (label(j.name), *map(format_given, (j.drive.gear_ratio, j.drive.rotor_inertia, j.drive.gain)))
        for j in robot.active
    )
    return Table(columns, rows, f"Motor speed = {_matrix(robot)} times joint speed." if robot.is_coupled else "")


def _matrix(robot: Robot) -> str:
    rows = ("[" + " ".join(format_given(float(v)) for v in row) + "]" for row in np.asarray(robot.coupling))
    return "[" + " ".join(rows) + "]"


def _links(robot: Robot) -> Table:
    columns = columns_of("link", ">mass [kg]", ">centre x [m]", ">y [m]", ">z [m]", "physically consistent")
    rows = []
    for link in robot.links:
        name = label(link.name) + (f" (with {', '.join(map(label, link.fixed))})" if link.fixed else "")
        if link.inertia is None:
            rows.append((name, *[MISSING] * 4, "not stated"))
            continue
        defect, state = link.inertia.defect(), nominal_state(link)
        values = (link.inertia.mass, *link.inertia.centre_of_mass)
        rows.append(
            (
                name,
                *(format_given(float(v)) for v in values),
                f"no: {defect}" if defect else state.replace("consistent", "yes"),
            )
        )
    return Table(columns, tuple(rows), "Nominal inertias of the robot model, in link frames.")
