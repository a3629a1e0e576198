"""What is said of each cause that a residual follows: the evidence with its figure, and the next step."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from dynident.arrays import vector_text
from dynident.diagnosis.causes.bodies_in_motion import leaned
from dynident.diagnosis.causes.cause_search import MANY, Blame
from dynident.diagnosis.causes.position_spectrum import RIPPLE
from dynident.diagnosis.causes.quick_fit import QuickFit
from dynident.diagnosis.causes.trends import DELAY, ELASTIC, HYSTERESIS, STRETCH, ZERO
from dynident.diagnosis.finding import CLOCKS
from dynident.model.friction import FRICTION
from dynident.model.joint import Joint

#: Half-width of the interval of a figure as a share of it up to which it is a warning, and a counterbalance a part.
NARROW = 0.5

#: Error of a clock from which another size of the robot explains the same: accelerations against gravity.
SIMILAR = 0.03

#: Standard deviations of half a 95 % interval.
Z95 = 1.96


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


def wave(blame: Blame) -> tuple[float, float, float]:
    """Return size of a sine of the position, radius of its 95 % circle across all phases, and its phase in rad.

    With n degrees of freedom that of two coefficients is sqrt(2 F), F = n/2 (0.05^(-2/n) - 1) of Fisher's distribution.
    """
    freedom = min(blame.freedom, MANY)
    radius = float(np.sqrt(freedom * np.expm1(-2.0 * np.log(0.05) / freedom)))
    half = radius * float(np.sqrt(np.linalg.eigvalsh(blame.covariance)[-1]))
    return float(np.hypot(*blame.values)), half, float(np.arctan2(blame.values[1], blame.values[0]))


def _counterbalance(blame: Blame, fit: QuickFit) -> tuple[str, str]:
    size, half, phase = wave(blame)
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
    (size, half, _), (cycles, std) = wave(blame), blame.cause.cycles
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
    step = "check the clock of the log: log the time of the measurement"
    if abs(fast) > SIMILAR:
        size = f"a robot {(1.0 + fast) ** 2:.3g} times as large does the same"
        step += f"; and whether the robot model is that of this robot: {size}, and no log tells them apart"
    return f"{evidence} too {word}", step


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


def _two_clocks(blame: Blame, fit: QuickFit) -> tuple[str, str]:
    rate, half = float(blame.values[0]), float(blame.half_widths[0])
    word, seconds = "fast" if rate > 0 else "slow", float(np.ptp(fit.clock(np.asarray(fit.rows.prepared.kept.time))))
    evidence = (
        f"the clock of torques runs {100 * abs(rate):.3g} +- {100 * half:.1g} % too {word} for that of positions: "
        f"the delay of torques {'grows' if rate > 0 else 'falls'} by {1e3 * abs(rate) * seconds:.3g} ms along the log"
    )
    line = f"np.interp(t[0] + {1.0 + rate:.6g} * (t - t[0]), t, tau[:, j])"
    return evidence, f"record both with the clock of one computer, or put torques at the times of positions ({line})"


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


def _position_scale(blame: Blame, fit: QuickFit) -> tuple[str, str]:
    value, half = float(blame.values[0]), float(blame.half_widths[0])
    digits = 3 if half < 0.05 else 2
    evidence = f"by the torques it moves {1.0 + value:.{digits}g} +- {half:.2g} times as far as its positions say"
    return evidence, "compare its gear ratio, counts a turn and unit with the data sheet"


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
    text = vector_text(leaned(gravity, lean), 4)
    evidence = f"the base is tilted by {angle:.2g} +- {spread:.2g} degrees against the stated gravity"
    return evidence, f"level the base, or state its tilt (gravity: [{text}])"


TEXTS: dict[str, Callable[[Blame, QuickFit], tuple[str, str]]] = {
    "spring": _spring,
    "rotor inertia": _rotor_inertia,
    "counterbalance": _counterbalance,
    "drift": _drift,
    "friction drift": _friction_drift,
    "friction curve": _friction_curve,
    "time scale": _time_scale,
    "torque scale": _torque_scale,
    CLOCKS: _two_clocks,
    DELAY: _torque_delay,
    "tilt": _tilt,
    ELASTIC: _elastic,
    HYSTERESIS: _hysteresis,
    ZERO: _zero,
    STRETCH: _position_scale,
    RIPPLE: _ripple,
}

#: Names of the findings.
TRENDS = tuple(TEXTS)
