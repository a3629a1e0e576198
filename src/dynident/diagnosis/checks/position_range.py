"""Positions against limits: degrees, joints that never move, samples at rest."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from dynident.case.evidence.positions import LARGEST_TURN, STILL, is_plausible, is_within, travel
from dynident.diagnosis.checks.base import Check, CheckedLog
from dynident.diagnosis.finding import Finding, listed
from dynident.identification.problem.problem import rest_speeds

#: Degrees of travel below which a log is of an arm at rest, in whatever unit.
MOVES = 0.2

#: Share of the rows below the speed of standstill above which little of the log counts.
MOSTLY_AT_REST = 0.5


@dataclass(frozen=True)
class PositionRange(Check):
    """Units of the positions by the joint limits, joints that do not move, share of samples at rest."""

    stage: ClassVar[int] = 1

    def findings(self, subject: CheckedLog) -> Sequence[Finding]:
        radians = _radians(subject)
        return radians or [*_limits(subject), *_still(subject)]


def _radians(subject: CheckedLog) -> list[Finding]:
    """Return whether positions declared as degrees are radians: no joint leaves a turn's worth of them, all move."""
    robot, q = subject.case.robot, subject.sound.log.q
    turning = [k for k, joint in enumerate(robot.active) if joint.kind == "revolute"]
    if subject.raw.columns.units.position != "deg" or not turning:
        return []
    stated = np.rad2deg(q[:, turning])
    largest, farthest = float(np.abs(stated).max()), float(np.ptp(stated, axis=0).max())
    if largest > 2 * np.pi or farthest < MOVES:
        return []
    joints = [robot.active[k] for k in turning]
    if not all(map(is_plausible, joints, stated.min(axis=0).tolist(), stated.max(axis=0).tolist())):
        return []
    evidence = (
        f"positions declared as degrees stay within {largest:.3g} of zero; read as radians they also keep the limits"
    )
    remedy = "state the unit in the case file (log: units: {position: rad})"
    explains = ("velocity unit", "velocity scale", "joint never moved", "standstill", "too little motion")
    return [Finding("error", "positions in radians", "", evidence, remedy, {"largest": largest}, explains)]


def _limits(subject: CheckedLog) -> list[Finding]:
    robot, q = subject.case.robot, subject.sound.log.q
    degrees, names, beyond, far = [], [], [], 0.0
    for joint, column in zip(robot.active, q.T, strict=True):
        low, high = float(column.min()), float(column.max())
        lower, upper = joint.limits.lower, joint.limits.upper
        away = max(lower - high, low - upper, lower - low, high - upper)
        largest = max(abs(low), abs(high))
        widest = max(abs(lower), abs(upper))
        turned = is_within(joint, float(np.deg2rad(low)), float(np.deg2rad(high)))
        usual = 3 * max(widest, 1.0) if np.isfinite(widest) else LARGEST_TURN
        if joint.kind == "revolute" and turned and largest > usual:
            degrees.append(joint.name)
        if not is_within(joint, low, high):
            names.append(joint.name)
            beyond.append(f"{joint.name} {low:.4g} to {high:.4g} (limits {lower:.4g} to {upper:.4g})")
            far = max(far, away)
    if degrees and not _counts_turns(subject):
        largest = float(np.abs(q).max())
        evidence = (
            f"positions up to {largest:.4g} rad exceed the limits of a few rad; read as degrees they keep the limits"
        )
        remedy = "state the unit in the case file (log: units: {position: deg})"
        explains = ("joint limits", "velocity mismatch", "velocity unit")
        return [
            Finding("error", "positions in degrees", listed(degrees), evidence, remedy, {"largest": largest}, explains)
        ]
    if not beyond:
        return []
    remedy = "check unit, zero, sign and order of the joints (log: units, columns)"
    return [Finding("warning", "joint limits", listed(names), "; ".join(beyond), remedy, {"beyond": far})]


def _counts_turns(subject: CheckedLog) -> bool:
    """Whether positions in rad lie whole turns away: no joint travels more than a turn, as few degrees would be."""
    robot, q = subject.case.robot, subject.sound.log.q
    turning = q[:, [joint.kind == "revolute" for joint in robot.active]]
    return bool(np.all(np.ptp(turning, axis=0) <= 2 * np.pi) and np.ptp(turning, axis=0).max() > np.deg2rad(MOVES))


def _still(subject: CheckedLog) -> list[Finding]:
    log, robot = subject.sound.log, subject.case.robot
    ways = travel(log.q)
    still = [name for name, way in zip(robot.joint_names, ways, strict=True) if way < STILL]
    if still:
        evidence = f"it travels at most {ways.min():.2g} rad (or m) over the whole log"
        remedy = "record a motion of it, or lock it at its position (locked: in the case file)"
        numbers = {"travel": float(ways.min())}
        return [Finding("error", "joint never moved", listed(still), evidence, remedy, numbers, ("standstill",))]
    window = max(1, min(round(0.05 * log.rate), len(log.q) - 1))  # logs of a few rows too
    speed = np.abs(log.q[window:] - log.q[:-window]) / (log.time[window:] - log.time[:-window])[:, None]
    rest = float(np.mean(np.all(speed < rest_speeds(robot, subject.case.preprocessing.standstill), axis=1)))
    if rest <= MOSTLY_AT_REST:
        return []
    evidence = f"all joints are at rest in {100 * rest:.0f} % of the samples"
    remedy = "samples at rest have little weight (preprocessing: rest: mask); record more motion"
    return [Finding("warning", "standstill", "", evidence, remedy, {"share": rest})]
