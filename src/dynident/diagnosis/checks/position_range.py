"""Positions against limits: degrees, joints that never move, samples at rest."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dynident.arrays import BoolArray
from dynident.case.evidence.positions import (
    LARGEST_SLIDE,
    LARGEST_TURN,
    LITTLE_SLIDE,
    LITTLE_TURN,
    STILL,
    is_plausible,
    is_within,
    travel,
    turns_into_limits,
)
from dynident.data.formats._units import counted_unit
from dynident.diagnosis.checks.base import Check, CheckedLog
from dynident.diagnosis.finding import CONSEQUENCES, Finding, listed
from dynident.identification.problem.problem import rest_speeds
from dynident.model.joint import Joint

#: Travel in rad or m up to which that of a joint at rest may be noise, and that of white noise, between its 0.5th and
#: its 99.5th percentile, over the deviation of its steps from sample to sample, with a margin for chance.
NOISY, WHITE = 0.02, 1.1 * 2.0 * 2.576 / np.sqrt(2.0)

#: Radians beyond its limits from which a joint is no joint that was moved a little too far.
FAR = 0.3

#: Degrees of travel below which a log is of an arm at rest, in whatever unit.
MOVES = 0.2

#: Share of the rows below the speed of standstill above which little of the log counts.
MOSTLY_AT_REST = 0.5


@dataclass(frozen=True)
class PositionRange(Check):
    """Units of the positions by the joint limits, locked joints that move, joints at rest, share of samples at rest."""

    def findings(self, subject: CheckedLog) -> Sequence[Finding]:
        if radians := _radians(subject):
            return radians
        limits = _limits(subject)
        moved = [] if any(each.severity == "error" for each in limits) else _off_lock(subject)
        return [*moved, *limits, *_still(subject)]


def _off_lock(subject: CheckedLog) -> list[Finding]:
    """Return the locked joints that move or stand elsewhere."""
    return [Finding("error", "locked joint", name, evidence, step) for name, evidence, step in subject.raw.off_lock]


def _radians(subject: CheckedLog) -> list[Finding]:
    """Return whether positions declared as degrees are radians: no joint leaves a turn's worth of them, all move."""
    robot, q = subject.case.robot, subject.sound.log.q
    turning = [k for k, joint in enumerate(robot.active) if joint.kind == "revolute"]
    columns = subject.raw.columns
    words = dict(zip(columns.joints, columns.units.of("position", len(columns.joints)), strict=True))
    if {counted_unit(words.get(robot.active[k].name, "SI"))[1] for k in turning} != {"deg"}:
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
    degrees, millimetres, inverted, names, beyond, far = [], [], [], [], [], 0.0
    for joint, column in zip(robot.active, q.T, strict=True):
        low, high = float(column.min()), float(column.max())
        if joint.name in subject.raw.columns.wrapped:  # which turn they begin in nobody knows
            low, high = (at + turns_into_limits(joint, low, high) for at in (low, high))
        lower, upper = joint.limits.lower, joint.limits.upper
        away = max(lower - high, low - upper, lower - low, high - upper)
        turns = joint.kind == "revolute"
        one = np.pi / 180.0 if turns else 1e-3
        reach = max(abs(low), abs(high)) if turns else high - low  # the zero of a slide may be anywhere
        if is_within(joint, one * low, one * high) and reach > _usual(joint):
            (degrees if turns else millimetres).append(joint.name)
        gear = joint.drive.gear_ratio**2 if "q" in subject.case.columns.motor else 1.0
        if gear != 1.0 and reach > _usual(joint) and is_within(joint, gear * low, gear * high):
            inverted.append(joint)
        if not is_within(joint, low, high):
            names.append(joint.name)
            beyond.append(f"{joint.name} {low:.4g} to {high:.4g} (limits {lower:.4g} to {upper:.4g})")
            far = max(far, away)
    if inverted:
        return [_inverted_gears(inverted, beyond)]
    found = [_in_unit(subject, "deg", degrees)] if degrees and not _counts_turns(subject) else []
    found += [_in_unit(subject, "mm", millimetres)] if millimetres else []
    if found or not beyond:
        return found
    if turned := _of_another_zero(subject, beyond):
        return [turned]
    remedy = "check unit, zero, sign and order of the joints (log: units, columns)"
    return [Finding("warning", "joint limits", listed(names), "; ".join(beyond), remedy, {"beyond": far})]


def _inverted_gears(joints: Sequence[Joint], beyond: Sequence[str]) -> Finding:
    """Return that positions of motors keep the limits with the inverse of the stated gear ratios."""
    evidence = f"positions of the motors over the stated gear ratio are no joint's: {'; '.join(beyond)}"
    right = ", ".join(f"{one.name}: {{gear_ratio: {1.0 / one.drive.gear_ratio:.6g}}}" for one in joints)
    remedy = f"a gear ratio is turns of the motor over turns of the joint: state the inverse (drives: {{{right}}})"
    explains = ("joint limits", "velocity mismatch", "velocity unit")
    return Finding("error", "gear ratio", listed([one.name for one in joints]), evidence, remedy, {}, explains)


def _of_another_zero(subject: CheckedLog, beyond: Sequence[str]) -> Finding | None:
    """Return that all joints keep the limits that several leave by far, had encoders their zeros half a turn away."""
    joints, q = subject.case.robot.active, subject.sound.log.q
    turning = [k for k, joint in enumerate(joints) if joint.kind == "revolute"]
    low, high = q.min(axis=0), q.max(axis=0)
    away = [max(high[k] - joints[k].limits.upper, joints[k].limits.lower - low[k]) for k in turning]
    if sum(one > FAR for one in away) < 2:
        return None
    pairs = (("-pi", -np.pi), ("pi", np.pi), ("-pi/2", -np.pi / 2), ("pi/2", np.pi / 2))
    kept = [(w, x) for w, x in pairs if all(is_within(joints[k], low[k] + x, high[k] + x) for k in turning)]
    if not kept:
        return None
    word, shift = kept[0]
    columns, names = subject.case.columns, [joints[k].name for k in turning]
    stated = columns.zero or (0.0,) * len(columns.joints)
    zeros = [word if not own else f"{own + shift:.6g}" for own in stated]
    told = ", ".join(
        new if name in names else f"{own:g}" for name, new, own in zip(columns.joints, zeros, stated, strict=True)
    )
    evidence = f"{'; '.join(beyond)}; with zeros {abs(shift):.4g} rad away all joints keep their limits"
    remedy = f"state at which position each joint stands where its log says 0 (log: zero: [{told}])"
    explains = ("joint limits", "mounting", "time scale", "position sign", "joint order", *CONSEQUENCES)
    return Finding("error", "position zero", listed(names), evidence, remedy, {"shift": float(shift)}, explains)


def _usual(joint: Joint) -> float:
    """Return how far from zero positions of a joint in rad or m usually are at most."""
    widest = max(abs(joint.limits.lower), abs(joint.limits.upper))
    if np.isfinite(widest):
        return 3 * max(widest, 1.0)
    return LARGEST_TURN if joint.kind == "revolute" else 10.0 * LARGEST_SLIDE  # rails of ten metres and more are built


def _in_unit(subject: CheckedLog, word: str, joints: Sequence[str]) -> Finding:
    """Return that positions are in a unit, by those of some joints."""
    places = [k for k, joint in enumerate(subject.case.robot.active) if joint.name in joints]
    largest = float(np.abs(subject.sound.log.q[:, places]).max())
    evidence = (
        f"positions up to {largest:.4g} rad exceed the limits of a few rad; read as degrees they keep the limits"
        if word == "deg"
        else f"positions up to {largest:.4g} m are no travel of a slide; read as millimetres they keep its limits"
    )
    name = "positions in degrees" if word == "deg" else "positions in millimetres"
    explains = ("joint limits", "velocity mismatch", "velocity unit")
    remedy = f"state the unit in the case file (log: units: {{position: {word}}})"
    numbers = {"largest": largest, "alone": float(_are_alone(subject, word, joints))}
    return Finding("error", name, listed(joints), evidence, remedy, numbers, explains)


def _are_alone(subject: CheckedLog, word: str, joints: Sequence[str]) -> bool:
    """Return whether the other joints of the kind would hardly move if their positions were in this unit as well."""
    kind, factor, least = ("revolute", np.pi / 180, LITTLE_TURN) if word == "deg" else ("prismatic", 1e-3, LITTLE_SLIDE)
    robot, ways = subject.case.robot, travel(subject.sound.log.q)
    others = [k for k, joint in enumerate(robot.active) if joint.kind == kind and joint.name not in joints]
    return bool(others) and bool(np.all(factor * ways[others] < least))


def _counts_turns(subject: CheckedLog) -> bool:
    """Whether positions in rad lie whole turns away: no joint travels more than a turn, as few degrees would be."""
    robot, q = subject.case.robot, subject.sound.log.q
    turning = q[:, [joint.kind == "revolute" for joint in robot.active]]
    return bool(np.all(np.ptp(turning, axis=0) <= 2 * np.pi) and np.ptp(turning, axis=0).max() > np.deg2rad(MOVES))


def _finer(subject: CheckedLog, rests: BoolArray) -> dict[str, tuple[float, str, float]]:
    """Return joints whose positions may be in rad or m and are declared as degrees or millimetres.

    Args:
        subject: The log.
        rests: Joints that hardly move as declared, but by more than noise, shape (n,).

    Returns:
        Travel, unit and factor of each, by its name: it keeps the limits and moves as joints usually do.
    """
    columns, q, found = subject.raw.columns, subject.sound.log.q, dict[str, tuple[float, str, float]]()
    words = dict(zip(columns.joints, columns.units.of("position", len(columns.joints)), strict=True))
    for k in np.flatnonzero(rests).tolist():
        joint, word = subject.case.robot.active[k], counted_unit(words.get(subject.case.robot.joint_names[k], "SI"))[1]
        factor, unit, least = (
            (180.0 / np.pi, "rad", LITTLE_TURN) if joint.kind == "revolute" else (1e3, "m", LITTLE_SLIDE)
        )
        low, high = (factor * float(end) for end in (q[:, k].min(), q[:, k].max()))
        if word == {"rad": "deg", "m": "mm"}[unit] and high - low > least and is_plausible(joint, low, high):
            found[joint.name] = (high - low, unit, factor)
    return found


def _still(subject: CheckedLog) -> list[Finding]:
    log, robot = subject.sound.log, subject.case.robot
    ways = travel(log.q)
    noise = WHITE * np.std(np.diff(log.q, axis=0), axis=0) if len(log.q) > 1 else np.zeros(len(ways))
    rests = (ways < STILL) | ((ways < NOISY) & (ways < noise))
    finer = _finer(subject, rests & (ways > noise))
    still = [name for name, rest in zip(robot.joint_names, rests, strict=True) if rest and name not in finer]
    if finer:
        read = ", ".join(f"{name} {way:.3g} {unit}" for name, (way, unit, _) in finer.items())
        evidence = f"as declared these joints hardly move; read in SI units they travel {read}, within their limits"
        numbers = {f"factor {name}": factor for name, (*_, factor) in finer.items()}
        remedy = "state the unit in the case file (log: units: {position: [...]})"
        return [Finding("error", "position unit", listed([*finer]), evidence, remedy, numbers, ("standstill",))]
    if still:
        evidence = f"it travels at most {ways[rests].max():.2g} rad (or m) over the whole log"
        if np.any(ways[rests] >= STILL):
            evidence += ", no more than the noise from sample to sample makes"
        remedy = "record a motion of it, or lock it at its position (locked: in the case file)"
        numbers = {"travel": float(ways[rests].max())}
        return [Finding("error", "joint never moved", listed(still), evidence, remedy, numbers, ("standstill",))]
    window = max(1, min(round(0.05 * log.rate), len(log.q) - 1))  # logs of a few rows too
    speed = np.abs(log.q[window:] - log.q[:-window]) / (log.time[window:] - log.time[:-window])[:, None]
    rest = float(np.mean(np.all(speed < rest_speeds(robot, subject.case.preprocessing.standstill), axis=1)))
    if rest <= MOSTLY_AT_REST:
        return []
    evidence = f"all joints are at rest in {100 * rest:.0f} % of the samples"
    remedy = "samples at rest have little weight (preprocessing: rest: mask); record more motion"
    return [Finding("warning", "standstill", "", evidence, remedy, {"share": rest})]
