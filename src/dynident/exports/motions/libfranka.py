"""Franka arms through libfranka: a 1 kHz table that meets the conditions of its motion generators, and its player."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

from dynident.arrays import Array
from dynident.errors import BadOption, FileError
from dynident.exports.motions._motion import APPROACH_SHARE, DrivenMotion
from dynident.exports.motions._printed import table
from dynident.exports.motions.base import MotionContent, MotionExporter, MotionFigures
from dynident.exports.names_in_files import template_parts

#: Joints of the arm, and commands a second.
JOINTS, RATE = 7, 1000.0

#: What differences of printed positions may be above a bound: rounding at this rate.
_ROUNDING = 1e-3


@dataclass(frozen=True)
class DifferenceFigures(MotionFigures):
    """Largest share of each bound that differences of the commands use."""

    used_by_differences: Mapping[str, float]


@dataclass(frozen=True)
class Libfranka(MotionExporter):
    """A table t, q1.., dq1.., ddq1.. at 1 kHz for joint motion generators; speed, acceleration and jerk need limits.

    Refused are motions that do not start and end with dq = ddq = 0 and plans without a limit of speed, acceleration or
    jerk of any joint, since the robot stops where its own are passed (Franka Robotics, robot specifications: necessary
    conditions of joint motions). The limits that count are the plan's.

    Attributes:
        player: Whether NAME_player.cpp is written as well: a C++ program that approaches, drives the table and records.
    """

    player: bool = False

    suffix: ClassVar = ".csv"
    rate: ClassVar = RATE
    moves_itself: ClassVar = False

    def content(self, subject: DrivenMotion, path: Path) -> MotionContent:
        if len(subject.joints) != JOINTS or not all(subject.revolute):
            raise BadOption("exporter", "libfranka", f"it takes {JOINTS} turning joints, not {len(subject.joints)}")
        if subject.rate != RATE:
            raise BadOption("rate", subject.rate, f"libfranka takes one command each ms: {RATE:g} Hz")
        limits = subject.plan.limits
        for name in ("velocity", "acceleration", "jerk"):
            for joint, bound in zip(subject.joints, getattr(limits, name), strict=True):
                if not np.isfinite(bound):
                    step = "state it in the robot model and design the motion again: the robot has one"
                    raise FileError(path, f"the plan has no limit for the {name} of {joint}", step)
        files: dict[Path, bytes] = {}
        way = subject.approach()
        if way is not None:
            files[path.with_name(f"{path.stem}-approach{path.suffix}")], printed = table(*way, np.ones(JOINTS))
            _check_differences(printed.signals[0], subject, path)
        files[path], printed = table(*subject.samples(), np.ones(JOINTS))
        used = _check_differences(printed.signals[0], subject, path)
        if self.player:
            slow = (APPROACH_SHARE * bound for bound in (limits.velocity, limits.acceleration, limits.jerk))
            files[path.with_name(f"{path.stem}_player.cpp")] = player_source(*slow)
        note = "libfranka refuses a motion that does not start where the robot is commanded to be (q_d)"
        return MotionContent(files, printed, (note,), DifferenceFigures(used))


def _check_differences(q: Array, subject: DrivenMotion, path: Path) -> dict[str, float]:
    """Return the largest share of each bound that differences of the commands use, rest before and after included.

    Raises:
        FileError: A bound is passed.
    """
    limits, used = subject.plan.limits, {}
    signal = np.vstack([q[[0]], q[[0]], q[[0]], q, q[[-1]], q[[-1]], q[[-1]]])
    for name in ("velocity", "acceleration", "jerk"):
        signal = np.diff(signal, axis=0) * RATE
        share = np.abs(signal).max(axis=0) / getattr(limits, name)
        worst = int(np.argmax(share))
        used[name] = float(share[worst])
        if share[worst] > 1 + _ROUNDING:
            evidence = (
                f"differences of the commands use {100 * share[worst]:.4g} % of the {name} of {subject.joints[worst]}"
            )
            raise FileError(path, f"not written, because {evidence}", "design the motion again with lower limits")
    return used


def player_source(speed: Array, acceleration: Array, jerk: Array) -> bytes:
    """Return the source of the player, with the limits of its approach, each (7,), in rad/s and derivatives."""
    (text,) = template_parts("franka_player.cpp")
    for name, values in (("SPEED", speed), ("ACCELERATION", acceleration), ("JERK", jerk)):
        text = text.replace(f"@{name}@", ", ".join(f"{value:.9e}" for value in values))
    return text.encode("ascii")
