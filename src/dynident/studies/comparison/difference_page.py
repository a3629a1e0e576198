"""Estimates side by side as tables for the terminal and as one self-contained page."""

from __future__ import annotations

from dataclasses import replace
from os import PathLike

import numpy as np

from dynident.files import write_atomically
from dynident.identification.estimate.estimate import Estimate
from dynident.results.figures import line_chart
from dynident.results.figures.residuals import speed_grid
from dynident.results.report.builder import ReportPart, build_page
from dynident.results.report.combinations import combination
from dynident.results.report.sections.base import drawn
from dynident.results.report.sections.friction import friction_torque, standard_parameters
from dynident.results.text import (
    MISSING,
    Column,
    Table,
    columns_of,
    format_number,
    format_percent,
    format_value,
    label,
    pretty_unit,
    shorten,
)
from dynident.studies.comparison.difference import EstimateDifference

#: Deviations from which on two values are said to differ.
FAR = 3.0


def estimates_table(difference: EstimateDifference) -> Table:
    """Return what each estimate is."""
    columns = columns_of("estimate", "estimator", ">samples", ">base parameters", ">training error [%]", "consistent")
    rows = tuple(
        (
            label(name),
            label(each.estimator),
            str(each.samples),
            str(each.base.count),
            format_percent(each.train.total_relative_error, sign=False),
            "yes" if each.consistency.consistent else "NO",
        )
        for name, each in zip(difference.names, difference.estimates, strict=True)
    )
    return Table(columns, rows)


def parameters_beside(difference: EstimateDifference, width: int | None = None) -> Table:
    """Return the base parameters that the estimates share, with how far each is from that of the first.

    Args:
        difference: The estimates.
        width: Columns of a terminal that a name may take; None shows all.
    """
    columns = [Column("base parameter"), Column("unit"), Column(label(difference.names[0]), numeric=True)]
    for name in difference.names[1:]:
        columns += [Column(label(name), numeric=True), Column("off by", "std", numeric=True)]
    rows = []
    for each in difference.shared:
        name = label(each.name)
        row = [name if width is None else shorten(name, width), pretty_unit(each.unit)]
        for k, (value, deviation, gap) in enumerate(zip(each.values, each.deviations, each.gaps, strict=True)):
            known = np.isfinite(value)
            row.append(" ± ".join(format_value(float(value), float(deviation))) if known else MISSING)
            if k:
                row.append(format_number(float(gap), 2) if np.isfinite(gap) else MISSING)
        rows.append(tuple(row))
    note = "Off by: difference to the first over the deviation of both, as if their logs had nothing in common."
    return Table(tuple(columns), tuple(rows), note)


def torques_table(difference: EstimateDifference) -> Table | None:
    """Return how far the predicted torques are apart; None where no motion is common."""
    found = difference.torques
    if found is None:
        return None
    robot = difference.estimates[0].model.robot
    columns = [Column("joint"), Column("unit"), Column(label(difference.names[0]), numeric=True)]
    columns += [Column(f"{label(name)}, gap", numeric=True) for name in difference.names[1:]]
    rows = tuple(
        (
            label(name),
            pretty_unit(unit),
            format_number(size, 3),
            *(f"{format_number(gap, 2)} ({format_percent(gap / size if size else np.nan)})" for gap in gaps),
        )
        for name, unit, size, gaps in zip(robot.joint_names, robot.units, found.sizes[0], found.gaps[1:].T, strict=True)
    )
    note = "RMS over 1000 random states within the training ranges of all estimates."
    return Table(tuple(columns), rows, note)


def verdicts(difference: EstimateDifference) -> list[str]:
    """Return what stands out, in sentences."""
    said = []
    for k, name in enumerate(difference.names[1:], start=1):
        gaps = np.array([abs(each.gaps[k]) for each in difference.shared])
        known = gaps[np.isfinite(gaps)]
        if not len(known):
            said.append(f"{label(name)} shares no base parameter with {label(difference.names[0])}")
            continue
        far = int(np.sum(known > FAR))
        said.append(
            f"{label(name)}: {far} of {len(known)} shared base parameters are more than {FAR:g} deviations from those "
            f"of {label(difference.names[0])}; the median is {format_number(float(np.median(known)), 2)}"
        )
    for name, alone in difference.alone.items():
        said.append(f"only in {label(name)}: {', '.join(label(each) for each in alone)}")
    if difference.why_not:
        said.append(f"torques are not compared: {label(difference.why_not)}")
    return said


def write_difference_page(path: str | PathLike[str], difference: EstimateDifference) -> None:
    """Write estimates side by side as one HTML file that asks nothing of any network.

    Raises:
        FileError: The file cannot be written.
    """
    context = {
        "estimates": estimates_table(difference),
        "parameters": _as_mathematics(parameters_beside(difference), difference),
        "torques": torques_table(difference),
        "verdicts": verdicts(difference),
        "friction": _friction(difference),
    }
    robot = difference.estimates[0].model.robot.name
    parts = [ReportPart("difference", "Side by side", "difference.html", context)]
    write_atomically(path, build_page("Estimates", robot, [label(name) for name in difference.names], parts))


def _as_mathematics(table: Table, difference: EstimateDifference) -> Table:
    """Return the table of shared base parameters with their combinations as mathematics in place of plain names."""
    bases = [each.base for each in difference.estimates]
    found = {name: (base, row) for base in bases for row, name in enumerate(base.names)}
    rows = zip(table.rows, difference.shared, strict=True)
    return replace(table, rows=tuple((combination(*found[each.name]), *row[1:]) for row, each in rows))


def _friction(difference: EstimateDifference) -> list[str]:
    """Draw the friction of each joint by every estimate that has some without asking for more than speeds."""
    drawings = []
    robot = difference.estimates[0].model.robot
    for i, (name, unit) in enumerate(zip(robot.joint_names, robot.units, strict=True)):
        curves = [
            (label(title), *curve)
            for title, each in zip(difference.names, difference.estimates, strict=True)
            if (curve := _curve(each, i)) is not None
        ]
        if curves:
            rate = "rad/s" if unit == "N m" else "m/s"
            heading = f"friction [{pretty_unit(unit)}]"
            drawings.append(drawn(line_chart(label(name), curves, f"speed [{rate}]", heading), "friction", name))
    return drawings


def _curve(estimate: Estimate, joint: int) -> tuple[np.ndarray, np.ndarray] | None:
    """Return speeds and friction of a drive at rest posture; None where it has none or asks for temperatures."""
    model = estimate.model
    if not model.friction or "temperature" in model.needs or not len(estimate.train.dq):
        return None
    coupling = np.asarray(model.robot.coupling)
    grid = speed_grid((estimate.train.dq @ coupling.T)[:, joint])
    motor = np.zeros((len(grid), model.robot.dof))
    motor[:, joint] = grid
    speeds = np.linalg.solve(coupling, motor.T).T
    posture = np.tile(estimate.middle, (len(grid), 1))
    return grid, friction_torque(model, standard_parameters(estimate), posture, speeds)[:, joint]
