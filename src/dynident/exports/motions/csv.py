"""Samples as a CSV table, with a file of facts beside it."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from dynident.arrays import Array
from dynident.excitation.design.limits import UNITS
from dynident.exports.motions._motion import DrivenMotion
from dynident.exports.motions._printed import table
from dynident.exports.motions.base import MotionContent, MotionExporter


@dataclass(frozen=True)
class CsvSamples(MotionExporter):
    """A table t, q1.., dq1.., ddq1.. with twelve digits at any rate, and FILE.json with names, units, limits and hash.

    Attributes:
        degrees: Whether turning joints are in degrees and their derivatives in place of radians.
    """

    degrees: bool = False

    suffix: ClassVar = ".csv"
    rate: ClassVar = 1000.0
    moves_itself: ClassVar = False

    def content(self, subject: DrivenMotion, path: Path) -> MotionContent:
        scale = np.where(np.array(subject.revolute) & self.degrees, 180 / np.pi, 1.0)
        files: dict[Path, bytes] = {}
        way = subject.approach()
        before = path.with_name(f"{path.stem}-approach{path.suffix}")
        if way is not None:
            files[before], _ = table(*way, scale)
        files[path], printed = table(*subject.samples(), scale)
        facts = self._facts(subject, len(printed.time), before.name if way is not None else None, scale)
        beside = path.with_name(f"{path.name}.json")
        files[beside] = (json.dumps(facts, indent=1, allow_nan=False) + "\n").encode()
        return MotionContent(files, printed)

    def _facts(self, subject: DrivenMotion, rows: int, approach: str | None, scale: Array) -> dict[str, Any]:
        limits = subject.plan.limits
        units = [
            [unit.replace("rad", "deg") if s != 1 else unit for unit in subject_units(subject, i)]
            for i, s in enumerate(scale)
        ]
        bounds = {
            name: [float(v) if np.isfinite(v) else None for v in getattr(limits, name) * scale]
            for name in ("lower", "upper", "velocity", "acceleration", "jerk")
        }
        return {
            "kind": "dynident motion",
            "format": 1,
            "robot": subject.plan.robot,
            "plan_sha256": subject.plan_sha256,
            "columns": {"t": "s"}
            | {f"{name}{i + 1}": unit[k] for k, name in enumerate(("q", "dq", "ddq")) for i, unit in enumerate(units)},
            "joints": [
                {"name": name, "kind": "revolute" if turns else "prismatic"}
                for name, turns in zip(subject.joints, subject.revolute, strict=True)
            ],
            "limits": bounds,
            "rate_hz": subject.rate,
            "rows": rows,
            "duration_s": subject.motion.duration,
            "repeats": subject.repeats,
            "speed": subject.speed,
            "approach": approach,
        }


def subject_units(subject: DrivenMotion, joint: int) -> tuple[str, ...]:
    """Return the SI units of q, dq and ddq of a joint."""
    return tuple(UNITS[name][0 if subject.revolute[joint] else 1] for name in ("position", "velocity", "acceleration"))
