"""ABB: a RAPID module that goes to the first posture and drives timed joint targets."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

from dynident.arrays import Array
from dynident.errors import BadOption
from dynident.exports.motions._motion import DrivenMotion
from dynident.exports.motions._printed import Decimals, Printed
from dynident.exports.motions._programs import (
    EXTERNAL_AXES,
    ROBOT_AXES,
    Axes,
    assign,
    degrees_and_mm,
    header_lines,
    linear,
    name_notes,
    thinned,
)
from dynident.exports.motions.base import MotionContent, MotionExporter, ThinnedPoints
from dynident.exports.names_in_files import program_name

#: Digits after the point in degrees and mm; longest name, less the four letters of ``run_`` (RAPID: 32).
PLACES, LONGEST = 5, 28

#: What stands for an external axis that is not there.
NO_AXIS = "9E9"

_ZONES = ("z0", "z1", "z5", "z10", "z15", "z20", "z30", "z40", "z50", "z60", "z80", "z100", "z150", "z200")

_WORDS = frozenset(
    "ALIAS AND BACKWARD CASE CONNECT CONST DEFAULT DIV DO ELSE ELSEIF ENDFOR ENDFUNC ENDIF ENDMODULE "
    "ENDPROC ENDRECORD ENDTEST ENDTRAP ENDWHILE ERROR EXIT FALSE FOR FROM FUNC GOTO IF INOUT LOCAL MOD "
    "MODULE NOSTEPIN NOT NOVIEW OR PERS PROC RAISE READONLY RECORD RETRY RETURN STEP SYSMODULE TEST THEN "
    "TO TRAP TRUE TRYNEXT UNDO VAR VIEWONLY WHILE WITH XOR MAIN QS QP SLOW I FINE TOOL0 V1000 NUM BOOL STRING".split()
)


@dataclass(frozen=True)
class ZonedPoints(ThinnedPoints):
    """Thinned points with the zone in which the controller rounds them."""

    zone: str


@dataclass(frozen=True)
class Rapid(MotionExporter):
    """RAPID module: slow MoveAbsJ to the first posture, then MoveAbsJ with a time and a zone from point to point.

    The controller moves straight in joints between points and rounds their corners, so that speeds are in steps; for
    the designed accelerations stream the samples by EGM.

    Attributes:
        tolerance: Largest deviation of the straight lines between points, in degrees, or mm of sliding joints.
        zone: Zone at the points, z0 to z200.
        external: Joints, with commas, on the axes eax_a, eax_b, ...; empty puts those after the sixth there.
        most_points: Points that a module may have.
    """

    tolerance: float = 0.2
    zone: str = "z1"
    external: str = ""
    most_points: int = 2000

    suffix: ClassVar = ".mod"
    rate: ClassVar = None
    moves_itself: ClassVar = True
    approach_in_samples: ClassVar = False

    def __post_init__(self) -> None:
        if not 0 < self.tolerance < np.inf:
            raise BadOption("tolerance", self.tolerance, "give degrees, above 0")
        if self.zone not in _ZONES:
            raise BadOption("zone", self.zone, f"give one of: {', '.join(_ZONES)}")
        if self.most_points < 16:
            raise BadOption("most_points", self.most_points, "give 16 or more")

    def content(self, subject: DrivenMotion, path: Path) -> MotionContent:
        name = program_name(path, "RAPID", LONGEST, _WORDS)
        axes, scale = assign(subject, self.external), degrees_and_mm(subject.revolute)
        time, points, deviation = thinned(subject, self.tolerance / scale, self.most_points, linear)
        decimals = Decimals(scale, PLACES)
        texts = decimals.texts(points)
        printed = Printed(time, decimals.read(texts)[None], decimals.round_off[None])
        waypoint = None if subject.posture is None else decimals.texts(subject.posture[None])[0]
        lines = self._module(subject, name, axes, texts, waypoint, time, float((deviation * scale).max()))
        away = dict(zip(subject.joints, (deviation * scale).tolist(), strict=True))
        figures = ZonedPoints(self.tolerance, away, float(time[1]), self.zone)
        note = "speeds are in steps from point to point; what zones cut off is not counted in the deviation"
        data = ("\r\n".join(lines) + "\r\n").encode("ascii")
        return MotionContent({path: data}, printed, (*name_notes(subject), note), figures)

    def _module(
        self,
        subject: DrivenMotion,
        name: str,
        axes: Axes,
        texts: list[list[str]],
        waypoint: list[str] | None,
        time: Array,
        away: float,
    ) -> list[str]:
        own = (
            "robax and eax in degrees, sliding axes in mm. Needs a speed override of 100 %.",
            f"{len(texts)} points each {time[1]:.6g} s, straight lines between them are off by {away:.3g} at most",
        )
        targets = [_target(row, axes) for row in texts]
        lines = [f"MODULE {name}", *(f"  ! {line}" for line in header_lines(subject, *own))]
        lines += ["  LOCAL CONST speeddata slow:=[50,10,50,10];"]
        if waypoint is not None:
            lines += [f"  LOCAL PERS jointtarget qs:={_target(waypoint, axes)};"]
        lines += [f"  LOCAL PERS jointtarget qp{{{len(targets)}}}:=[", *(f"    {t}," for t in targets[:-1])]
        lines += [f"    {targets[-1]}];", f"  PROC run_{name}()"]
        lines += ["    MoveAbsJ qs\\NoEOffs, slow, fine, tool0;"] if waypoint is not None else []
        step = f"{time[1]:.6f}"
        return [
            *lines,
            "    MoveAbsJ qp{1}\\NoEOffs, slow, fine, tool0;",
            "    WaitTime 1;",
            f"    FOR i FROM 2 TO {len(targets) - 1} DO",
            f"      MoveAbsJ qp{{i}}\\NoEOffs, v1000\\T:={step}, {self.zone}, tool0;",
            "    ENDFOR",
            f"    MoveAbsJ qp{{{len(targets)}}}\\NoEOffs, v1000\\T:={step}, fine, tool0;",
            "  ENDPROC",
            "ENDMODULE",
        ]


def _target(row: list[str], axes: Axes) -> str:
    """Return a jointtarget: six robot axes, of which those that are not there stand at 0, and six external ones."""
    robot = [row[i] for i in axes.robot] + ["0"] * (ROBOT_AXES - len(axes.robot))
    external = [row[i] for i in axes.external] + [NO_AXIS] * (EXTERNAL_AXES - len(axes.external))
    return f"[[{','.join(robot)}],[{','.join(external)}]]"
