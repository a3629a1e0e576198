"""KUKA: a module (.src and .dat) that goes to the first posture and drives a timed spline of axis points."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

from dynident.arrays import Array
from dynident.errors import BadOption, FileError
from dynident.exports.motions._motion import DrivenMotion
from dynident.exports.motions._printed import Decimals, Printed
from dynident.exports.motions._programs import (
    Axes,
    assign,
    clamped_cubic,
    degrees_and_mm,
    header_lines,
    name_notes,
    thinned,
)
from dynident.exports.motions.base import MotionContent, MotionExporter, ThinnedPoints
from dynident.exports.names_in_files import program_name

#: Digits after the point, in degrees and mm; per cent of the axis speed of the approach.
PLACES, SLOW = 5, 10

#: Longest name in KRL (KUKA, KRL syntax quick guide for KSS 8).
LONGEST = 24

_WORDS = frozenset(
    "AND ANIN ANOUT BAS BOOL BRAKE CASE CHAR CIRC CONST CONTINUE DECL DEF DEFAULT DEFDAT DEFFCT DELAY "
    "ELSE END ENDDAT ENDFCT ENDFOR ENDIF ENDLOOP ENDSPLINE ENDSWITCH ENDWHILE ENUM EXIT EXT EXTFCT FALSE "
    "FOR GLOBAL GOTO HALT IF IMPORT INT INTERRUPT LIN LOOP NOT OR PTP PUBLIC QP QS REAL REPEAT RESUME "
    "RETURN SCIRC SIGNAL SLIN SPL SPLINE SPTP STRUC SWITCH THEN TO TRIGGER TRUE UNTIL WAIT WHEN WHILE "
    "WITH EXOR AXIS E6AXIS FRAME POS E6POS".split()
)


@dataclass(frozen=True)
class Krl(MotionExporter):
    """KUKA .src and .dat (KSS 8.2 or newer): slow PTP to the first posture, then PTP_SPLINE with a TIME_BLOCK.

    Points are evenly spaced in time, as few as keep the cubic spline through them within the tolerance; how the
    controller itself interpolates is not published.

    Attributes:
        tolerance: Largest deviation of that spline from the design, in degrees, or mm of sliding joints.
        external: Joints, with commas, on the axes E1, E2, ...; empty puts those after the sixth there.
        most_points: Points that a spline may have.
    """

    tolerance: float = 0.01
    external: str = ""
    most_points: int = 1000

    suffix: ClassVar = ".src"
    rate: ClassVar = None
    moves_itself: ClassVar = True
    approach_in_samples: ClassVar = False

    def __post_init__(self) -> None:
        if not 0 < self.tolerance < np.inf:
            raise BadOption("tolerance", self.tolerance, "give degrees, above 0")
        if self.most_points < 16:
            raise BadOption("most_points", self.most_points, "give 16 or more")

    def content(self, subject: DrivenMotion, path: Path) -> MotionContent:
        if path.suffix.lower() != ".src":
            raise FileError(path, "no name for a KRL program", "give it the suffix .src; the .dat is written beside it")
        name = program_name(path, "KRL", LONGEST, _WORDS)
        axes, scale = assign(subject, self.external), degrees_and_mm(subject.revolute)
        time, points, deviation = thinned(subject, self.tolerance / scale, self.most_points, clamped_cubic)
        decimals = Decimals(scale, PLACES)
        texts = decimals.texts(points)
        printed = Printed(time, decimals.read(texts)[None], decimals.round_off[None])
        waypoint = None if subject.posture is None else decimals.texts(subject.posture[None])[0]
        away = dict(zip(subject.joints, (deviation * scale).tolist(), strict=True))
        files = {
            path: _text(self._source(subject, name, time, waypoint is not None, deviation * scale)),
            path.with_suffix(".dat"): _text(self._data(name, axes, texts, waypoint)),
        }
        figures = ThinnedPoints(self.tolerance, away, float(time[1]))
        note = (
            "the deviation is that of a cubic spline through the points: the controller's own spline is not published"
        )
        return MotionContent(files, printed, (*name_notes(subject), note), figures)

    def _source(self, subject: DrivenMotion, name: str, time: Array, by_posture: bool, away: Array) -> list[str]:
        own = (
            "A1.. and E1.. in degrees, sliding axes in mm. Needs KSS 8.2 or newer and a program override of 100 %.",
            "Load data are those that are set on the controller.",
            f"{len(time)} points each {time[1]:.6g} s, a cubic spline through them is off by {away.max():.3g} at most",
        )
        lines = [f"DEF {name}( )", *(f"; {line}" for line in header_lines(subject, *own))]
        lines += ["BAS(#INITMOV,0)", f"BAS(#VEL_PTP,{SLOW})", f"BAS(#ACC_PTP,{SLOW})"]
        lines += [*(["PTP QS"] if by_posture else []), "PTP QP[1]", "WAIT SEC 1.0"]
        most = int(np.ceil(100 * subject.speed - 1e-9))  # the spline is no faster even where its times are not kept
        lines += [f"BAS(#VEL_PTP,{most})", f"BAS(#ACC_PTP,{most})", "PTP_SPLINE", "TIME_BLOCK START"]
        part = f"{100 / (len(time) - 1):.6f}"
        for k in range(2, len(time) + 1):
            lines += [f"SPTP QP[{k}]", f"TIME_BLOCK PART = {part}"]
        return [*lines, f"TIME_BLOCK END = {time[-1]:.6f}", "ENDSPLINE", "END"]

    def _data(self, name: str, axes: Axes, texts: list[list[str]], waypoint: list[str] | None) -> list[str]:
        kind = "E6AXIS" if len(axes.external) else "AXIS"

        def value(row: list[str]) -> str:
            parts = [f"A{k + 1} {row[i]}" for k, i in enumerate(axes.robot)]
            return "{" + ",".join([*parts, *(f"E{k + 1} {row[i]}" for k, i in enumerate(axes.external))]) + "}"

        lines = [f"DEFDAT {name}", "EXT BAS (BAS_COMMAND :IN,REAL :IN )"]
        lines += [f"DECL {kind} QS={value(waypoint)}"] if waypoint is not None else []
        lines += [f"DECL {kind} QP[{len(texts)}]", *(f"QP[{k}]={value(row)}" for k, row in enumerate(texts, start=1))]
        return [*lines, "ENDDAT"]


def _text(lines: list[str]) -> bytes:
    """Return lines as the controller's editor writes them."""
    return ("\r\n".join(lines) + "\r\n").encode("ascii")
