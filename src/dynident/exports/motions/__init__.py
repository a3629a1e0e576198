"""Exporters of motions, a family: one target per part, and the verb that writes a plan for a controller."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from dynident.errors import BadOption
from dynident.excitation.design.limits import LimitRow, check_limits
from dynident.excitation.design.plan import Plan, refuse_breach
from dynident.exports.base import Proof, write_files
from dynident.exports.motions._motion import DrivenMotion, Playback
from dynident.exports.motions._printed import Printed
from dynident.exports.motions.base import MotionContent, MotionExporter, MotionFigures
from dynident.plugins import Family

MOTION_EXPORTERS: Family[MotionExporter] = Family(
    "dynident.exports.motions",
    MotionExporter,  # type: ignore[type-abstract]
    "exporter",
    aliases={"ros": "joint_trajectory", "ur": "urscript", "kuka": "krl", "abb": "rapid", "franka": "libfranka"},
)

__all__ = [
    "MOTION_EXPORTERS",
    "DrivenMotion",
    "MotionContent",
    "MotionExport",
    "MotionExporter",
    "Playback",
    "Printed",
    "export_motion",
    "motion_export_data",
]

#: In place of a posture: the robot stands at the first posture already.
START = "start"


def export_motion(
    plan: Plan,
    exporter: str | MotionExporter,
    path: str | Path,
    playback: Playback | None = None,
    *,
    write: bool = True,
) -> MotionExport:
    """Write a plan for a controller: every file whole or not at all, nothing where a bound is passed.

    Args:
        plan: The plan.
        exporter: Name of an exporter, or a part with its options.
        path: The file (for a bag: the folder) to write; further files stand beside it.
        playback: How it is to be driven; None: once, at the designed speed and the rate of the target.
        write: False checks and tells what would be written.

    Raises:
        UnknownChoice: No such exporter.
        BadOption: An option that cannot be, or a robot that does not fit the target.
        FileError: The plan passes a bound, a name the target cannot have, or a file that cannot be written.
    """
    target, part = Path(path), MOTION_EXPORTERS.make(exporter)
    playback, name = playback or Playback(), MOTION_EXPORTERS.name_of(part)
    if part.takes != "plan":
        raise BadOption("exporter", name, "it does not export plans; see 'dynident list motion_exporters'")
    refuse_breach(plan, target)
    motion = _driven(plan, part, name, playback)
    content = part.content(motion, target)
    proofs = part.prove(motion, content, target)
    if write:
        write_files(content.files, target)
    return MotionExport(
        exporter=name,
        robot=plan.robot,
        files=tuple(str(file) for file in content.files),
        rate=motion.rate,
        repeats=playback.repeats,
        speed=motion.speed,
        duration=motion.motion.duration,
        points=len(content.printed.time),
        approach=_approach(motion, part, name),
        rows=limit_rows(motion),
        round_off=dict(zip(plan.joints, content.printed.round_off[0].tolist(), strict=True)),
        plan_sha256=motion.plan_sha256,
        proofs=proofs,
        notes=content.notes,
        figures=content.figures,
    )


def _driven(plan: Plan, part: MotionExporter, name: str, playback: Playback) -> DrivenMotion:
    rate, posture = playback.rate, playback.from_posture
    if rate is not None and part.rate is None:
        step = f"{name} has no rate: its points are thinned to a tolerance; see 'dynident list motion_exporters'"
        raise BadOption("rate", rate, step)
    at_start = isinstance(posture, str)
    if at_start and posture != START:
        raise BadOption("from_posture", posture, f"give a position for each joint, or '{START}'")
    if posture is None and not part.moves_itself:
        step = (
            f"{name} holds samples only: state where the robot stands, and the approach is written as well, or give "
            f"'{START}' if it stands at the first posture"
        )
        raise BadOption("from_posture", None, step)
    given: Any = None if at_start else posture
    rate = part.rate if rate is None else rate
    return DrivenMotion(plan, rate, playback.repeats, playback.speed / 100.0, given, at_start)


def _approach(motion: DrivenMotion, part: MotionExporter, name: str) -> str:
    way = motion.approach()
    if way is not None and part.approach_in_samples:
        return f"quintic of {way[0][-1]:.6g} s from the stated posture"
    if motion.at_start and not part.moves_itself:
        return "none: the robot stands at the first posture"
    return f"a slow move of the controller ({name}){' by the stated posture' if motion.posture is not None else ''}"


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
