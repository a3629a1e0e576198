"""A plan that is looked at: the plan, its check and the robot, as facts and tables for the terminal and the report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from dynident.arrays import Array, finite
from dynident.excitation.collision.clearance import Clearance
from dynident.excitation.collision.workspace import Workspace
from dynident.excitation.criteria import CRITERIA
from dynident.excitation.design.bounds import BoundLabel
from dynident.excitation.design.limits import LimitRow
from dynident.excitation.design.parametrisation import kind_of
from dynident.excitation.design.plan import Plan
from dynident.excitation.design.recheck import Recheck
from dynident.model.dynamic_model import DynamicModel
from dynident.model.robot import Robot
from dynident.results.text import (
    MISSING,
    Column,
    Table,
    columns_of,
    format_given,
    format_number,
    format_percent,
    label,
    plain_value,
    pretty_unit,
    shorten,
)

#: Pairs of shapes that are listed, the nearest ones, and parameters, the least known ones.
PAIRS, WORST = 10, 10

#: Settings that are shown in words of their own.
_TOLD = ("outlook", "trajectory", "period", "harmonics", "noise", "criterion_options", "torque_limits", "noise_source")
_TOLD += ("starts", "seed", "best_start", "evaluations", "samples", "seconds")


@dataclass(frozen=True)
class PlanView:
    """A plan with what is needed to show it.

    Attributes:
        plan: The plan.
        check: Its check, made again.
        robot: The robot, for the path of its tool; None where only the plan is at hand.
        model: The model of the torques; None to leave them out.
        theta: Parameters of the torques, shape (p,); None where none are known.
        workspace: What stands around; None where nothing is stated.
        clearance: The distances that were checked; None where none were.
        torques: Whose the torques are that were computed again, in words; empty where none were.
        source: File of the plan.
    """

    plan: Plan
    check: Recheck
    robot: Robot | None = None
    model: DynamicModel | None = None
    theta: Array | None = None
    workspace: Workspace | None = None
    clearance: Clearance | None = None
    torques: str = ""
    source: str = ""


def plan_facts(view: PlanView) -> list[tuple[str, str]]:
    """Return what a plan is, as names and values."""
    plan, facts = view.plan, view.plan.settings
    kind = f"{kind_of(plan.trajectory)}, {plan.trajectory.detail}, period {plan.trajectory.period:g} s"
    ends = f"run-in and run-out of {plan.run_in:g} s" if plan.run_in else "starts and ends at rest"
    found = [
        ("robot", f"{label(plan.robot)}, {len(plan.joints)} joints"),
        ("trajectory", f"{kind}, {ends}; {plan.motion().duration:g} s from rest to rest"),
        ("criterion", label(plan.criterion)),
        ("noise", _noise(plan)),
        ("torque limits", plain_value(facts.get("torque_limits"))),
    ]
    options = facts.get("criterion_options")
    if options:
        found.insert(3, ("options of the criterion", plain_value(options)))
    found.append(("search", _search(facts)))
    found += [(label(key).replace("_", " "), plain_value(value)) for key, value in facts.items() if key not in _TOLD]
    return [(name, value) for name, value in found if value != MISSING]


def _search(facts: Mapping[str, Any]) -> str:
    """Return what the search was, in a line."""
    words = {
        "starts": "starts {}",
        "seed": "seed {}",
        "best_start": "best start {}",
        "evaluations": "{} evaluations",
        "samples": "on {} samples a period",
        "seconds": "in {} s",
    }
    shown = {
        key: round(facts[key], 1) if isinstance(facts[key], float) else facts[key] for key in words if key in facts
    }
    return ", ".join(words[key].format(plain_value(value)) for key, value in shown.items()) or MISSING


def _noise(plan: Plan) -> str:
    source, levels = plan.settings.get("noise_source"), plan.settings.get("noise")
    units = dict.fromkeys(plan.limits.unit("torque", i) for i in range(len(plan.joints)))
    shown = f"{plain_value(levels)} {' or '.join(pretty_unit(unit) for unit in units)}" if levels else ""
    return "; ".join(text for text in (plain_value(source), shown) if text and text != MISSING) or MISSING


def verdict(view: PlanView) -> str:
    """Return in a sentence whether the motion keeps its bounds."""
    check = view.check
    if not check.rows:
        return "Nothing is bounded."
    worst = check.worst
    what = f"the {BoundLabel(label(worst.joint), worst.quantity).text}"
    value = (
        f"{format_number(worst.value)} of {format_given(worst.limit)} {pretty_unit(worst.unit)} at {worst.time:.2f} s"
    )
    if check.kept:
        return f"Every bound is kept; nearest to its own is {what}: {value}."
    broken = sum(not row.kept for row in check.rows)
    return f"{broken} bound{'s are' if broken > 1 else ' is'} passed, worst {what}: {value}. Do not drive it."


def criteria_table(view: PlanView) -> Table:
    """Return the figures of all criteria: those of the file, those computed again, and which way is better."""
    return figures_table(view.plan, view.check.values)


def figures_table(plan: Plan, again: Mapping[str, float] | None = None) -> Table:
    """Return the figures of a plan, which way is better, and beside them those computed again where there are some."""
    known = CRITERIA.names()
    rows = tuple(
        (
            label(name) + (" (designed for)" if name == plan.criterion else ""),
            format_number(value),
            *([format_number(again[name]) if name in again else MISSING] if again else []),
            MISSING if name not in known else "larger" if CRITERIA.get(name).larger_is_better else "smaller",
        )
        for name, value in plan.values.items()
    )
    columns = [Column("criterion"), Column("value", numeric=True), Column("better")]
    if again:
        columns.insert(2, Column("again", numeric=True))
    return Table(tuple(columns), rows)


def limits_table(view: PlanView) -> Table:
    """Return the worst of every quantity of every joint, and of the tool, with which were checked again."""
    shown = [
        (row, own) for row, own in zip(view.check.rows, view.check.again, strict=True) if row.quantity != "clearance"
    ]
    note = f"Checked at {view.plan.samples} samples from rest to rest, margins taken off."
    return rows_table([row for row, _ in shown], note, ["again" if own else "by the file" for _, own in shown])


def rows_table(rows: Sequence[LimitRow], note: str, checked: Sequence[str] | None = None) -> Table:
    """Return the rows of a check of limits as a table.

    Args:
        rows: The worst of each quantity.
        note: What the table is of.
        checked: How each row was checked, as a last column; None leaves it out.
    """
    heads = ("joint", "quantity", "worst", "bound", "unit", "used [%]", "at [s]", "checked")
    columns = tuple(Column(head, numeric=head in (*heads[2:4], *heads[5:7])) for head in heads)
    cells = tuple(
        (
            label(row.joint),
            row.quantity,
            format_number(row.value),
            format_given(row.limit),
            pretty_unit(row.unit),
            f"{100 * row.used:.1f}" if row.used else MISSING,
            f"{row.time:.2f}",
        )
        for row in rows
    )
    if checked is None:
        return Table(columns[:-1], cells, note)
    return Table(columns, tuple((*cell, how) for cell, how in zip(cells, checked, strict=True)), note)


def nearest(view: PlanView) -> tuple[LimitRow, ...]:
    """Return the pairs of shapes that come nearest to their required distance, the nearest first."""
    return view.check.clearances[:PAIRS]


def clearance_table(view: PlanView) -> Table:
    """Return the pairs of shapes that come nearest, numbered as in the picture of the path."""
    columns = columns_of(">#", "pair", ">distance [m]", ">required [m]", ">at [s]")
    found = nearest(view)
    rows = tuple(
        (str(k), label(row.joint), f"{row.value:.4f}", format_given(row.limit), f"{row.time:.2f}")
        for k, row in enumerate(found, start=1)
    )
    more = len(view.check.clearances) - len(found)
    further = f" {more} pairs stay further apart." if more else ""
    return Table(columns, rows, f"The distance is what is certain, between the samples too.{further}")


def outlook_table(plan: Plan, width: int | None = None) -> Table | None:
    """Return the standard deviations that are expected after the run, the least known first; None where none are known.

    Args:
        plan: The plan.
        width: Columns of a terminal that a name may take; None shows all.
    """
    outlook = plan.settings.get("outlook")
    if not (isinstance(outlook, Mapping) and outlook.get("parameters")):
        return None
    before = outlook.get("before", "nothing") != "nothing"
    found = sorted(outlook["parameters"], key=lambda item: -_relative(item, "std_after"))
    rows = tuple(
        (
            label(item["name"]) if width is None else shorten(label(item["name"]), width),
            MISSING if item["value"] is None else format_number(item["value"]),
            MISSING if item["std_after"] is None else format_number(item["std_after"], 2),
            pretty_unit(item["unit"]),
            *[_share(_relative(item, key)) for key in (("std_before", "std_after") if before else ("std_after",))],
        )
        for item in found[:WORST]
    )
    relative = ("before", "after") if before else ("rel. std",)
    columns = columns_of(
        "base parameter", ">value", ">std", "unit", *(Column(name, "%", numeric=True) for name in relative)
    )
    count = f"the {len(rows)} least known of {len(found)} base parameters" if len(found) > len(rows) else "all"
    known = f"; known before: {label(outlook['before'])}" if before else ""
    note = f"Expected from {outlook['effective_sample_size']:.0f} independent samples of each joint, {count}{known}."
    return Table(columns, rows, note)


def _relative(item: Mapping[str, Any], key: str) -> float:
    value, deviation = item["value"], item[key]
    return float("inf") if not value or deviation is None else abs(deviation / value)


def _share(relative: float) -> str:
    return format_percent(relative, sign=False) if np.isfinite(relative) else "unknown"


def plan_remarks(view: PlanView) -> list[str]:
    """Return sentences on how it was checked and what was not."""
    said = list(view.check.remarks)
    if view.torques:
        said.append(f"torques: computed again with {view.torques}")
    if view.clearance is not None:
        said += [f"clearance: {line}" for line in view.clearance.summary()[1:]]
    elif not view.check.clearances:
        said.append("not checked: floor, obstacles, the robot itself (no workspace was given)")
    missing = [name for name in ("torque", "torque rate") if not any(row.quantity == name for row in view.check.rows)]
    if missing:
        said.append(f"not checked: {', '.join(missing)}")
    free = sorted({row.quantity for row in view.check.rows if not np.isfinite(row.limit)})
    if free:
        said.append(f"not bounded, as no limit is stated: {', '.join(free)} of some joint")
    return said


def inspection_data(view: PlanView) -> dict[str, Any]:
    """Return a plan and its check as plain data, what ``dynident inspect plan.json --json`` prints."""
    plan, check = view.plan, view.check
    return {
        "kind": "plan",
        "robot": plan.robot,
        "joints": list(plan.joints),
        "trajectory": {
            "kind": kind_of(plan.trajectory),
            "detail": plan.trajectory.detail,
            "period": plan.trajectory.period,
            "run_in": plan.run_in,
            "duration": plan.motion().duration,
        },
        "criterion": plan.criterion,
        "values": [
            {"name": name, "file": finite(value), "again": finite(check.values.get(name, float("nan")))}
            for name, value in plan.values.items()
        ],
        "kept": check.kept,
        "samples": plan.samples,
        "rows": [
            {**asdict(row), "limit": finite(row.limit), "again": again}
            for row, again in zip(check.rows, check.again, strict=True)
        ],
        "findings": list(check.findings),
        "remarks": plan_remarks(view),
        "settings": dict(plan.settings),
    }
