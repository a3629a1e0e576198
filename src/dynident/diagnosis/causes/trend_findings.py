"""What is said of causes that the residual of a quick fit follows."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TypeAlias

import numpy as np

from dynident.case.evidence.torques import agrees
from dynident.diagnosis.causes.bodies_in_motion import leaned
from dynident.diagnosis.causes.cause_search import MANY, Blame
from dynident.diagnosis.causes.frame_search import frame_findings
from dynident.diagnosis.causes.position_spectrum import RIPPLE
from dynident.diagnosis.causes.quick_fit import QuickFit
from dynident.diagnosis.causes.torque_scales import JointScale
from dynident.diagnosis.causes.trends import DELAY, ELASTIC, HYSTERESIS, SCALE, ZERO, Trends
from dynident.diagnosis.finding import EXPLAINED, Finding, Severity
from dynident.model.friction import FRICTION
from dynident.model.joint import Joint

#: Share of the joint's torque that a cause has, or of all torques where it acts on the whole arm or on what all bodies
#: behind a joint are, from which the result suffers.
MATTERS, MATTERS_ALL = 0.1, 0.03
OF_BODIES = ZERO, SCALE

#: A scale of one torque further off one is that of another check.
FAR_SCALE = 0.5

#: Share of the torque above which a cause is a column that others nearly cancel.
ABSURD = 10.0

#: Share of a joint's torque below which a delay of its own is not told.
LATE = 0.01

#: Share of a joint's residual variance below which its elasticity or the hysteresis of its torque is not told.
TAKEN = 0.1

#: Half the change of the squared speed of a clock from which it is not told.
FAR_CLOCK = 0.25

#: Half-width of the interval of a figure as a share of it up to which it is a warning, and a counterbalance a part.
NARROW = 0.5

#: Standard deviations of its figure from which a cause is told beside another one, or against known bodies.
TOLD = 2.0

#: Share of what a clock explains from which axes that are off explain it as well.
AS_WELL = 0.9

#: Standard deviations of half a 95 % interval.
Z95 = 1.96

#: Causes that are curves without one figure.
CURVES = ("friction curve", "friction drift")

#: Causes that are a sine and a cosine of the position.
WAVES = ("counterbalance", RIPPLE)

#: Gives the scale of a joint's torque; None where that is not looked for.
ScaleOf: TypeAlias = Callable[[str], JointScale | None]


def rival_findings(blame: Blame, fit: QuickFit, scale_of: ScaleOf = lambda joint: None) -> list[Finding]:
    """Return what is said of causes that explain about as well, each a note."""
    beside = f"{blame.cause.name}{f' ({blame.cause.joint})' * bool(blame.cause.joint)}"
    rivals = [believed(rival, scale_of) for rival in blame.rivals if rival.cause.name in _TEXTS]
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
    if blame.cause.name == "time scale":
        if abs(float(blame.values[0])) >= FAR_CLOCK or sureness(blame) < TOLD:
            return None
        speed = float(np.sqrt(1.0 + 2.0 * blame.values[0]))
        return replace(blame, values=np.array([speed - 1.0]), covariance=blame.covariance / speed**2)
    if blame.cause.name != "torque scale":
        none = blame.size > ABSURD or (blame.cause.is_positive and blame.values[0] <= 0.0)
        none = none or (blame.cause.name == DELAY and blame.size < LATE)
        none = none or (blame.cause.name in (ELASTIC, HYSTERESIS) and blame.share < TAKEN)
        none = none or (blame.cause.name == RIPPLE and _wave(blame)[1] > NARROW * _wave(blame)[0])
        none = none or (blame.cause.name in (DELAY, ELASTIC, HYSTERESIS, ZERO) and sureness(blame) < TOLD)
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


def trend_finding(blame: Blame, fit: QuickFit) -> Finding:
    """Return what is said of a cause."""
    evidence, remedy = _TEXTS[blame.cause.name](blame, fit)
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
        numbers |= dict(zip(("value", "half_width", "phase_rad"), _wave(blame), strict=True))
    if blame.cause.name == RIPPLE:
        numbers |= {"cycles": blame.cause.cycles[0], "cycles_half_width": Z95 * blame.cause.cycles[1]}
    return Finding(severity, blame.cause.name, blame.cause.joint, evidence + counted, remedy, numbers)


def is_narrow(blame: Blame) -> bool:
    """Return whether a figure of a cause has an interval that is narrow beside it."""
    values, halves = np.abs(blame.values), blame.half_widths
    if blame.cause.name in WAVES:
        values, halves = np.hsplit(np.array(_wave(blame)[:2]), 2)
    return bool(np.any(NARROW * values > halves))


def is_grave(blame: Blame) -> bool:
    """Return whether a cause, friction apart, explains most of a residual and is a large share of the torque."""
    matters = MATTERS if blame.cause.joint and blame.cause.name not in OF_BODIES else MATTERS_ALL
    large = _size(blame) > matters
    return blame.share > EXPLAINED and large and blame.cause.name != "friction curve"


def _size(blame: Blame) -> float:
    """Return the share of the torque that a cause has; of a tilt, the share of the weight that acts across."""
    return float(np.hypot(*blame.values[:2])) if blame.cause.name == "tilt" else blame.size


def _joint(blame: Blame, fit: QuickFit) -> Joint:
    """Return the joint that a cause belongs to."""
    return next(joint for joint in fit.model.robot.active if joint.name == blame.cause.joint)


def _spring(blame: Blame, fit: QuickFit) -> tuple[str, str]:
    slides = _joint(blame, fit).kind == "prismatic"
    stiffness = f"{blame.values[0]:.3g} +- {blame.half_widths[0]:.2g} {'N/m' if slides else 'N m/rad'}"
    evidence = f"the residual is proportional to the position, {stiffness}"
    step = f"a spring, hose or cable pack: add spring: {{joints: [{blame.cause.joint}]}} to friction:"
    if blame.values[0] < 0.0:
        part = f"balancer: {{joints: [{blame.cause.joint}], dead_center: ..., vary: [ratio]}}"
        step = f"a spring past its dead center: add {part} to friction:, or look at the masses of the robot model"
    return evidence, _of_stated_spring(blame, fit) or step


def _rotor_inertia(blame: Blame, fit: QuickFit) -> tuple[str, str]:
    unit = "kg" if _joint(blame, fit).kind == "prismatic" else "kg m^2"
    evidence = (
        f"the residual is proportional to the acceleration, {blame.values[0]:.3g} +- {blame.half_widths[0]:.2g} {unit}"
    )
    others = any(parameter.kind == "rotor" for parameter in fit.model.parameters)
    part = f"rotor_inertia{f': {{joints: [{blame.cause.joint}]}}' * others}"
    return evidence, f"add {part} to friction:, the inertia of a geared motor as its joint feels it"


def _wave(blame: Blame) -> tuple[float, float, float]:
    """Return size of a sine of the position, radius of its 95 % circle across all phases, and its phase in rad.

    With n degrees of freedom that of two coefficients is sqrt(2 F), F = n/2 (0.05^(-2/n) - 1) of Fisher's distribution.
    """
    freedom = min(blame.freedom, MANY)
    radius = float(np.sqrt(freedom * np.expm1(-2.0 * np.log(0.05) / freedom)))
    half = radius * float(np.sqrt(np.linalg.eigvalsh(blame.covariance)[-1]))
    return float(np.hypot(*blame.values)), half, float(np.arctan2(blame.values[1], blame.values[0]))


def _counterbalance(blame: Blame, fit: QuickFit) -> tuple[str, str]:
    size, half, phase = _wave(blame)
    evidence = (
        f"the residual follows {size:.3g} +- {half:.2g} N m sin(q {'-' if phase < 0 else '+'} {abs(phase):.2f} rad)"
    )
    dead = 0.0 - phase
    part = f"balancer: {{joints: [{blame.cause.joint}], dead_center: {dead:.2f}, vary: [ratio]}}"
    other = dead - np.copysign(np.pi, dead)
    if half > NARROW * size:
        return evidence, "the log does not tell its size, nor would a fit: look at saturation and friction there"
    step = f"a spring or gas cylinder: add {part} to friction: (dead_center: {other:.2f} if it pushes)"
    return evidence, _of_stated_spring(blame, fit) or f"{step}; a body fixed to the link: correct the robot model"


def _ripple(blame: Blame, fit: QuickFit) -> tuple[str, str]:
    (size, half, _), (cycles, std) = _wave(blame), blame.cause.cycles
    slides = _joint(blame, fit).kind == "prismatic"
    turn = "2 pi m" if slides else "turn"
    evidence = (
        f"the residual repeats {cycles:.6g} +- {Z95 * std:.2g} times a {turn} of its position, in both directions, "
        f"with an amplitude of {size:.3g} +- {half:.2g} {'N' if slides else 'N m'}"
    )
    part = f"periodic: {{joints: [{blame.cause.joint}], cycles: {cycles:.6g}}}"
    return evidence, f"cogging, or eccentric or meshing gears: add {part} to friction:, and check again"


def _of_stated_spring(blame: Blame, fit: QuickFit) -> str:
    """Return the step where a spring of the case acts on the joint already, or none of a motor can; else nothing."""
    row = list(fit.model.robot.joint_names).index(blame.cause.joint)
    coupling = np.asarray(fit.model.robot.coupling)
    if np.count_nonzero(coupling[row]) + np.count_nonzero(coupling[:, row]) > 2:
        what = "a spring, hose or cable pack: parts of friction act on motors, of which several turn this joint"
        return f"{what}: subtract its torque"
    for part in fit.model.friction:
        if part.is_of_position and part.ranges and blame.cause.joint in (part.joints or fit.model.robot.joint_names):
            name, fields = FRICTION.name_of(part), ", ".join(part.options)
            return f"state {fields} of its {name} more exactly, or add vary: [{', '.join(part.ranges)}] to it"
    return ""


def _drift(blame: Blame, fit: QuickFit) -> tuple[str, str]:
    unit = "N" if _joint(blame, fit).kind == "prismatic" else "N m"
    evidence = f"the torque drifts by {blame.values[0]:.3g} +- {blame.half_widths[0]:.2g} {unit} over the log"
    return evidence, "check the zero of the sensor; warm it up first, or record a shorter log"


def _friction_drift(blame: Blame, fit: QuickFit) -> tuple[str, str]:
    names = fit.model.robot.joint_names
    figures = zip(names, blame.values, blame.half_widths, strict=True)
    there = np.abs(blame.cause.columns).max(axis=(1, 2)) > 0.0  # joints that hardly move have no column
    told = ", ".join(
        f"{name} {value:+.2g} +- {half:.2g}" for (name, value, half), told in zip(figures, there, strict=True) if told
    )
    evidence = f"Coulomb friction changes from start to end of a log by (N m or N): {told}"
    step = "warm the arm up first, or add friction that follows: warm_up from a cold start, temperature if logged"
    return evidence, step


def _friction_curve(blame: Blame, fit: QuickFit) -> tuple[str, str]:
    unit = "N" if _joint(blame, fit).kind == "prismatic" else "N m"
    course = "sub-linear, load-dependent, or turns before or after the velocity does"
    evidence = f"friction is not Coulomb and viscous friction alone ({course}), {blame.taken.max():.3g} {unit} rms"
    choice = "which chooses parts and the smoothing width of the Coulomb term"
    return evidence, f"use friction: auto, {choice}, or add degressive, load or presliding"


def _time_scale(blame: Blame, fit: QuickFit) -> tuple[str, str]:
    fast = float(blame.values[0])
    word = "fast" if fast > 0 else "slow"
    evidence = (
        f"inertial against gravity torques: the clock runs {100 * abs(fast):.2g} +- {100 * blame.half_widths[0]:.2g} %"
    )
    return f"{evidence} too {word}", "check the clock of the log: log the time of the measurement"


def _torque_scale(blame: Blame, fit: QuickFit) -> tuple[str, str]:
    value, deviation = 100 * float(blame.values[0]), 100 * float(blame.half_widths[0])
    evidence = f"its torque is {value:+.2g} +- {deviation:.2g} % off the value that agrees with the other joints"
    if not blame.cause.joint:
        digits = "+.0f" if abs(value) >= 10.0 else "+.2g"
        evidence = f"torques of all joints are {value:{digits}} +- {deviation:.2g} % off those of its bodies"
    key = "log: units: {torque: ...}" if fit.effort == "torque" else "drives: {JOINT: {gain: ...}}"
    return evidence, f"check gain and gear ratio ({key}), or the masses of the robot model"


def _torque_delay(blame: Blame, fit: QuickFit) -> tuple[str, str]:
    late, half = (1e3 * float(each[0]) for each in (blame.values, blame.half_widths))
    evidence = f"its torque {'lags' if late > 0 else 'leads'} {abs(late):.3g} +- {half:.2g} ms against positions"
    remedy = "shift its column by as much: its filter or clock differs from that of the other joints"
    return evidence, f"{remedy} (preprocessing: delay_s shifts all joints alike)"


def _elastic(blame: Blame, fit: QuickFit) -> tuple[str, str]:
    low, high = (float(blame.values[0] + way * blame.half_widths[0]) for way in (-1.0, 1.0))
    unit = "N/m" if _joint(blame, fit).kind == "prismatic" else "N m/rad"
    within = f"{1.0 / high:.3g} to {1.0 / low:.3g}, 95 %" if low > 0.0 else f"above {1.0 / high:.3g}, 95 %"
    if not fit.tells_rotors:
        within = "within a factor of three, as some rotor inertia counts as that of links"
    evidence = (
        "its link lags behind its drive in proportion to its torque, by a stiffness of about "
        f"{1.0 / float(blame.values[0]):.{3 if fit.tells_rotors else 2}g} {unit} ({within})"
    )
    remedy = (
        "the gear or belt is elastic, which the model is not: log positions behind it, or accelerate less; positions "
        "of the drive less the torque of the link over the stiffness are those of the link"
    )
    return evidence, remedy


def _hysteresis(blame: Blame, fit: QuickFit) -> tuple[str, str]:
    unit = "N" if _joint(blame, fit).kind == "prismatic" else "N m"
    evidence = (
        f"its torque is {2.0 * blame.values[0]:.3g} +- {2.0 * blame.half_widths[0]:.2g} {unit} higher where it rises "
        "than where it falls"
    )
    return evidence, "hysteresis of the torque sensor or of the gear, which no friction of the model has; no delay"


def _zero(blame: Blame, fit: QuickFit) -> tuple[str, str]:
    value, half = float(blame.values[0]), float(blame.half_widths[0])
    scale, unit = (1e3, "mm") if _joint(blame, fit).kind == "prismatic" else (180.0 / np.pi, "degrees")
    evidence = (
        f"its measured positions are {scale * abs(value):.3g} +- {scale * half:.2g} {unit} too "
        f"{'small' if value > 0 else 'large'} for the robot model"
    )
    return evidence, "compare its zero with that of the robot model, and axis and origin of the next joint"


def _tilt(blame: Blame, fit: QuickFit) -> tuple[str, str]:
    gravity = np.asarray(fit.model.robot.gravity)
    lean = blame.values[:2]
    angle = np.degrees(np.arctan(np.linalg.norm(lean)))
    spread = np.degrees(np.linalg.norm(blame.half_widths[:2][lean != 0.0]))  # a planar arm tells one of the two
    text = ", ".join(f"{value + 0.0:.4g}" for value in leaned(gravity, lean))
    evidence = f"the base is tilted by {angle:.2g} +- {spread:.2g} degrees against the stated gravity"
    return evidence, f"level the base, or state its tilt (gravity: [{text}])"


_TEXTS: dict[str, Callable[[Blame, QuickFit], tuple[str, str]]] = {
    "spring": _spring,
    "rotor inertia": _rotor_inertia,
    "counterbalance": _counterbalance,
    "drift": _drift,
    "friction drift": _friction_drift,
    "friction curve": _friction_curve,
    "time scale": _time_scale,
    "torque scale": _torque_scale,
    DELAY: _torque_delay,
    "tilt": _tilt,
    ELASTIC: _elastic,
    HYSTERESIS: _hysteresis,
    ZERO: _zero,
    RIPPLE: _ripple,
}

#: Names of the findings.
TRENDS = tuple(_TEXTS)
