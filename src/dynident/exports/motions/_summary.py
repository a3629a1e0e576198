"""What was exported: files, length, points, worst values, round-off."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from dynident.excitation.design.limits import LimitRow, check_limits
from dynident.exports.base import Proof
from dynident.exports.motions._motion import DrivenMotion
from dynident.exports.motions.base import MotionFigures


@dataclass(frozen=True)
class MotionExport:
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
        proofs: How far the printed positions are from those of the plan.
        notes: What the reader has to know.
        figures: Of the target.
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
    proofs: tuple[Proof, ...]
    notes: tuple[str, ...]
    figures: MotionFigures


def motion_export_data(export: MotionExport) -> dict[str, Any]:
    """Return an export as plain data: what ``dynident export --json`` prints."""
    data = asdict(export)
    del data["figures"]
    data["rows"] = [{**asdict(row), "limit": row.limit if np.isfinite(row.limit) else None} for row in export.rows]
    for key in ("files", "notes", "proofs"):
        data[key] = list(data[key])
    data["facts"], data["round_off"] = export.figures.data(), dict(export.round_off)
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
