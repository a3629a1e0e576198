"""What spoils a log of commands and positions, before any fit: evidence and remedy by joint."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from pathlib import Path

import numpy as np

from dynident.actuators.direction_search import turned_over
from dynident.actuators.drive_law import DriveLaw
from dynident.actuators.servo_log import MOVED, ServoLog, is_outside, is_read_back
from dynident.actuators.torque_rows import LESS, LIMITED_WORDS, limited_throughout
from dynident.case.evidence.positions import SLACK, is_within
from dynident.case.evidence.velocities import velocity_pair
from dynident.diagnosis.finding import SEVERITIES, Finding
from dynident.model.robot import Robot

#: Share of failed reads, of saturated samples that is an error, and that is a warning.
_FAILED, _ALL_SATURATED, _MUCH_SATURATED = 0.005, 0.9, 0.3

#: Positions with fewer steps of the encoder over their travel are coarse.
_COARSE = 60

#: A command this far from a limit of the robot model, in rad or m, does not lead the joint there.
_LED = 0.1

#: Largest delay of a command in s that is taken for one.
_LATE = 0.05

#: A joint that moves less than this in rad stays in one pose.
_STAYS = 0.01

#: A gap in time is this many median steps.
_GAP = 8.0


def servo_findings(
    log: ServoLog, laws: Sequence[DriveLaw], others: Sequence[ServoLog] = (), trained: Sequence[float] = ()
) -> list[Finding]:
    """Return what spoils a log, the worst first.

    Args:
        log: The log as it was read.
        laws: Drive law of each joint.
        others: Logs of the case beside it, which may show what it lacks.
        trained: Position gains of the training logs where this one is a test log.
    """
    found = [*_gaps(log), *_untrained(log, trained)]
    for joint, law in enumerate(laws):
        found += [*_failed(log, joint), *_saturated(log, joint, law, others), *_coarse(log, joint)]
        found += [*_one_pose(log, joint, others), *_read_back(log, joint)]
        found += [] if any(not one.enabled[:, joint].all() for one in others) else _never_off(log, joint)
    found += _late_velocity(log)
    return sorted(found, key=lambda one: SEVERITIES.index(one.severity))


def arm_findings(robot: Robot, logs: Sequence[ServoLog], laws: Sequence[DriveLaw] = ()) -> list[Finding]:
    """Return which joints run the other way or have another zero, and which leave their limits, by all logs together.

    Args:
        robot: With inertias.
        logs: Logs of its joints, as they were read.
        laws: Drive law of each joint, without a gain where none is known: joints that are saturated throughout are
            named, and no direction and no zero is sought beside such a joint.

    Raises:
        NotConsistent: The robot model has no inertias.
    """
    found = []
    for joint in limited_throughout(robot, laws, logs):
        found.append(Finding("error", "saturated", robot.joint_names[joint], f"the drive is {LIMITED_WORDS}", LESS))
    is_blind = any(_is_throughout(joint, law, logs) for joint, law in enumerate(laws))
    for one in turned_over(robot, logs) if not found and not is_blind else ():
        evidence, remedy = one.told(robot.joint_names)
        numbers = {"zero_rad": one.zero} if one.zero else {}
        name = "encoder zero" if one.is_zero else "direction"
        found.append(Finding("error", name, robot.joint_names[one.joint], evidence, remedy, numbers))
    return found + _limits(robot, logs) + _end_stops(robot, logs)


def _limits(robot: Robot, logs: Sequence[ServoLog]) -> list[Finding]:
    """Return joints whose positions leave the limits of the robot model."""
    found = []
    for joint, own in enumerate(robot.active):
        q = np.concatenate([log.q[~log.failed[:, joint], joint] for log in logs])
        low, high = float(q.min()), float(q.max())
        if is_within(own, low, high):
            continue
        lower, upper = own.limits.lower, own.limits.upper
        evidence = f"positions from {low:.4g} to {high:.4g}, limits of the robot model from {lower:.4g} to {upper:.4g}"
        remedy = f"correct the angle where the encoder of {own.name} reads 0 (log: zero), the unit, or the limits"
        found.append(Finding("warning", "joint limits", own.name, evidence, remedy))
    return found


def _end_stops(robot: Robot, logs: Sequence[ServoLog]) -> list[Finding]:
    """Return joints that come to a limit of the robot model where their commands do not lead them."""
    found = []
    for joint, own in enumerate(robot.active):
        held: dict[float, list[str]] = {}
        for log, (limit, side) in product(logs, ((own.limits.lower, -1.0), (own.limits.upper, 1.0))):
            furthest = int(np.argmax(np.where(log.failed[:, joint], -np.inf, side * log.q[:, joint])))
            is_led = log.enabled[furthest, joint] and abs(log.q_ref[furthest, joint] - limit) < _LED
            if abs(log.q[furthest, joint] - limit) < SLACK and not is_led:
                held.setdefault(limit, []).append(log.name)
        for limit, names in held.items():
            where = f"{len(names)} of {len(logs)} logs ({Path(names[0]).name}{', ...' if len(names) > 1 else ''})"
            evidence = f"turns at {limit:.4g}, a limit of the robot model, where no command leads it, in {where}"
            remedy = "where an end stop held it, leave these logs out or end them before: roll-outs have none"
            found.append(Finding("warning", "end stop", own.name, evidence, remedy))
    return found


def _gaps(log: ServoLog) -> list[Finding]:
    steps = np.diff(log.time)
    usual = float(np.median(steps))
    long = np.flatnonzero(steps > _GAP * usual)
    if not len(long):
        return []
    evidence = f"{len(long)} gaps, the longest {steps.max():.3g} s at {log.time[int(np.argmax(steps))]:.4g} s"
    remedy = "log the goal at a steady rate: between two samples the command is taken to hold"
    return [Finding("warning", "gaps in time", "", f"{evidence} ({1e3 * usual:.3g} ms between samples)", remedy)]


def _untrained(log: ServoLog, trained: Sequence[float]) -> list[Finding]:
    if not is_outside(log.kp, trained):
        return []
    evidence = f"a test log at kp {log.kp:g}, training logs at kp {min(trained):g} to {max(trained):g}"
    remedy = "its error is no check of the model within its range: train on logs at that kp too, or test on another"
    return [Finding("warning", "extrapolation", "", evidence, remedy)]


def _failed(log: ServoLog, joint: int) -> list[Finding]:
    share = float(log.failed[:, joint].mean())
    if share <= _FAILED:
        return []
    evidence = f"{log.failed[:, joint].sum()} of {log.samples} reads are missing or leave the motion and come back"
    remedy = "they have no weight in the fit; check cable, power and speed of the bus"
    return [Finding("warning", "failed reads", log.joints[joint], evidence, remedy)]


def _saturated(log: ServoLog, joint: int, law: DriveLaw, others: Sequence[ServoLog]) -> list[Finding]:
    """Return that the duty is at its limit: almost throughout, or for long where no other log has it below."""
    if law.gain_is_free or not np.isfinite(law.limit):
        return []
    share, is_all = _limited(log, joint, law)[0], _is_throughout(joint, law, [log])
    if share < _MUCH_SATURATED or (not is_all and any(_is_below(one, joint, law) for one in others)):
        return []
    evidence = f"duty at its limit in {100 * share:.0f} % of the samples, by kp {log.kp:g} and the drive law"
    remedy = "lower kp, or smaller and slower motions; or correct kp, error_gain and limit under servo:"
    return [Finding("error" if is_all else "warning", "saturated", log.joints[joint], evidence, remedy)]


def _is_throughout(joint: int, law: DriveLaw, logs: Sequence[ServoLog]) -> bool:
    """Return whether the duty of a joint is at its limit almost throughout, in all of some logs."""
    return not law.gain_is_free and all(_limited(log, joint, law)[1] > _ALL_SATURATED for log in logs)


def _limited(log: ServoLog, joint: int, law: DriveLaw) -> tuple[float, float]:
    """Return the share of the samples with the duty at its limit, and of those with the drive on; 0 of no known kp.

    The first is small of a release, whose drive is on at speed only. The error is the least at any delay of the command
    up to ``_LATE`` s: a late command alone is no duty.
    """
    on, error = log.enabled[:, joint], np.abs(log.q_ref[:, joint] - log.q[:, joint])
    for late in range(1, 1 + int(_LATE / float(np.median(np.diff(log.time))))):
        error[late:] = np.minimum(error[late:], np.abs(log.q_ref[:-late, joint] - log.q[late:, joint]))
    limited = on & (log.kp * law.error_gain * error >= law.limit)
    return float(np.mean(limited)), float(limited.sum() / max(on.sum(), 1))


def _is_below(log: ServoLog, joint: int, law: DriveLaw) -> bool:
    """Return whether a log moves a joint by a duty that is mostly below its limit."""
    return bool(
        np.ptp(log.q_ref[:, joint]) > log.sized(joint, MOVED) and _limited(log, joint, law)[0] < _MUCH_SATURATED
    )


def _coarse(log: ServoLog, joint: int) -> list[Finding]:
    levels, told = np.unique(np.round(log.q[~log.failed[:, joint], joint], 9)), float(np.ptp(log.q_ref[:, joint]))
    if told <= log.sized(joint, MOVED):  # it is held
        return []
    if len(levels) < 3:
        evidence = f"its position does not change, and its command spans {told:.3g} rad"
        remedy = "check the column of its position, and whether the drive is on and free to move"
        return [Finding("error", "no motion", log.joints[joint], evidence, remedy)]
    step = float(np.median(np.diff(levels)))
    count = float(np.ptp(levels)) / step
    if count >= _COARSE:
        return []
    evidence = f"the motion spans {count:.0f} steps of the encoder ({1e3 * step:.3g} mrad each)"
    return [Finding("warning", "quantisation", log.joints[joint], evidence, "log a larger motion")]


def _one_pose(log: ServoLog, joint: int, others: Sequence[ServoLog]) -> list[Finding]:
    """Return that neither command nor position of a joint moves, in this log and all others."""
    spans = [float(np.ptp(each[:, joint])) for one in (log, *others) for each in (one.q, one.q_ref)]
    if max(spans) >= log.sized(joint, _STAYS):
        return []
    evidence = f"command and position stay within {max(spans):.2g} rad or m in all logs"
    remedy = "log motions of tens of degrees (dynident excite offers some), or lock the joint (locked: in the case)"
    return [Finding("error", "one pose", log.joints[joint], evidence, remedy)]


def _read_back(log: ServoLog, joint: int) -> list[Finding]:
    if not is_read_back(log, joint):
        return []
    error = (log.q_ref - log.q)[log.enabled[:, joint] & ~log.failed[:, joint], joint]
    evidence = f"its command is its position and noise of {1e3 * float(np.std(error)):.2g} mrad from sample to sample"
    remedy = "where the command is a position that is read back, log what the controller sends (goal position)"
    return [Finding("warning", "command read back", log.joints[joint], evidence, remedy)]


def _never_off(log: ServoLog, joint: int) -> list[Finding]:
    if not log.enabled[:, joint].all():
        return []
    evidence = "the drive is on throughout"
    remedy = "a log with a free swing (torque off) tells friction from back-EMF; without one only their sum is known"
    return [Finding("note", "no free swing", log.joints[joint], evidence, remedy)]


def _late_velocity(log: ServoLog) -> list[Finding]:
    pair = None if log.dq is None or not np.isfinite(log.dq).all() else velocity_pair(log.time, log.q, log.dq)
    found, lags = [], np.zeros(0) if pair is None else pair.lags
    for name, lag in zip(log.joints, lags.tolist(), strict=False):
        if lag:
            evidence = f"the velocity {'lags' if lag > 0 else 'leads'} {1e3 * abs(lag):.3g} ms beside the positions"
            remedy = "the fit takes velocities from the positions; do not feed this column to a controller as is"
            found.append(Finding("note", "velocity lag", name, evidence, remedy, {"lag_s": lag}))
    return found
