"""Positions against limits: degrees, joints that never move, rows at rest."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from dynident.estimation.doctor.base import Check, Finding, Subject, listed

#: How far a joint may leave its limits, in rad or m, before it is told.
BEYOND = 0.05

#: Positions of a revolute joint beyond this many rad are degrees where no limit is stated: three turns.
TURNS = 6 * np.pi

#: Degrees of travel below which a log is of an arm at rest, in whatever unit.
MOVES = 0.2

#: A joint that travels less than this, in rad or m, over the whole log does not move.
STILL = 1e-3

#: Share of the rows below the speed of standstill above which little of the log counts.
MOSTLY_AT_REST = 0.5


@dataclass(frozen=True)
class PositionRange(Check):
    """Units of the positions by the limits of the joints, joints that stand still, share of rows at rest."""

    stage: ClassVar[int] = 1

    def findings(self, subject: Subject) -> Sequence[Finding]:
        radians = _radians(subject)
        return radians or [*_limits(subject), *_still(subject)]


def _radians(subject: Subject) -> list[Finding]:
    """Return whether positions declared as degrees are radians: no joint leaves a turn's worth of them, all move."""
    robot, q = subject.case.robot, subject.sound.log.q
    turning = [k for k, joint in enumerate(robot.active) if joint.kind == "revolute"]
    if subject.raw.columns.units.position != "deg" or not turning:
        return []
    stated = np.rad2deg(q[:, turning])
    largest, travel = float(np.abs(stated).max()), float(np.ptp(stated, axis=0).max())
    if largest > 2 * np.pi or travel < MOVES:
        return []
    limits = [robot.active[k].limits for k in turning]
    low, high = stated.min(axis=0), stated.max(axis=0)
    inside = [one.lower - BEYOND <= a and b <= one.upper + BEYOND for one, a, b in zip(limits, low, high, strict=True)]
    if not all(inside):
        return []
    evidence = f"positions declared as degrees stay within {largest:.3g} of zero; as radians they keep the limits too"
    remedy = "state the unit in the case file (log: units: {position: rad})"
    explains = ("velocity unit", "velocity scale", "joint never moved", "standstill", "too little motion")
    return [Finding("error", "positions in radians", "", evidence, remedy, {"largest": largest}, explains)]


def _limits(subject: Subject) -> list[Finding]:
    robot, q = subject.case.robot, subject.sound.log.q
    degrees, names, beyond, far = [], [], [], 0.0
    for joint, column in zip(robot.active, q.T, strict=True):
        low, high = float(column.min()), float(column.max())
        lower, upper = joint.limits.lower, joint.limits.upper
        away = max(lower - high, low - upper, lower - low, high - upper)
        largest = max(abs(low), abs(high))
        widest = max(abs(lower), abs(upper))
        turned = np.deg2rad(low) >= lower - BEYOND and np.deg2rad(high) <= upper + BEYOND
        if joint.kind == "revolute" and turned and largest > (3 * max(widest, 1.0) if np.isfinite(widest) else TURNS):
            degrees.append(joint.name)
        if away > BEYOND:
            names.append(joint.name)
            beyond.append(f"{joint.name} {low:.4g} to {high:.4g} (limits {lower:.4g} to {upper:.4g})")
            far = max(far, away)
    if degrees:
        largest = float(np.abs(q).max())
        evidence = f"positions up to {largest:.4g} rad where the limits are a few rad; as degrees they keep the limits"
        remedy = "state the unit in the case file (log: units: {position: deg})"
        explains = ("joint limits", "velocity mismatch", "velocity unit")
        return [
            Finding("error", "positions in degrees", listed(degrees), evidence, remedy, {"largest": largest}, explains)
        ]
    if not beyond:
        return []
    remedy = "check unit, zero, sign and order of the joints (log: units, columns)"
    return [Finding("warning", "joint limits", listed(names), "; ".join(beyond), remedy, {"beyond": far})]


def _still(subject: Subject) -> list[Finding]:
    log, robot = subject.sound.log, subject.case.robot
    travel = np.quantile(log.q, 0.995, axis=0) - np.quantile(log.q, 0.005, axis=0)
    still = [name for name, way in zip(robot.joint_names, travel, strict=True) if way < STILL]
    if still:
        evidence = f"it travels at most {travel.min():.2g} rad (or m) over the whole log"
        remedy = "record a motion of it, or lock it where it stands (locked: in the case file)"
        numbers = {"travel": float(travel.min())}
        return [Finding("error", "joint never moved", listed(still), evidence, remedy, numbers, ("standstill",))]
    window = max(1, min(round(0.05 * log.rate), len(log.q) - 1))  # logs of a few rows too
    speed = np.abs(log.q[window:] - log.q[:-window]) / (log.time[window:] - log.time[:-window])[:, None]
    rest = float(np.mean(np.all(speed < subject.case.preprocessing.standstill, axis=1)))
    if rest <= MOSTLY_AT_REST:
        return []
    evidence = f"all joints are at rest in {100 * rest:.0f} % of the rows"
    remedy = "such rows count little (preprocessing: rest: mask); record more motion"
    return [Finding("warning", "standstill", "", evidence, remedy, {"share": rest})]
