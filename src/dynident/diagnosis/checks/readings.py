"""Signs, orders, couplings and the mounting: the log read in another way, where that explains it far better."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import ClassVar

import numpy as np

from dynident.arrays import Array, BoolArray, vector_text
from dynident.case.evidence.positions import rounding_share, steps_of
from dynident.case.evidence.torques import EXPLAINED
from dynident.diagnosis.causes.column_readings import (
    FED,
    FEEDS,
    GAIN,
    GOOD,
    Interpretation,
    PositionReadings,
    feeding,
    torque_orders,
    torques_of_columns,
    variance_falls,
)
from dynident.diagnosis.causes.couplings import best_coupling
from dynident.diagnosis.causes.gravity_direction import mountings
from dynident.diagnosis.causes.held_out import HeldOutErrors, ReadRows, predicts_unseen
from dynident.diagnosis.causes.quick_fit import QuickFit
from dynident.diagnosis.causes.robot_misfit import LEFT, RobotMisfit, presliding, robot_misfit, unpredicted
from dynident.diagnosis.causes.several_scales import ALIKE, inverted_gains, nominal_agreement, several_scales
from dynident.diagnosis.causes.signs_of_all import READING_CONSEQUENCES, driven_joints
from dynident.diagnosis.causes.thin_fit import CUTOFF_HZ
from dynident.diagnosis.causes.torque_scales import other_scales, reading_of
from dynident.diagnosis.causes.trend_findings import believed, is_grave, is_narrow
from dynident.diagnosis.causes.trends import ZERO, Trends
from dynident.diagnosis.causes.weighted_fit import Solved
from dynident.diagnosis.checks.base import Check, CheckedLog
from dynident.diagnosis.finding import CONSEQUENCES, LOST, UNEXPLAINED, Finding, Severity, listed
from dynident.model.robot import Robot

#: Relative residuals above which a joint is not explained: of any log, and of one that would be another robot's.
POOR, POOR_OF_ANOTHER = 0.25, 0.1

#: Degrees, and share of the reach, by which link frames may differ between two models of one robot.
FRAMES_TURNED, FRAMES_MOVED = 5.0, 0.05

#: Times the gain of a mounting from which the zero of a joint is the cause.
FAR_BETTER = 1.5

#: Times the acceleration of the motion that rounding makes, from which a coupling is none.
ROUNDED = 5.0

#: Largest entry of a coupling between two joints that turn: a larger one stands for a scale.
MOST_COUPLED = 5.0

#: Readings that are told beside the best one at most, where the log does not tell them apart; those that may turn all
#: of an arm, the likeliest first, and share of the largest gain from which another of these explains the log as well.
RIVALS = 2
TURN_ALL, AS_WELL = ("mounting", "axis sign", "position sign"), 0.9


@dataclass(frozen=True)
class Readings(Check):
    """Sign of torques and positions, order and coupling of joints, direction of gravity, degrees for radians."""

    stage: ClassVar[int] = 2

    def findings(self, subject: CheckedLog) -> Sequence[Finding]:
        fit = subject.fit
        if fit is None:
            return []
        unlike = "" if subject.earlier is None else frames_off(subject.earlier.model.robot, subject.case.robot)
        if unlike:
            return [_another_model(unlike)]
        positions = PositionReadings(fit, torques_of_columns(subject.case))
        share, z = fit.friction_power(fit.plain)
        feeds = feeding(share, z)
        if feeds.sum() > fit.model.robot.dof / 2 and not (z > -FEEDS).any():
            return [driven_joints(positions, share, z)]
        found = _confirmed(positions, _candidates(positions, feeds), everywhere=False)
        if found and found[0][1].name == "coupling" and _is_rounding(subject, found[0][1].joints):
            return []  # what a joint lacks in acceleration may be taken from any other
        stretched, scale = subject.stretched, subject.sure_scale
        if stretched and stretched.is_sure and (not found or stretched.gain > found[0][0]):
            found = [(stretched.gain, stretched.reading)]
        if found and found[0][1].name == "mounting" and is_zero(subject.trends, found[0][1].gain):
            found = []  # a zero of a joint whose axis leans turns gravity as well: another check tells it
        if found and scale and scale.gain > found[0][1].gain:
            found = []  # one torque of another unit upsets the others: that check tells it
        if found:
            misfit = robot_misfit(fit, found[0][1].reading)
        elif scale:
            misfit = robot_misfit(fit, reading_of(fit, scale))
        else:
            misfit = robot_misfit(fit) if subject.trends is None else _beside_causes(subject.trends)
        known = found[0][1].gain if found else max((one.gain for one in other_scales(subject.scales)), default=0.0)
        grave = subject.trends is not None and any(map(is_grave, subject.trends.blames))
        found, misfit = _otherwise(positions, feeds, known, (found, misfit), grave)
        if misfit.is_sure or ((found or scale) and misfit.is_suspected):
            return [_another_robot(misfit, fit, "error")]
        told = [_reading_finding(found)] if found else [] if scale else _not_explained(subject, misfit)
        return told or ([_another_robot(misfit, fit, "warning")] if misfit.is_suspected else [])


def _otherwise(
    positions: PositionReadings,
    feeds: BoolArray,
    known: float,
    plain: tuple[list[tuple[float, Interpretation]], RobotMisfit],
    grave: bool,
) -> tuple[list[tuple[float, Interpretation]], RobotMisfit]:
    """Return a reading of positions that other columns explain in part, or of several torques, and what it leaves.

    Args:
        positions: The log, with its positions read in other ways.
        feeds: Which joints friction drives, shape (n,).
        known: Gain of the score by what was found so far, or by the scale of one torque.
        plain: What was found and what it leaves, which stay where neither explains the log better.
        grave: Whether a spring or the like explains most of a joint's residual, as it does of exchanged columns.
    """
    (found, misfit), fit = plain, positions.fit
    one_scale = known > 0.0 and not found
    if misfit.is_structured or misfit.is_suspected or (grave and known == 0.0):
        others = _confirmed(positions, _of_positions(positions, feeds, everywhere=True), everywhere=True)
        if others and others[0][1].gain > known:
            found, misfit = others, robot_misfit(fit, others[0][1].reading)
    is_poor = misfit.is_sure or misfit.is_suspected
    if is_poor or (one_scale and not found):
        several = _scaled(fit)
        left = robot_misfit(fit, several[0][1].reading) if several else misfit
        better = bool(several) and (is_poor or several[0][1].gain > known + GAIN)
        if better and not (left.is_sure or left.is_suspected):
            found, misfit = several, left
    return found, misfit


def _reading_finding(found: Sequence[tuple[float, Interpretation]]) -> Finding:
    """Return what is said of the best reading and of those that the log does not tell from it."""
    (gain, best), *rivals = found
    evidence = f"{best.evidence} {variance_falls(gain)}"
    for _, rival in rivals:
        of = f"{rival.name}{f' ({listed(rival.joints)})' * bool(rival.joints)}"
        if (rival.name, rival.joints) == (best.name, best.joints):  # the same, read in another way
            of = f"the same {rival.evidence.rstrip(',')}"
        evidence += f"; not distinguishable from {of}: {rival.remedy}"
    numbers = {"gain": gain, **best.numbers}
    return Finding("error", best.name, listed(best.joints), evidence, best.remedy, numbers, READING_CONSEQUENCES)


def frames_off(earlier: Robot, robot: Robot) -> str:
    """Return in words where the link frames of two models of one robot are too far off; empty where they agree."""
    reach = max(sum(float(np.linalg.norm(joint.translation)) for joint in robot.joints), 1e-9)
    for joint, other in zip(robot.joints, earlier.joints, strict=False):
        turned = float(np.trace(np.asarray(joint.rotation).T @ other.rotation) - 1.0) / 2.0
        angles = [np.degrees(np.arccos(np.clip(each, -1.0, 1.0))) for each in (turned, joint.axis @ other.axis)]
        shift = float(np.linalg.norm(joint.translation - other.translation))
        if max(angles) > FRAMES_TURNED:
            return f"the link of {joint.name} or its axis is turned by {max(angles):.0f} degrees"
        if shift > FRAMES_MOVED * reach:
            return f"the link of {joint.name} is {shift:.3g} m off"
    return ""


def _another_model(unlike: str) -> Finding:
    evidence = f"the earlier estimate was identified with another robot model: {unlike}"
    remedy = "use the robot model of the robot that was logged, and an estimate that was identified with it"
    return Finding("error", "another robot", "", evidence, remedy, {}, READING_CONSEQUENCES)


def _another_robot(misfit: RobotMisfit, fit: QuickFit, severity: Severity) -> Finding:
    names, worst = fit.model.robot.joint_names, int(np.argmax(misfit.joints))
    evidence = (
        f"{misfit.left:.0%} of the torque is left on samples that were not fitted, {misfit.joints[worst]:.0%} at "
        f"{names[worst]}"
    )
    if misfit.is_sure:
        evidence += f"; with bodies of each joint's own, {variance_falls(misfit.gain)}: lengths or axes are wrong"
    remedy = (
        "use the robot model of the robot that was logged; check order, signs and units of the columns (log: columns)"
    )
    explains = CONSEQUENCES if severity == "error" else ()
    return Finding(
        severity, "another robot", "", evidence, remedy, {"left": misfit.left, "gain": misfit.gain}, explains
    )


def _not_explained(subject: CheckedLog, misfit: RobotMisfit) -> list[Finding]:
    """Return what is said of joints of whose torque next to nothing is explained, beside causes with a sure figure."""
    trends = subject.trends
    if trends is None or not (misfit.joints > LOST).any():
        return []
    causes = [one for one in trends.blames if believed(one, subject.trend_scale) and is_narrow(one)]
    joints, names = unpredicted(trends.fit, causes), trends.fit.model.robot.joint_names
    if not joints:
        return []
    told = [f"{names[i]} ({times:.0%} left, {np.sqrt(left):.0%} by the motion)" for i, (times, left) in joints.items()]
    evidence = (
        "on samples that were not fitted the model explains next to nothing of the torque's variation, a regression on "
        f"the motion alone far more: {', '.join(told)}"
    )
    remedy = (
        "look at axes and origins of these joints and their neighbours in the robot model, at order, signs and units "
        "of their columns (log: columns, units), and at motors that turn two joints (coupling; log: side)"
    )
    explains = tuple(name for name in CONSEQUENCES if name != UNEXPLAINED)
    numbers = {names[i]: times for i, (times, _) in joints.items()}
    return [Finding("error", UNEXPLAINED, listed([names[i] for i in joints]), evidence, remedy, numbers, explains)]


def _ranked(fit: QuickFit, candidates: Iterable[Interpretation]) -> list[tuple[float, Interpretation]]:
    """Return the candidate that cross-validation favours, with its gain, and those that the log does not tell from it.

    One that the robot model's bodies contradict is left out. They judge signs of all joints and gravity as well, which
    a symmetrical arm does not tell apart.

    The logarithm of the independent rows is taken off for each unknown that was found beside the parameters (Schwarz
    1978).
    """
    proposed = list(candidates)
    if not proposed:
        return []
    errors = HeldOutErrors(fit)
    worth = max(float(np.median(fit.independent_rows)), 2.0)
    measured = [errors.errors(each.reading) for each in proposed]
    penalties = [each.freedom * float(np.log(worth)) / worth for each in proposed]
    gains = [errors.gain(own) - penalty for own, penalty in zip(measured, penalties, strict=True)]
    best = int(np.argmax(gains))
    rivals = []
    for k in np.argsort(gains)[::-1].tolist():
        gain, spread = errors.difference(measured[best], measured[k])
        as_well = _is_whole(fit, proposed[best]) and _is_whole(fit, proposed[k]) and gains[k] > AS_WELL * gains[best]
        if k != best and (as_well or gain - penalties[best] + penalties[k] <= spread):
            rivals.append(k)
    told = [best, *rivals[:RIVALS]] if gains[best] > 0 else []
    if rivals:  # the robot model's bodies speak for one of them, or against it
        bodies = {k: nominal_agreement(fit, proposed[k].reading) for k in told}
        least = max(bodies.values(), default=0.0) - (ALIKE if _is_whole(fit, proposed[best]) else EXPLAINED)
        told = [k for k in told if bodies[k] > least]
        told = sorted(told, key=lambda k: TURN_ALL.index(proposed[k].name)) if _is_whole(fit, proposed[best]) else told
    return [(gains[k], proposed[k]) for k in told]


def _is_whole(fit: QuickFit, reading: Interpretation) -> bool:
    """Return whether a reading turns all of an arm: gravity does what signs do on a symmetrical one."""
    return reading.name in TURN_ALL and len(reading.joints) in (0, fit.model.robot.dof)


def _confirmed(
    positions: PositionReadings, candidates: Iterable[Interpretation], everywhere: bool
) -> list[tuple[float, Interpretation]]:
    """Return the best candidate and its rivals if what is found on half of the log holds on the other, else none."""
    fit, best_of_half = positions.fit, partial(_best_reading, everywhere=everywhere, made=positions.made)
    found = _ranked(fit, candidates)
    return found if found and predicts_unseen(fit, best_of_half) else []


def _scaled(fit: QuickFit) -> list[tuple[float, Interpretation]]:
    """Return the log with several torques in other scales if what is found on half of it holds on the other."""

    def reading_of_half(learned: QuickFit) -> ReadRows | None:
        scales = several_scales(learned)
        return None if scales is None else scales.reading

    whole = several_scales(fit)
    found = [] if whole is None else _ranked(fit, [whole])
    return found if found and predicts_unseen(fit, reading_of_half) else []


def _best_reading(learned: QuickFit, everywhere: bool, made: Array | None) -> ReadRows | None:
    """Return what is best on the samples of a fit alone."""
    feeds = feeding(*learned.friction_power(learned.plain))
    found = list(_candidates(PositionReadings(learned, made), feeds, everywhere))
    return max(found, key=lambda each: each.gain).reading if found else None


def _candidates(positions: PositionReadings, feeds: BoolArray, everywhere: bool = False) -> Iterator[Interpretation]:
    fit = positions.fit
    names = fit.model.robot.joint_names
    signs = _torque_signs(fit, feeds)
    if signs.any():
        mixing = np.diag(np.where(signs, -1.0, 1.0))
        solved = fit.solve(fit.triangles.products, mixing)
        joints = tuple(name for name, flip in zip(names, signs, strict=True) if flip)
        evidence = "with the sign reversed,"
        if feeds.any():
            evidence = f"friction drives {'it' if feeds.sum() == 1 else 'them'} instead of braking; " + evidence
        remedy = "negate the column of the torque, or the gain (drives: {JOINT: {gain: ...}})"
        gain = fit.plain.score - solved.score
        yield Interpretation("torque sign", joints, gain, evidence, remedy, ReadRows(fit.rows, mixing))
    yield from torque_orders(fit, positions.made)
    yield from inverted_gains(fit)
    yield from mountings(fit)
    if not signs.any():
        yield from _couplings(fit)
    yield from _of_positions(positions, feeds, everywhere)


def _of_positions(positions: PositionReadings, feeds: BoolArray, everywhere: bool) -> Iterator[Interpretation]:
    """Yield other readings of the positions of joints that are not explained, or ``everywhere``."""
    wrong = (positions.fit.relative > (POOR_OF_ANOTHER if everywhere else POOR)) | feeds
    if wrong.any() or everywhere:
        yield from positions.found(wrong, feeds)
    yield from positions.units()


def _torque_signs(fit: QuickFit, feeds: BoolArray) -> BoolArray:
    """Return which torques have the wrong sign: those that friction drives, and those whose turn explains far more."""
    signs, best = np.zeros(len(feeds), bool), fit.plain
    for _ in range(len(feeds)):
        trials = []
        for i in np.flatnonzero(~signs):
            turned = signs.copy()
            turned[i] = True
            trials.append((fit.solve(fit.triangles.products, np.diag(np.where(turned, -1.0, 1.0))), int(i)))
        wanted = [
            (solved, i)
            for solved, i in trials
            if best.score - solved.score > (FED if feeds[i] else GAIN) and not _drives(fit, solved, signs, i)
        ]
        if not wanted:
            return signs
        best, i = min(wanted, key=lambda trial: trial[0].score)
        signs[i] = True
    return signs


def _drives(fit: QuickFit, solved: Solved, signs: BoolArray, joint: int) -> bool:
    """Return whether friction would drive the joint whose torque is turned: then its sign was right."""
    share, z = fit.friction_power(solved)
    return bool(feeding(share, z)[joint])


def _beside_causes(trends: Trends) -> RobotMisfit:
    """Return what is left beside the causes of a log; rotor inertias are taken in where they explain it."""
    causes = [each.cause for each in trends.blames if believed(each) is not None]
    found = robot_misfit(trends.fit, known=causes)
    if found.left > LEFT and any(each.name == "rotor inertia" for each in causes):
        found = robot_misfit(trends.fit, known=[each for each in causes if each.name != "rotor inertia"])
    if not (found.is_sure or found.is_suspected):
        return found
    beside = robot_misfit(trends.fit, known=[*presliding(trends.fit), *causes])
    return found if beside.is_sure or beside.is_suspected else beside  # it explains another robot in part


def _couplings(fit: QuickFit) -> Iterator[Interpretation]:
    found = best_coupling(fit)
    if found is None or found.gain < GAIN:
        return
    touched = sorted({place for motor, joint, *_ in found.entries for place in (motor, joint)})
    if np.any(found.after[touched] > GOOD):
        return
    turns = [joint.kind == "revolute" for joint in fit.model.robot.active]
    if any(turns[motor] and turns[joint] and abs(value) > MOST_COUPLED for motor, joint, value, _ in found.entries):
        return
    names = fit.model.robot.joint_names
    stated, told = found.matrix.copy(), list[str]()
    for motor, joint, value, spread in found.entries:
        near = simple_ratio(value, 2.0 * spread) if turns[motor] == turns[joint] else 0.0
        stated[motor, joint] = near or value
        within = f" (+- {2.0 * spread:.1g}{f', {near:g} is within' * bool(near)})" * bool(spread)
        lead = f" (a lead of {2e3 * np.pi * abs(value):.3g} mm)" * (turns[joint] and not turns[motor])
        told.append(
            f"the motor of {names[motor]} {'turns' if turns[motor] else 'moves'} {value:.4g}{within} times "
            f"{names[joint]}{lead}"
        )
    left = ", ".join(f"{names[i]} {found.before[i]:.1%} to {found.after[i]:.1%}" for i in touched)
    evidence = f"{', '.join(told)} as well: relative residual {left};"
    rows = ", ".join(f"[{vector_text(row, 4)}]" for row in stated)
    side = "; log: side: {torque: motor}, as these are torques of the motors" if found.at_motors else ""
    remedy = f"state the kinematic coupling of the drives, motor speed = C joint speed (coupling: [{rows}]{side})"
    numbers = {f"entry {motor + 1}, {joint + 1}": value for motor, joint, value, _ in found.entries}
    joints, freedom = tuple(names[i] for i in touched), len(found.entries)
    yield Interpretation("coupling", joints, found.gain, evidence, remedy, found.reading, numbers, freedom)


def is_zero(trends: Trends | None, gain: float) -> bool:
    """Return whether the zero of one joint explains a log far better than a reading of a gain does."""
    blames = () if trends is None else trends.blames
    return any(one.cause.name == ZERO and is_grave(one) and one.gain > FAR_BETTER * gain for one in blames)


def _is_rounding(subject: CheckedLog, joints: Sequence[str]) -> bool:
    """Return whether rounding of the positions makes far more acceleration than the motion of one of some joints."""
    log, cutoff = subject.sound.log, subject.case.preprocessing.filter.bandwidth() or CUTOFF_HZ
    each = [(q, steps_of(q)) for name, q in zip(log.joints, log.q.T, strict=True) if name in joints]
    return any(0 < steps < np.inf and rounding_share(log.time, q, steps, cutoff) > ROUNDED for q, steps in each)


def simple_ratio(value: float, half_width: float) -> float:
    """Return the ratio of gears that is likeliest within an interval: 1, else another whole one or 1/2; 0 for none."""
    for size in (1.0, 2.0, 3.0, 4.0, 0.5):
        if 0.0 < abs(abs(value) - size) <= half_width:
            return size if value > 0 else -size
    return 0.0
