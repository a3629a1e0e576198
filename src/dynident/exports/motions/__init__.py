"""Exporters of motions, a family: one target per part, and the verb that writes a plan for a controller."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from dynident.errors import BadOption
from dynident.excitation.design.plan import Plan, refuse_breach
from dynident.exports.base import write_files
from dynident.exports.motions._motion import DrivenMotion, Playback
from dynident.exports.motions._printed import Printed
from dynident.exports.motions._summary import MotionExport, limit_rows, motion_export_data
from dynident.exports.motions.base import MotionContent, MotionExporter
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
