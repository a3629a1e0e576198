"""Estimates of one robot side by side, as tables and as a page.

Parameters are compared in units of their deviations, torques where all have seen motion.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from os import PathLike
from typing import Any

import numpy as np

from dynident.arrays import Array, finite
from dynident.data.log import Log
from dynident.errors import BadOption, DynidentError
from dynident.files import write_atomically
from dynident.identification.estimate.estimate import Estimate
from dynident.identification.problem.regressor_stream import RegressorStream
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


#: Random states on which torques are compared.
STATES = 1000

_QUANTITIES = ("position", "speed", "acceleration")


@dataclass(frozen=True)
class SharedParameter:
    """A base parameter that several estimates have.

    Attributes:
        name: Of the base parameter.
        unit: Of its values.
        values: One for each estimate, NaN where it has none, shape (k,).
        deviations: Standard deviations, shape (k,).
    """

    name: str
    unit: str
    values: Array
    deviations: Array

    @property
    def gaps(self) -> Array:
        """Difference to the first estimate over the deviation of both as if they were independent, shape (k,)."""
        spread = np.hypot(self.deviations, self.deviations[0])
        gap = self.values - self.values[0]
        return np.divide(gap, spread, out=np.where(gap == 0, 0.0, np.nan * gap), where=spread > 0)


@dataclass(frozen=True)
class TorqueGap:
    """Predicted torques on random states within what the logs of all estimates have seen.

    Attributes:
        sizes: Root mean square of the torque of each estimate and joint, shape (k, n).
        gaps: Root mean square of its difference to that of the first, shape (k, n).
    """

    sizes: Array
    gaps: Array


@dataclass(frozen=True)
class EstimateDifference:
    """Estimates of one robot side by side; the first is the one that the others are compared with.

    Attributes:
        names: Of the estimates.
        estimates: The estimates.
        shared: Base parameters that at least two have, in the order of the first.
        alone: Base parameters that only one has, by name of the estimate.
        torques: None where no motion is common to their logs.
        why_not: Why there are no torques; empty where there are.
    """

    names: tuple[str, ...]
    estimates: tuple[Estimate, ...]
    shared: tuple[SharedParameter, ...]
    alone: dict[str, tuple[str, ...]]
    torques: TorqueGap | None
    why_not: str

    def figures(self) -> dict[str, Any]:
        """Return the difference as plain data, fractions for shares."""
        first = self.estimates[0]
        joints = first.model.robot.joint_names
        return {
            "robot": first.model.robot.name,
            "estimates": [
                {
                    "name": name,
                    "estimator": each.estimator,
                    "samples": each.samples,
                    "logs": list(each.train.logs),
                    "base_parameters": each.base.count,
                    "training_error": finite(each.train.total_relative_error),
                    "physically_consistent": each.consistency.consistent,
                }
                for name, each in zip(self.names, self.estimates, strict=True)
            ],
            "parameters": [
                {
                    "name": each.name,
                    "unit": each.unit,
                    "values": [finite(v) for v in each.values],
                    "std": [finite(v) for v in each.deviations],
                    "t": [finite(v) for v in each.gaps],
                }
                for each in self.shared
            ],
            "only_in": {name: list(alone) for name, alone in self.alone.items()},
            "torques": None
            if self.torques is None
            else [
                {"joint": joint, "rms": self.torques.sizes[:, i].tolist(), "rms_gap": self.torques.gaps[:, i].tolist()}
                for i, joint in enumerate(joints)
            ],
            "why_no_torques": self.why_not or None,
        }


def difference(estimates: Sequence[Estimate], names: Sequence[str], seed: int = 0) -> EstimateDifference:
    """Return estimates of one robot side by side.

    Args:
        estimates: Two or more; the others are compared with the first.
        names: A name for each.
        seed: Of the random states.

    Raises:
        BadOption: Fewer than two, names that are not one each, or another robot's joints.
    """
    if len(estimates) < 2 or len(names) != len(estimates):
        raise BadOption("estimates", len(estimates), "give two or more estimates, with a name for each")
    joints = estimates[0].model.robot.joint_names
    for name, estimate in zip(names[1:], estimates[1:], strict=True):
        own = estimate.model.robot.joint_names
        if own != joints:
            step = f"its joints are {', '.join(own)}, those of {names[0]} {', '.join(joints)}; compare one robot's"
            raise BadOption("estimates", name, step)
    shared, alone = _parameters(estimates, names)
    torques, why_not = _torques(estimates, names, seed)
    return EstimateDifference(tuple(names), tuple(estimates), shared, alone, torques, why_not)


def _parameters(
    estimates: Sequence[Estimate], names: Sequence[str]
) -> tuple[tuple[SharedParameter, ...], dict[str, tuple[str, ...]]]:
    facts = [zip(each.base.units, each.beta, each.std, strict=True) for each in estimates]
    own = [dict(zip(each.base.names, rows, strict=True)) for each, rows in zip(estimates, facts, strict=True)]
    everything = list(dict.fromkeys(name for each in own for name in each))
    shared = []
    for name in everything:
        found = [each.get(name) for each in own]
        known = [item for item in found if item is not None]
        if len(known) < 2:
            continue
        values = np.array([np.nan if item is None else item[1] for item in found])
        deviations = np.array([np.nan if item is None else item[2] for item in found])
        shared.append(SharedParameter(name, known[0][0], values, deviations))
    both = {each.name for each in shared}
    rest = (tuple(p for p in each if p not in both) for each in own)
    return tuple(shared), {name: left for name, left in zip(names, rest, strict=True) if left}


def _torques(estimates: Sequence[Estimate], names: Sequence[str], seed: int) -> tuple[TorqueGap | None, str]:
    """Return the torques on common states; None and the reason where that cannot be."""
    joints = estimates[0].model.robot.joint_names
    unknown = [name for name, each in zip(names, estimates, strict=True) if each.envelope is None]
    if unknown:
        return None, f"{', '.join(unknown)}: the file does not state its training range; identify again"
    seen = [each.envelope for each in estimates if each.envelope is not None]
    low = np.max([each.low[:3] for each in seen], axis=0)
    high = np.min([each.high[:3] for each in seen], axis=0)
    if np.any(high < low):
        quantity, joint = np.unravel_index(int(np.argmin(high - low)), low.shape)
        return None, f"their logs have no {_QUANTITIES[quantity]} of {joints[joint]} in common"
    q, dq, ddq = np.moveaxis(np.random.default_rng(seed).uniform(low, high, (STATES, *low.shape)), 1, 0)
    states = Log(joints, np.arange(float(STATES)), q, dq, ddq)
    try:
        found = [RegressorStream(each.model, each.base).predict(states, each.beta) for each in estimates]
    except DynidentError as error:  # friction that asks for temperatures
        return None, str(error)
    sizes = np.sqrt([np.mean(torque**2, axis=0) for torque in found])
    gaps = np.sqrt([np.mean((torque - found[0]) ** 2, axis=0) for torque in found])
    return TorqueGap(sizes, gaps), ""
