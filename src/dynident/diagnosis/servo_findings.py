"""What spoils a log of commands and positions, before any fit: evidence and remedy by joint."""

from __future__ import annotations

from collections.abc import Container, Sequence

import numpy as np

from dynident.actuators.direction_search import turned_over
from dynident.actuators.drive_law import DriveLaw
from dynident.actuators.servo_log import MOVED, ServoLog, is_outside, is_read_back
from dynident.case.evidence.positions import is_within
from dynident.case.evidence.velocities import velocity_pair
from dynident.diagnosis.finding import SEVERITIES, Finding
from dynident.model.robot import Robot

#: Share of failed reads, of saturated samples that is an error, and that is a warning.
_FAILED, _ALL_SATURATED, _MUCH_SATURATED = 0.005, 0.9, 0.3

#: Positions with fewer steps of the encoder over their travel are coarse.
_COARSE = 60

#: A gap in time is this many median steps.
_GAP = 8.0


def servo_findings(
    log: ServoLog, laws: Sequence[DriveLaw], released: Container[str] = (), trained: Sequence[float] = ()
) -> list[Finding]:
    """Return what spoils a log, the worst first.

    Args:
        log: The log as it was read.
        laws: Drive law of each joint.
        released: Joints whose drive is off in a part of another log of the case.
        trained: Position gains of the training logs where this one is a test log.
    """
    found = [*_gaps(log), *_untrained(log, trained)]
    for joint, law in enumerate(laws):
        found += [*_failed(log, joint), *_saturated(log, joint, law), *_coarse(log, joint), *_read_back(log, joint)]
        found += [] if log.joints[joint] in released else _never_off(log, joint)
    found += _late_velocity(log)
    return sorted(found, key=lambda one: SEVERITIES.index(one.severity))


def arm_findings(robot: Robot, logs: Sequence[ServoLog]) -> list[Finding]:
    """Return which joints run the other way or have another zero, and which leave their limits, by all logs together.

    Args:
        robot: With inertias.
        logs: Logs of its joints, as they were read.

    Raises:
        NotConsistent: The robot model has no inertias.
    """
    found = []
    for one in turned_over(robot, logs):
        evidence, remedy = one.told(robot.joint_names)
        numbers = {"zero_rad": one.zero} if one.zero else {}
        name = "encoder zero" if one.is_zero else "direction"
        found.append(Finding("error", name, robot.joint_names[one.joint], evidence, remedy, numbers))
    return found + _limits(robot, logs)


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


def _saturated(log: ServoLog, joint: int, law: DriveLaw) -> list[Finding]:
    if not np.isfinite(log.kp) or law.gain_is_free or not np.isfinite(law.limit):
        return []
    on = log.enabled[:, joint]
    error = np.abs(log.q_ref[:, joint] - log.q[:, joint])
    limited = on & (log.kp * law.error_gain * error >= law.limit)
    share = float(np.mean(limited))  # also of a release, whose drive is on at speed only
    if share < _MUCH_SATURATED:
        return []
    severity = "error" if limited.sum() > _ALL_SATURATED * on.sum() else "warning"
    evidence = f"duty at its limit in {100 * share:.0f} % of the samples, by kp {log.kp:g} and the drive law"
    remedy = "lower kp, or smaller and slower motions; or correct kp, error_gain and limit under servo:"
    return [Finding(severity, "saturated", log.joints[joint], evidence, remedy)]


def _coarse(log: ServoLog, joint: int) -> list[Finding]:
    levels, told = np.unique(np.round(log.q[~log.failed[:, joint], joint], 9)), float(np.ptp(log.q_ref[:, joint]))
    if told <= MOVED:  # it is held
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
