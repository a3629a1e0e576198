"""What was exported: files, length, points, worst values, round-off; and the check of the printed samples."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from dynident.errors import FileError
from dynident.experiment.design.limits import TOLERANCE, LimitRow, check_limits
from dynident.results.exporters._motion import DrivenMotion
from dynident.results.exporters.base import Printed

#: Largest error in s that printed times may have: ROS counts nanoseconds.
CLOCK = 1e-9


@dataclass(frozen=True)
class Export:
    """What an export wrote, or would write.

    Attributes:
        exporter: Name of the exporter.
        robot: Name of the robot.
        files: The files, in the order of their use.
        rate: Samples a second; None where the points are thinned.
        repeats: Number of periods.
        speed: Share of the designed speed.
        duration: Length of the motion in s, without the approach.
        points: Number of postures of the motion.
        approach: How the first posture is reached.
        rows: The worst of every quantity at this speed, with the plan's bounds; torques at full speed only.
        round_off: Largest error of the printed positions by joint, in rad or m.
        plan_sha256: Hash of the plan's file.
        notes: What the reader has to know.
        facts: Plain figures of the target.
    """

    exporter: str
    robot: str
    files: tuple[str, ...]
    rate: float | None
    repeats: int
    speed: float
    duration: float
    points: int
    approach: str
    rows: tuple[LimitRow, ...]
    round_off: Mapping[str, float]
    plan_sha256: str
    notes: tuple[str, ...]
    facts: Mapping[str, Any]


def export_data(export: Export) -> dict[str, Any]:
    """Return an export as plain data: what ``dynident export --json`` prints."""
    data = asdict(export)
    data["rows"] = [{**asdict(row), "limit": row.limit if np.isfinite(row.limit) else None} for row in export.rows]
    for key in ("files", "notes"):
        data[key] = list(data[key])
    data["facts"], data["round_off"] = dict(export.facts), dict(export.round_off)
    return data


def limit_rows(motion: DrivenMotion) -> tuple[LimitRow, ...]:
    """Return the worst of every quantity at the exported speed, as far as it is known without a model.

    Position to jerk are computed again. Distances are those of the plan, since the path is the same; torques and their
    rates are those of the plan at full speed, and left out below.
    """
    samples = int(np.ceil((motion.plan.samples - 1) * motion.motion.duration / motion.plan.motion().duration)) + 1
    rows = check_limits(motion.motion, motion.plan.limits, samples)
    again = {row.quantity for row in rows}
    kept = [
        replace(row, time=row.time / motion.speed)
        for row in motion.plan.rows
        if row.quantity not in again and (motion.speed == 1.0 or row.quantity == "clearance")
    ]
    return (*rows, *kept)


def check_printed(motion: DrivenMotion, printed: Printed, path: Path) -> None:
    """Refuse printed samples that are not those of the motion, pass a bound or do not start and end at rest.

    Raises:
        FileError: One of these, by more than the printed digits explain.
    """
    step = "report it with the plan: nothing was written"
    if not (np.all(np.isfinite(printed.time)) and np.all(np.isfinite(printed.signals))):
        raise FileError(path, "a printed sample is not a finite number", step)
    all_four = np.stack([*motion.motion.evaluate(printed.time), motion.motion.jerk(printed.time)])
    exact, slopes = all_four[: len(printed.signals)], np.abs(all_four[1:]).max(axis=1, keepdims=True)
    rounding = TOLERANCE * np.maximum(1.0, np.abs(exact).max(axis=1, keepdims=True))
    room = 1.001 * printed.round_off[:, None, :] + rounding + CLOCK * slopes[: len(exact)]
    if np.any(np.abs(printed.signals - exact) > room):
        raise FileError(path, "the printed samples are not those of the plan", step)
    limits = motion.plan.limits
    bounds = limits.bounds()[: len(printed.signals), None, :] * (1 + TOLERANCE)
    away = np.abs(printed.signals)
    away[0] = np.abs(printed.signals[0] - limits.centre)
    if np.any(away > bounds + room):
        raise FileError(path, "a printed sample passes a bound of the plan", step)
    ends = np.stack(motion.motion.evaluate([0.0, motion.motion.duration]))[1:]
    still = 1e-6 * np.maximum(1.0, np.abs(exact).max())
    if np.any(np.abs(ends) > still) or np.any(np.abs(printed.signals[1:, [0, -1]]) > 0):
        raise FileError(path, "the motion does not start and end at rest", "design the motion again")
