"""Tables of a rehearsal: joints, parameters, and what more or less time would buy."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

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
from dynident.studies.selftest.rehearsal import LEVEL, MATTERS, Rehearsal, RehearsalStage

#: Chance of so few intervals that hold below which noise alone does not explain them.
UNLIKELY = 0.01

#: A parameter counts as found from this relative deviation on.
FOUND = 0.1


def joints_table(rehearsal: Rehearsal) -> Table:
    """Return the error of the predicted torque of each joint, for every length of the log."""
    robot = rehearsal.model.robot
    columns = [Column("joint"), *(Column(f"{stage.seconds:.3g} s", "%", True) for stage in rehearsal.stages)]
    rows = tuple(
        (label(name), *(format_percent(float(stage.torque_errors[i]), sign=False) for stage in rehearsal.stages))
        for i, name in enumerate(robot.joint_names)
    )
    note = "Test error of the predicted torque, on random states within the ranges of the log."
    return Table(tuple(columns), rows, note)


def parameters_table(rehearsal: Rehearsal, width: int | None = None) -> Table:
    """Return truth, value and deviation of each base parameter after the planned log, those that carry most first.

    Args:
        rehearsal: The rehearsal.
        width: Columns of a terminal that a name may take; None shows all.
    """
    stage = rehearsal.planned
    columns = columns_of(
        "base parameter", "unit", ">truth", ">found", ">std", ">rel. std [%]", ">off by [std]", ">of the torque [%]"
    )
    rows = tuple(_parameter_row(rehearsal, stage, int(k), width) for k in np.argsort(-rehearsal.weights, kind="stable"))
    note = "Of the torque: the largest share that the parameter has in the torque of a joint."
    return Table(columns, rows, note)


def _parameter_row(rehearsal: Rehearsal, stage: RehearsalStage, k: int, width: int | None) -> tuple[str, ...]:
    name = label(rehearsal.names[k])
    head = (name if width is None else shorten(name, width), pretty_unit(rehearsal.units[k]))
    weight = format_percent(float(rehearsal.weights[k]), sign=False)
    if stage.estimate is None:
        return (*head, format_number(float(stage.truth[k])), MISSING, MISSING, MISSING, MISSING, weight)
    deviation = float(stage.estimate.std[k])
    value, spread = format_value(float(stage.estimate.beta[k]), deviation)
    off = float(stage.errors[k]) / deviation if deviation > 0 else float("nan")
    relative = format_percent(float(stage.relative_std[k]), sign=False)
    return (*head, format_number(float(stage.truth[k])), value, spread, relative, format_number(off, 2), weight)


def lengths_table(rehearsal: Rehearsal) -> Table:
    """Return what logs of half to four times the planned length tell."""
    columns = columns_of(
        ">log [s]",
        ">of the plan",
        Column(f"found to {100 * FOUND:g} %", numeric=True),
        ">median rel. std [%]",
        ">worst torque [%]",
        ">95 % intervals that hold [%]",
        "verdict",
    )
    return Table(columns, tuple(_length_row(rehearsal, stage) for stage in rehearsal.stages))


def _length_row(rehearsal: Rehearsal, stage: RehearsalStage) -> tuple[str, ...]:
    head = (f"{stage.seconds:.3g}", f"{stage.share:g}")
    if stage.estimate is None:
        return (*head, f"0 of {len(stage.truth)}", MISSING, MISSING, MISSING, "nothing found")
    counts = rehearsal.weights >= MATTERS
    known = stage.relative_std
    return (
        *head,
        f"{int(np.sum(known[counts] <= FOUND))} of {int(counts.sum())}",
        format_percent(float(np.median(known[counts])), sign=False) if counts.any() else MISSING,
        format_percent(float(np.max(stage.torque_errors)), sign=False),
        format_percent(stage.inside, sign=False),
        "beyond tolerance" if rehearsal.complaints(stage) else "passes",
    )


def _chance_of(stage: RehearsalStage) -> float:
    """Return how likely so many intervals miss the truth, or more, if each misses it by chance; 1 without intervals."""
    count = len(stage.truth)
    if not stage.inside <= 1:
        return 1.0
    hold = round(stage.inside * count)
    return sum(math.comb(count, k) * LEVEL**k * (1 - LEVEL) ** (count - k) for k in range(hold + 1))


def left_behind(shares: Mapping[str, float], saturated: int) -> str:
    """Return which joints of a virtual cell do not follow, and what helps; ``saturated`` torques were cut."""
    joints = ", ".join(f"{label(joint)} ({format_percent(share, sign=False)} %)" for joint, share in shares.items())
    soft = "the controller of the cell is too soft for the friction there"
    step = f"{soft}: --set controller.feedforward=model, or a higher controller.bandwidth_hz or rate"
    if saturated:
        step = f"{saturated} torques were cut at the effort limits: a slower motion, or {step}"
    return f"not on the commanded motion (position error as a share of it): {joints}; {step}"


def verdict(rehearsal: Rehearsal) -> list[str]:
    """Return whether the plan passes, what is beyond the tolerance, and what would help."""
    complaints = rehearsal.complaints(rehearsal.planned)
    lines = []
    if rehearsal.left_behind:
        lines.append(left_behind(rehearsal.left_behind, rehearsal.saturated_torques))
    if _chance_of(rehearsal.stages[-1]) < UNLIKELY:
        held, length = format_percent(rehearsal.stages[-1].inside), rehearsal.stages[-1].seconds
        lines.append(
            f"after {length:.3g} s only {held} of the 95 % intervals hold the truth: what encoder noise, filter, "
            "delay, friction at reversals or effects of the cell do to the rows counts more than noise of the "
            "torque, and no longer log makes that smaller"
        )
    if not complaints:
        asked = f"{100 * rehearsal.tolerance.torque:g} % of the torque"
        return [*lines, f"passed: the planned log meets the tolerance of {asked}"]
    lines += ["not passed:", *(f"  {label(each)}" for each in complaints)]
    enough = rehearsal.enough
    if enough is not None:
        lines.append(f"a log of {enough:g} times the planned length passes (--repeats)")
    else:
        lines.append(
            "four times the planned length does not pass either: less noise, another motion, or more tolerance"
        )
    return lines
