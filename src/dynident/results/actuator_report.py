"""Actuators beside logs: a table for the terminal, and a page with roll-outs, errors and friction."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from dynident.actuators.estimate import ActuatorEstimate, JointActuator
from dynident.actuators.followed_log import FollowedJoint, friction_of
from dynident.actuators.free_bodies import FreeBodies
from dynident.actuators.parameters import PLACE, unit_for
from dynident.arrays import Array
from dynident.results.actuator_text import (
    bodies_table,
    bodies_warnings,
    headline,
    joint_lines,
    joint_warnings,
    parameter_table,
    scale_lines,
    thousandth_of,
)
from dynident.results.figures.signals import line_chart
from dynident.results.report.builder import ReportPart, build_page
from dynident.results.report.sections.base import drawn
from dynident.results.text import MISSING, Column, Table, columns_of, counted, format_number, pretty_unit

#: Speeds of the friction curve end at this quantile of those of the roll-outs; in rad/s where none moves. Points of it.
FASTEST, STANDING, POINTS = 0.999, 1.0, 200

#: Points of a roll-out at most: more are not seen.
MOST = 1500


def errors_table(runs: Sequence[FollowedJoint]) -> Table:
    """Return the mean absolute position error of each roll-out, beside those of linear start and robot model.

    Of an arm also that of the roll-outs of all joints together.
    """
    several = len({run.joint for run in runs}) > 1
    stated = any(np.isfinite(run.nominal) for run in runs)
    unit = thousandth_of(runs)
    columns = [Column("log"), Column("kp", numeric=True), Column("identified", unit, numeric=True)]
    columns += [Column("whole arm", unit, numeric=True)] * several + [Column("linear start", unit, numeric=True)]
    remarks = [", ".join(_remarks(run)) for run in runs]
    columns += [Column("robot model", unit, numeric=True)] * stated + [Column("remark")] * any(remarks)
    rows = []
    for run, remark in zip(runs, remarks, strict=True):
        cells = [Path(run.log).name, f"{run.kp:g}", _mrad(run.error)]
        cells += [_mrad(run.whole)] * several + [_mrad(run.linear)]
        cells += [_mrad(run.nominal)] * stated + [remark] * any(remarks)
        rows.append((run.joint, *cells) if several else tuple(cells))
    return Table(tuple([Column("joint")] * several + columns), tuple(rows))


def _remarks(run: FollowedJoint) -> list[str]:
    return ["kp not trained"] * run.is_outside + ["training log"] * run.is_trained


def _mrad(value: float) -> str:
    return format_number(1e3 * value, 3) if np.isfinite(value) else MISSING if np.isnan(value) else "diverges"


def mean_lines(runs: Sequence[FollowedJoint]) -> list[str]:
    """Return the mean error over the roll-outs, and how many of them do not test the actuators."""
    means = (float(np.mean([getattr(run, name) for run in runs])) for name in ("error", "whole"))
    mean, whole = (f"{_mrad(one)} {thousandth_of(runs)}" if np.isfinite(one) else _mrad(one) for one in means)
    found = [f"mean absolute position error {mean} ({counted(len(runs), 'roll-out')})"]
    if len({run.joint for run in runs}) > 1:
        found.append(f"the whole arm let go: {whole}, all joints by their commands alone")
    if outside := sum(run.is_outside for run in runs):
        found.append(f"{counted(outside, 'roll-out')} at a kp outside that of the training logs: extrapolation")
    if trained := sum(run.is_trained for run in runs):
        found.append(f"{counted(trained, 'roll-out')} over training logs: optimistic")
    return found


def actuator_page(estimate: ActuatorEstimate, runs: Sequence[FollowedJoint]) -> str:
    """Return the report of actuators as one HTML page.

    Args:
        estimate: The actuators.
        runs: Their roll-outs over logs.
    """
    parts = [ReportPart("errors", "Errors of the roll-outs", "actuators.html", _errors(estimate, runs))]
    for joint in estimate.joints:
        own = [run for run in runs if run.joint == joint.name]
        parts.append(ReportPart(f"joint-{joint.name}", joint.name, "actuators.html", _joint(joint, own)))
    if estimate.bodies is not None:
        parts.append(ReportPart("bodies", "Bodies", "actuators.html", _bodies(estimate, estimate.bodies)))
    lead = (headline(estimate).partition(": ")[2], f"roll-outs over {counted(len({run.log for run in runs}), 'log')}")
    return build_page("Actuators", estimate.robot, lead, parts)


def _errors(estimate: ActuatorEstimate, runs: Sequence[FollowedJoint]) -> dict[str, object]:
    said = "Each roll-out starts at the first sample of a log and gets nothing but its commands. Mean absolute "
    said += "position error."
    if any(np.isfinite(run.nominal) for run in runs):
        said += " Robot model: its own armature, damping and friction with the identified drive."
    return {
        "lines": [said, f"{'; '.join(mean_lines(runs))}.", *(scale_lines(estimate) if estimate.bodies is None else ())],
        "warnings": [],
        "tables": [errors_table(runs)],
        "figures": [],
    }


def _bodies(estimate: ActuatorEstimate, bodies: FreeBodies) -> dict[str, object]:
    return {
        "lines": scale_lines(estimate),
        "warnings": bodies_warnings(bodies),
        "tables": [bodies_table(bodies)],
        "figures": [],
    }


def _joint(joint: JointActuator, runs: Sequence[FollowedJoint]) -> dict[str, object]:
    angle, rate, torque = (unit_for(unit, joint.slides) for unit in ("rad", "rad/s", "N m"))
    rates = [np.abs(np.diff(run.predicted) / np.diff(run.time)) for run in runs if np.isfinite(run.predicted).all()]
    fastest = float(np.quantile(np.concatenate(rates), FASTEST)) if rates else 0.0
    speed = np.linspace(0.0, fastest or STANDING, POINTS)
    load = float(np.sqrt(np.mean([run.load**2 for run in runs]))) if runs else 0.0
    lines = [("no load", speed, friction_of(joint, speed, 0.0))]
    if joint.friction not in ("m1", "m2") and load > 0:
        words = f"load of {format_number(load, 2)} {torque}"
        lines.append((words, speed, friction_of(joint, speed, load)))
    stated = next((run.stated for run in runs if run.stated is not None), None)
    tables = [parameter_table(joint)]
    if stated is not None:
        friction = stated[PLACE["coulomb"]] + stated[PLACE["viscous"]] * speed
        lines.append(("robot model, back-EMF with it", speed, friction))
        tables.append(_beside_model(joint, stated))
    chart = line_chart("Friction at even speed", lines, f"speed [{rate}]", f"friction [{torque}]")
    figures = [drawn(chart, "friction", joint.name)]
    for run in runs:
        step = max(1, len(run.time) // MOST)
        own = run.time[::step]
        curves = [("command", own, run.command[::step]), ("measured", own, run.measured[::step])]
        curves.append(("roll-out", own, np.clip(run.predicted[::step], -1e3, 1e3)))
        if run.by_model is not None:
            curves.append(("robot model", own, np.clip(run.by_model[::step], -1e3, 1e3)))
        title = f"{Path(run.log).name}, {_mrad(run.error)} {thousandth_of([run])}"
        figures.append(drawn(line_chart(title, curves, "time [s]", f"position [{angle}]"), "rollout", joint.name))
    return {
        "lines": joint_lines(joint), "warnings": joint_warnings(joint), "tables": tables,
        "figures": figures,
    }  # fmt: skip


def _beside_model(joint: JointActuator, stated: Array) -> Table:
    """Return what simulators have of a joint, by the fit with Coulomb and viscous friction and by the robot model."""

    def damping(values: Array) -> float:
        return float(values[PLACE["viscous"]] + values[PLACE["back_emf"]])

    rows = [
        ("armature", joint.simple[PLACE["armature"]], stated[PLACE["armature"]], "kg m^2"),
        ("damping, back-EMF with it", damping(joint.simple), damping(stated), "N m s/rad"),
        ("Coulomb friction", joint.simple[PLACE["coulomb"]], stated[PLACE["coulomb"]], "N m"),
    ]
    cells = [
        (name, format_number(ours, 3), format_number(theirs, 3), pretty_unit(unit_for(unit, joint.slides)))
        for name, ours, theirs, unit in rows
    ]
    columns = columns_of("of simulators", ">identified", ">robot model")
    return Table((*columns, Column("unit")), tuple(cells))
