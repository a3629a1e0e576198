"""Signs, orders, couplings and the mounting: the log read in another way, where that explains it far better."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from typing import ClassVar

import numpy as np

from dynident.arrays import Array, BoolArray
from dynident.estimation.doctor._couplings import best_coupling
from dynident.estimation.doctor._quick_fit import QuickFit, Rows, Solved
from dynident.estimation.doctor._scales import best_scale
from dynident.estimation.doctor.base import Check, Finding, Subject, listed

#: Gain of the score from which another reading is the true one, e^(gain / 2) in the ratio of residual deviations. An
#: order needs that both joints are explained then: torques of a light wrist hardly differ.
GAIN = 3.0

#: Gravity is told to this angle, in rad.
ANGLE = 0.01

#: Relative residual above which a joint is not explained, and below which it is.
POOR, GOOD = 0.25, 0.3

#: Friction feeds power into a joint beyond doubt: z-score and share of torque times speed.
FEEDS, FEEDS_SHARE = -6.0, -0.05


#: Factor on the torque of one joint from which its unit is in doubt, and signs of other joints with it.
FAR_SCALE = 3.0

#: What follows from a wrong sign, order, coupling or mounting.
EXPLAINS = (
    "torque scale",
    "torque unit",
    "torque delay",
    "time scale",
    "spring",
    "counterbalance",
    "drift",
    "friction drift",
    "friction curve",
    "tilt",
    "load at the flange",
)


@dataclass(frozen=True)
class Reading:
    """A way to read the log.

    Attributes:
        name: Of the finding.
        joints: Those it concerns.
        gain: By how much the score falls.
        evidence: In words.
        remedy: In words.
        numbers: Further figures.
    """

    name: str
    joints: tuple[str, ...]
    gain: float
    evidence: str
    remedy: str
    numbers: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Readings(Check):
    """Sign of a torque or of a position, order and coupling of joints, direction of gravity, degrees for radians."""

    stage: ClassVar[int] = 2

    def findings(self, subject: Subject) -> Sequence[Finding]:
        fit = subject.fit
        if fit is None:
            return []
        share, z = fit.friction_power(fit.plain)
        feeds = (z < FEEDS) & (share < FEEDS_SHARE)
        if feeds.sum() > fit.model.robot.dof / 2 and not (z > -FEEDS).any():
            return [_all_signs(subject, share, z, fit)]
        found = list(_candidates(fit, feeds))
        if not found:
            return []
        best = max(found, key=lambda reading: reading.gain)
        if best.name in ("torque sign", "coupling"):
            gain, factor, _ = best_scale(fit)
            if gain > best.gain and max(factor, 1 / factor) > FAR_SCALE:
                return []  # one torque of another unit upsets the others: that check tells it
        explains = EXPLAINS
        numbers = {"gain": best.gain, **best.numbers}
        return [Finding("error", best.name, listed(best.joints), best.evidence, best.remedy, numbers, explains)]


def _all_signs(subject: Subject, share: Array, z: Array, fit: QuickFit) -> Finding:
    evidence = f"friction drives every joint instead of braking it (z-scores {z.min():.0f} to {z.max():.0f})"
    remedy = "all torques have the wrong sign: negate their columns, or the gains (drives: {JOINT: {gain: ...}})"
    explains = EXPLAINS
    joints = listed(fit.model.robot.joint_names)
    return Finding("error", "torque sign", joints, evidence, remedy, {"share": float(share.min())}, explains)


def _candidates(fit: QuickFit, feeds: BoolArray) -> Iterator[Reading]:
    names = fit.model.robot.joint_names
    signs = _torque_signs(fit, feeds)
    if signs.any():
        mixing = np.diag(np.where(signs, -1.0, 1.0))
        solved = fit.solve(fit.triangles, mixing)
        joints = tuple(name for name, flip in zip(names, signs, strict=True) if flip)
        evidence = f"with the sign turned the fit is better by {fit.plain.score - solved.score:.1f} in log variance"
        if feeds.any():
            evidence = f"friction drives {'it' if feeds.sum() == 1 else 'them'} instead of braking; " + evidence
        remedy = "negate the column of the torque, or the gain (drives: {JOINT: {gain: ...}})"
        yield Reading("torque sign", joints, fit.plain.score - solved.score, evidence, remedy)
    yield from _torque_orders(fit)
    yield from _mountings(fit)
    if not signs.any():
        yield from _couplings(fit)
    if (fit.relative > POOR).any() or feeds.any():
        yield from _position_readings(fit)


def _torque_signs(fit: QuickFit, feeds: BoolArray) -> BoolArray:
    """Return which torques have the wrong sign: those that friction drives, and those whose turn explains far more."""
    signs, best = np.zeros(len(feeds), bool), fit.plain
    for _ in range(len(feeds)):
        trials = []
        for i in np.flatnonzero(~signs):
            turned = signs.copy()
            turned[i] = True
            trials.append((fit.solve(fit.triangles, np.diag(np.where(turned, -1.0, 1.0))), int(i)))
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


def _torque_orders(fit: QuickFit) -> Iterator[Reading]:
    names = fit.model.robot.joint_names
    for order in _orders(len(names)):
        moved = [i for i, k in enumerate(order) if i != k]
        mixing = np.eye(len(names))[list(order)]
        solved = fit.solve(fit.triangles, mixing)
        gain = fit.plain.score - solved.score
        if gain > GAIN and _explained(fit, solved, mixing, moved):
            how = _in_words(names, order)
            joints = tuple(names[i] for i in moved)
            evidence = f"with their torques {how} the fit is better by {gain:.1f} in log variance"
            remedy = "name the torque columns in the order of the joints (log: columns: torque)"
            yield Reading("torque order", joints, gain, evidence, remedy)


def _orders(joints: int) -> Iterator[tuple[int, ...]]:
    """Yield orders that are not that of the chain: two or three joints out of place, from the tip, all shifted."""
    plain = tuple(range(joints))
    cycles = [pair for pair in combinations(plain, 2)] + [
        cycle for i, j, k in combinations(plain, 3) for cycle in ((i, j, k), (i, k, j))
    ]
    orders = dict.fromkeys([*(_turned(plain, cycle) for cycle in cycles), *_whole_orders(joints)])
    yield from (order for order in orders if order != plain)


def _in_words(names: Sequence[str], order: Sequence[int]) -> str:
    """Return what is done to the columns of the joints that are out of place."""
    moved = [i for i, k in enumerate(order) if i != k]
    return "exchanged" if len(moved) == 2 else f"read as those of {listed([names[order.index(i)] for i in moved])}"


def _whole_orders(joints: int) -> list[tuple[int, ...]]:
    """Return the orders from the tip, and with all joints shifted by one to either side."""
    plain = tuple(range(joints))
    return [plain[::-1], plain[1:] + plain[:1], plain[-1:] + plain[:-1]]


def _turned(order: tuple[int, ...], cycle: tuple[int, ...]) -> tuple[int, ...]:
    """Return an order with each entry of a cycle at the place of the one before."""
    turned = list(order)
    for place, entry in zip(cycle, (*cycle[1:], cycle[0]), strict=True):
        turned[place] = order[entry]
    return tuple(turned)


def _explained(fit: QuickFit, solved: Solved, mixing: Array, joints: Sequence[int]) -> bool:
    masks = fit.rows.masks
    size = [float(np.std((fit.rows.torque @ mixing[i])[masks[:, i]])) for i in joints]
    return bool((np.sqrt(solved.variances[list(joints)]) < GOOD * np.array(size)).all())


def _couplings(fit: QuickFit) -> Iterator[Reading]:
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
    evidence = f"{', '.join(told)} as well: the residual falls by {found.gain:.1f} in log variance ({left})"
    rows = ", ".join(f"[{', '.join(f'{value + 0.0:.4g}' for value in row)}]" for row in found.matrix)
    side = "; log: side: {torque: motor}, as these are torques of the motors" if found.at_motors else ""
    remedy = f"state how motors and joints hang together, motor speed = C joint speed (coupling: [{rows}]{side})"
    numbers = {f"entry {motor + 1}, {joint + 1}": value for motor, joint, value, _ in found.entries}
    yield Reading("coupling", tuple(names[i] for i in touched), found.gain, evidence, remedy, numbers)


def _mountings(fit: QuickFit) -> Iterator[Reading]:
    gravity = np.asarray(fit.model.robot.gravity)
    size = float(np.linalg.norm(gravity))
    if not size:
        return
    pulled = _Pulled(fit)
    axes = [sign * size * axis + 0.0 for axis in np.eye(3) for sign in (1.0, -1.0)]
    others = [np.zeros(3), *(axis for axis in axes if axis @ gravity <= 0.9 * size**2)]
    gains = [pulled.gain(other) for other in others]
    best = int(np.argmax(gains))
    if best and gains[best] > GAIN:
        others[best], gains[best] = pulled.refined(others[best], gains[best])
    for other, gain in zip(others, gains, strict=True):
        if gain > GAIN:
            text = ", ".join(f"{value + 0.0:.3g}" for value in other)
            evidence = f"gravity [{text}] explains the torques better by {gain:.1f} in log variance"
            remedy = f"state how the arm is mounted (gravity: [{text}] in the frame of the base)"
            if not other.any():
                evidence = f"the torques do not carry the arm's weight: without gravity the fit is better by {gain:.1f}"
                remedy = "log the measured torque with gravity, not the controller's part without it"
            yield Reading("mounting" if other.any() else "torque without gravity", (), gain, evidence, remedy)


class _Pulled:
    """The fit with gravity in any direction, of which the rows are linear."""

    def __init__(self, fit: QuickFit) -> None:
        self._fit = fit
        observers = fit.gravity_observers
        self._still, *self._along = (_whole(fit.rows_of(fit.log, observer), fit.base.count) for observer in observers)

    def gain(self, gravity: Array) -> float:
        """Return by how much the fit is better with this gravity, in log variance."""
        blocks = tuple(
            none + sum(pull * (one - none) for pull, one in zip(gravity, each, strict=True) if pull)
            for none, *each in zip(self._still.blocks, *(rows.blocks for rows in self._along), strict=True)
        )
        triangles = self._fit.triangles_of(replace(self._still, blocks=blocks))
        return self._fit.plain.score - self._fit.solve(triangles).score

    def refined(self, axis: Array, gain: float) -> tuple[Array, float]:
        """Return the direction near an axis that explains the torques best and its gain; the axis where it is as good.

        A pattern search (Hooke and Jeeves 1961) over the two angles to a hundredth of a radian.
        """
        size, best, found, step = float(np.linalg.norm(axis)), axis, gain, 0.5
        while step > ANGLE:
            sides = np.linalg.svd(best[None, :])[2][1:]
            tried = [best + sign * size * np.tan(step) * side for side in sides for sign in (1.0, -1.0)]
            tried = [size * each / np.linalg.norm(each) for each in tried]
            gains = [self.gain(each) for each in tried]
            if max(gains) > found:
                best, found = tried[int(np.argmax(gains))], max(gains)
            else:
                step /= 2
        return (best, found) if found > gain + GAIN else (axis, gain)


def _whole(rows: Rows, size: int) -> Rows:
    """Return the rows with all columns: which of them are zero depends on the gravity."""
    blocks = []
    for block, own in zip(rows.blocks, rows.columns, strict=True):
        full = np.zeros((len(block), size))
        full[:, own] = block
        blocks.append(full)
    return replace(rows, blocks=tuple(blocks), columns=(np.arange(size),) * len(blocks))


def _position_readings(fit: QuickFit) -> Iterator[Reading]:
    names, q = fit.model.robot.joint_names, np.asarray(fit.log.q)
    turning = np.array([joint.kind == "revolute" for joint in fit.model.robot.active])
    for i, name in enumerate(names):
        turned = q.copy()
        turned[:, i] *= -1
        yield from _read(fit, turned, "position sign", (name,), "negate the column of its position, or the axis")
    pairs = [_turned(tuple(range(len(names))), pair) for pair in combinations(range(len(names)), 2)]
    for order in dict.fromkeys([*pairs, *_whole_orders(len(names))]):
        moved = tuple(name for i, name in enumerate(names) if order[i] != i)
        if not moved:
            continue
        swapped = q[:, list(order)]
        remedy = "name the position columns in the order of the joints (log: columns: q)"
        if len(moved) == 2:
            yield from _read(fit, swapped, "joint order", moved, remedy)
        remedy = "name the columns of positions and torques in the order of the joints (log: columns)"
        how = f"with their positions and torques {_in_words(names, order)}"
        yield from _read(fit, swapped, "joint order", moved, remedy, how, np.eye(len(names))[list(order)])
    if turning.all():
        remedy = "state the unit in the case file (log: units: {position: deg})"
        yield from _read(fit, np.deg2rad(q), "positions in degrees", (), remedy)


def _read(
    fit: QuickFit,
    q: Array,
    name: str,
    joints: tuple[str, ...],
    remedy: str,
    how: str = "read so,",
    mixing: Array | None = None,
) -> Iterator[Reading]:
    rows = replace(fit.rows_of(replace(fit.log, q=q)), masks=fit.rows.masks)  # the same rows, or scores do not compare
    solved = fit.solve(fit.triangles_of(rows), mixing)
    gain = fit.plain.score - solved.score
    share, z = fit.friction_power(solved)
    if gain > GAIN + 1 and not ((z < FEEDS) & (share < FEEDS_SHARE)).any():
        evidence = f"{how} the fit is better by {gain:.1f} in log variance"
        yield Reading(name, joints, gain, evidence, remedy)
