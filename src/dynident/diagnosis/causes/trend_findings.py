"""What is said of causes that the residual of a quick fit follows."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TypeAlias

import numpy as np

from dynident.case.evidence.torques import agrees
from dynident.data.formats._column_map import MOST_APART
from dynident.diagnosis.causes.cause_search import Blame
from dynident.diagnosis.causes.frame_search import frame_findings
from dynident.diagnosis.causes.position_spectrum import RIPPLE
from dynident.diagnosis.causes.quick_fit import QuickFit
from dynident.diagnosis.causes.torque_scales import JointScale
from dynident.diagnosis.causes.trend_texts import NARROW, TEXTS, Z95, wave
from dynident.diagnosis.causes.trends import DELAY, ELASTIC, HYSTERESIS, SCALE, STRETCH, ZERO, Trends
from dynident.diagnosis.finding import CLOCKS, EXPLAINED, Finding, Severity

#: Share of the joint's torque that a cause has, or of all torques where it acts on the whole arm or on what all bodies
#: behind a joint are, from which the result suffers.
MATTERS, MATTERS_ALL = 0.1, 0.03

#: Share of a residual variance from which a quarter of that is enough: nothing else is wrong with the log.
NEARLY_ALL, QUARTER = 0.9, 0.25
OF_BODIES = ZERO, STRETCH, SCALE

#: A scale of one torque further off one is that of another check.
FAR_SCALE = 0.5

#: Share of the torque above which a cause is a column that others nearly cancel.
ABSURD = 10.0

#: Share of a joint's torque, or of all, below which a delay of its own, or one that grows along the log, is not told.
LATE = 0.01

#: Share of a joint's residual variance below which its elasticity or the hysteresis of its torque is not told.
TAKEN = 0.1

#: Angle in rad, or way in m, by which no gear yields under the largest torque of a log.
SOFT = 0.05

#: Half the change of the squared speed of a clock from which it is not told.
FAR_CLOCK = 0.25

#: Standard deviations of its figure from which a cause is told beside another one, or against known bodies.
TOLD = 2.0

#: Share of what a clock explains from which axes that are off explain it as well.
AS_WELL = 0.9

#: Causes that are nothing without their figure.
FIGURED = (DELAY, ELASTIC, HYSTERESIS, ZERO, STRETCH, "spring", "counterbalance")

#: Causes that are curves without one figure.
CURVES = ("friction curve", "friction drift")

#: Causes that are a sine and a cosine of the position.
WAVES = ("counterbalance", RIPPLE)

#: Gives the scale of a joint's torque; None where that is not looked for.
ScaleOf: TypeAlias = Callable[[str], JointScale | None]


def rival_findings(blame: Blame, fit: QuickFit, scale_of: ScaleOf = lambda joint: None) -> list[Finding]:
    """Return what is said of causes that explain about as well, each a note."""
    beside = f"{blame.cause.name}{f' ({blame.cause.joint})' * bool(blame.cause.joint)}"
    rivals = [believed(rival, scale_of) for rival in blame.rivals if rival.cause.name in TEXTS]
    sure = [rival for rival in rivals if rival is not None and (rival.cause.name in CURVES or sureness(rival) > TOLD)]
    found = [trend_finding(rival, fit) for rival in sure]
    told = f"not distinguishable from {beside}: "
    return [replace(finding, severity="note", evidence=told + finding.evidence, beside=beside) for finding in found]


def standing(trends: Trends, blames: Sequence[Blame]) -> tuple[list[Finding], list[Blame]]:
    """Return what is said of axes of the robot model, and the causes with the rivals that stand beside them.

    Where a rotor inertia or a grave cause may be an axis that is off, all are judged beside the axes as well. A rotor
    inertia does not stand beside a surer delay of its joint's torque, of which it would take the rest in, and a delay
    not beside friction and hysteresis of its joint. A clock competes with axes that are put right.
    """
    every = [each for blame in blames for each in (blame, *blame.rivals)]
    clock = next((one for one in blames if one.cause.name == "time scale" and is_grave(one)), None)
    doubted = any(each.cause.name == "rotor inertia" or is_grave(each) for each in every if each.cause.name != RIPPLE)
    frames = trends.frames if doubted else ()
    delays = [blame for blame in (*blames, *trends.blames) if blame.cause.name == DELAY]
    late = {blame.cause.joint: blame.certainty for blame in delays}

    def stands(blame: Blame, place: Blame) -> bool:
        if blame.cause.name == DELAY and not trends.is_delay(blame, place):
            return False
        if blame.cause.name == "rotor inertia" and (
            late.get(blame.cause.joint, 0.0) > blame.certainty or trends.is_of_lag(blame.cause)
        ):
            return False
        return not frames or trends.is_sure_beside_frames(blame.cause)

    kept = [
        replace(blame, rivals=tuple(each for each in blame.rivals if stands(each, blame)))
        for blame in blames
        if stands(blame, blame)
    ]
    found = frame_findings(frames, any(map(is_grave, frames)))
    return (found, kept) if clock is None else _beside_clock(trends, clock, (found, kept))


def _beside_clock(
    trends: Trends, clock: Blame, plain: tuple[list[Finding], list[Blame]]
) -> tuple[list[Finding], list[Blame]]:
    """Return axes of the robot model in the place of a clock, where they explain the log as well; else ``plain``."""
    axes, share = trends.frames_for_clock
    told = believed(clock)
    if share < AS_WELL or told is None:
        return plain
    found = frame_findings(axes, is_grave=True)
    if share < 1.0 / AS_WELL:
        one, beside = trend_finding(told, trends.fit), found[0].label
        evidence = f"not distinguishable from {beside}: {one.evidence}"
        found.append(replace(one, severity="note", evidence=evidence, beside=beside))
    return found, [blame for blame in plain[1] if blame.cause is not clock.cause]


def sureness(blame: Blame) -> float:
    """Return how many deviations the coefficients of a cause are away from zero, all together, as a normal deviate."""
    squares = float(blame.values @ np.linalg.solve(blame.covariance, blame.values))
    return blame.score(float(np.sqrt(max(squares, 0.0) / len(blame.values))))


def believed(blame: Blame, scale_of: ScaleOf = lambda joint: None) -> Blame | None:
    """Return a cause with its figures; None where it is out of the range in which its column holds.

    What the speed of a clock does to inertial torques is its square, of which the coefficient is the straight line.
    The column of a torque's scale is a straight line through a curve: of one joint the profile likelihood has the
    figures, and those of another scale altogether are told by the check of the scales. Without one the bodies that are
    known beforehand decide: of all torques up to where the check of their unit does. Far below, at none, errors of the
    bodies would be all of the bodies.
    """
    if blame.cause.name in ("time scale", CLOCKS):
        return _with_speed(blame)
    if blame.cause.name != "torque scale":
        none = blame.size > ABSURD or (blame.cause.is_positive and blame.values[0] <= 0.0)
        none = none or (blame.cause.name == DELAY and blame.size < LATE)
        none = none or float(blame.values[0]) * blame.cause.load > SOFT  # friction, or a filter, and no gear
        none = none or (blame.cause.name in (ELASTIC, HYSTERESIS) and blame.share < TAKEN)
        none = none or (blame.cause.name == RIPPLE and wave(blame)[1] > NARROW * wave(blame)[0])
        none = none or (blame.cause.name in FIGURED and sureness(blame) < TOLD)
        none = none or (blame.cause.name == STRETCH and blame.values[0] <= -1.0)
        return None if none else blame
    scale = scale_of(blame.cause.joint)
    if scale is None:
        value = float(blame.values[0])
        near = abs(value) < FAR_SCALE if blame.cause.joint else agrees(1.0 + value)
        return blame if near else None
    if scale.is_open or scale.is_other or scale.low <= 1 <= scale.high:
        return None
    deviation = scale.spread / (Z95 * scale.factor)
    value = 1 / scale.factor - 1
    return replace(blame, values=np.array([value]), covariance=np.array([[deviation**2]]), size=abs(value))


def _with_speed(blame: Blame) -> Blame | None:
    """Return a cause with the speed of a clock, less 1, in place of its coefficient; None where it is not told.

    A delay that grows by 1 s in N s is that of a clock that shows N s in N - 1 s.
    """
    value = float(blame.values[0])
    if sureness(blame) < TOLD or (blame.size < LATE if blame.cause.name == CLOCKS else abs(value) >= FAR_CLOCK):
        return None
    speed = 1.0 / (1.0 - value) if blame.cause.name == CLOCKS else float(np.sqrt(1.0 + 2.0 * value))
    slope = speed**2 if blame.cause.name == CLOCKS else 1.0 / speed
    told = replace(blame, values=np.array([speed - 1.0]), covariance=blame.covariance * slope**2)
    return None if blame.cause.name == CLOCKS and abs(speed - 1.0) >= MOST_APART else told


def trend_finding(blame: Blame, fit: QuickFit) -> Finding:
    """Return what is said of a cause."""
    evidence, remedy = TEXTS[blame.cause.name](blame, fit)
    severity: Severity = "warning" if is_narrow(blame) and is_grave(blame) else "note"
    of = "its torque" if blame.cause.joint else "all torques"
    counted = f" (t = {blame.certainty:.0f}, {100 * blame.share:.0f} % of a joint's residual variance, "
    told = blame.taken if blame.cause.name == "friction curve" else blame.torque
    size = blame.size * float(told.max()) / max(float(blame.torque.max()), 1e-300)
    counted += f"{100 * size:{'.0f' if size >= MATTERS else '.2g'}} % of {of})"
    largest = int(np.argmax(np.abs(blame.values)))
    numbers = {
        "value": float(blame.values[largest]),
        "half_width": float(blame.half_widths[largest]),
        "t": blame.certainty,
        "share": blame.share,
        "torque": float(told.max()),
    }
    if blame.cause.name in WAVES:
        numbers |= dict(zip(("value", "half_width", "phase_rad"), wave(blame), strict=True))
    if blame.cause.name == RIPPLE:
        numbers |= {"cycles": blame.cause.cycles[0], "cycles_half_width": Z95 * blame.cause.cycles[1]}
    return Finding(severity, blame.cause.name, blame.cause.joint, evidence + counted, remedy, numbers)


def is_narrow(blame: Blame) -> bool:
    """Return whether a figure of a cause has an interval that is narrow beside it."""
    values, halves = np.abs(blame.values), blame.half_widths
    if blame.cause.name in WAVES:
        values, halves = np.hsplit(np.array(wave(blame)[:2]), 2)
    return bool(np.any(NARROW * values > halves))


def is_grave(blame: Blame) -> bool:
    """Return whether a cause, friction apart, explains most of a residual and is a large share of the torque."""
    matters = MATTERS if blame.cause.joint and blame.cause.name not in OF_BODIES else MATTERS_ALL
    large = _size(blame) > matters * (QUARTER if blame.share > NEARLY_ALL else 1.0)
    return blame.share > EXPLAINED and large and blame.cause.name != "friction curve"


def _size(blame: Blame) -> float:
    """Return the share of the torque that a cause has; of a tilt, the share of the weight that acts across."""
    return float(np.hypot(*blame.values[:2])) if blame.cause.name == "tilt" else blame.size
