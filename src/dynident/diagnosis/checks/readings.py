"""Signs, orders, couplings and the mounting: the log read in another way, where that explains it far better."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from dynident.arrays import Array, BoolArray
from dynident.data.evidence.torques import LEAN
from dynident.diagnosis.causes.column_readings import (
    FEEDS,
    FEEDS_SHARE,
    GAIN,
    GOOD,
    Interpretation,
    position_readings,
    predicts_unseen,
    torque_orders,
    variance_falls,
)
from dynident.diagnosis.causes.couplings import best_coupling
from dynident.diagnosis.causes.gravity_direction import GravityDirection
from dynident.diagnosis.causes.quick_fit import QuickFit, Solved
from dynident.diagnosis.causes.torque_scales import other_scales
from dynident.diagnosis.checks.base import Check, CheckedLog
from dynident.diagnosis.finding import CONSEQUENCES, Finding, listed

#: Relative residual above which a joint is not explained.
POOR = 0.25


@dataclass(frozen=True)
class Readings(Check):
    """Sign of torques and positions, order and coupling of joints, direction of gravity, degrees for radians."""

    stage: ClassVar[int] = 2

    def findings(self, subject: CheckedLog) -> Sequence[Finding]:
        fit = subject.fit
        if fit is None:
            return []
        share, z = fit.friction_power(fit.plain)
        feeds = (z < FEEDS) & (share < FEEDS_SHARE)
        if feeds.sum() > fit.model.robot.dof / 2 and not (z > -FEEDS).any():
            return [_all_signs(subject, share, z, fit)]
        found = sorted(_candidates(fit, feeds), key=lambda reading: -reading.gain)
        if found and found[0].columns is not None and not predicts_unseen(fit):
            found = [reading for reading in found if reading.columns is None]
        if not found:
            return []
        best = found[0]
        if any(scale.gain > best.gain for scale in other_scales(subject.scales)):
            return []  # one torque of another unit upsets the others: that check tells it
        numbers = {"gain": best.gain, **best.numbers}
        return [Finding("error", best.name, listed(best.joints), best.evidence, best.remedy, numbers, CONSEQUENCES)]


def _all_signs(subject: CheckedLog, share: Array, z: Array, fit: QuickFit) -> Finding:
    evidence = f"friction drives every joint instead of braking it (z-scores {z.min():.0f} to {z.max():.0f})"
    remedy = "all torques have the wrong sign: negate their columns, or the gains (drives: {JOINT: {gain: ...}})"
    joints = listed(fit.model.robot.joint_names)
    return Finding("error", "torque sign", joints, evidence, remedy, {"share": float(share.min())}, CONSEQUENCES)


def _candidates(fit: QuickFit, feeds: BoolArray) -> Iterator[Interpretation]:
    names = fit.model.robot.joint_names
    signs = _torque_signs(fit, feeds)
    if signs.any():
        mixing = np.diag(np.where(signs, -1.0, 1.0))
        solved = fit.solve(fit.triangles.products, mixing)
        joints = tuple(name for name, flip in zip(names, signs, strict=True) if flip)
        evidence = f"with the sign reversed, {variance_falls(fit.plain.score - solved.score)}"
        if feeds.any():
            evidence = f"friction drives {'it' if feeds.sum() == 1 else 'them'} instead of braking; " + evidence
        remedy = "negate the column of the torque, or the gain (drives: {JOINT: {gain: ...}})"
        yield Interpretation("torque sign", joints, fit.plain.score - solved.score, evidence, remedy)
    yield from torque_orders(fit)
    yield from _mountings(fit)
    if not signs.any():
        yield from _couplings(fit)
    if (fit.relative > POOR).any() or feeds.any():
        yield from position_readings(fit)


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
            if best.score - solved.score > (-0.5 if feeds[i] else GAIN) and not _drives(fit, solved, signs, i)
        ]
        if not wanted:
            return signs
        best, i = min(wanted, key=lambda trial: trial[0].score)
        signs[i] = True
    return signs


def _drives(fit: QuickFit, solved: Solved, signs: BoolArray, joint: int) -> bool:
    """Return whether friction would drive the joint whose torque is turned: then its sign was right."""
    share, z = fit.friction_power(solved)
    return bool(z[joint] < FEEDS and share[joint] < FEEDS_SHARE)


def _couplings(fit: QuickFit) -> Iterator[Interpretation]:
    found = best_coupling(fit)
    if found is None or found.gain < GAIN:
        return
    touched = sorted({place for motor, joint, *_ in found.entries for place in (motor, joint)})
    if np.any(found.after[touched] > GOOD):
        return
    names = fit.model.robot.joint_names
    told = [
        f"the motor of {names[motor]} turns {value:.4g}{f' (+- {spread:.1g})' * bool(spread)} times {names[joint]}"
        for motor, joint, value, spread in found.entries
    ]
    left = ", ".join(f"{names[i]} {found.before[i]:.1%} to {found.after[i]:.1%}" for i in touched)
    evidence = f"{', '.join(told)} as well: {variance_falls(found.gain)}; relative residual {left}"
    rows = ", ".join(f"[{', '.join(f'{value + 0.0:.4g}' for value in row)}]" for row in found.matrix)
    side = "; log: side: {torque: motor}, as these are torques of the motors" if found.at_motors else ""
    remedy = f"state the kinematic coupling of the drives, motor speed = C joint speed (coupling: [{rows}]{side})"
    numbers = {f"entry {motor + 1}, {joint + 1}": value for motor, joint, value, _ in found.entries}
    yield Interpretation("coupling", tuple(names[i] for i in touched), found.gain, evidence, remedy, numbers)


def _mountings(fit: QuickFit) -> Iterator[Interpretation]:
    gravity = np.asarray(fit.model.robot.gravity)
    size = float(np.linalg.norm(gravity))
    if not size:
        return
    free = GravityDirection(fit)
    without = free.gain(np.zeros(3))
    best, gain = free.best()
    if without > GAIN:
        evidence = f"the torques contain no gravity: without it, {variance_falls(without)}"
        remedy = "log the measured torque with gravity, not the controller's part without it"
        yield Interpretation("torque without gravity", (), without, evidence, remedy)
    angle = float(np.degrees(np.arccos(np.clip(best @ gravity / size**2, -1.0, 1.0))))
    if gain > GAIN and angle > LEAN:  # a smaller one is a tilt, told with its deviation
        text = ", ".join(f"{value + 0.0:.3g}" for value in best)
        evidence = f"with gravity [{text}], {angle:.1f} degrees off the stated one, {variance_falls(gain)}"
        remedy = f"state how the arm is mounted (gravity: [{text}] in the frame of the base)"
        yield Interpretation("mounting", (), gain, evidence, remedy, {"angle_deg": angle})
