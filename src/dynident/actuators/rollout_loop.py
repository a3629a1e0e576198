"""The compiled roll-out of one servo joint under logged commands, with its exact derivatives by the parameters."""

from __future__ import annotations

import math

import numpy as np

from dynident.actuators.parameters import PLACE
from dynident.arrays import Array, BoolArray, IntArray
from dynident.model.kernels.jit import compiled

_GAIN, _TORQUE, _EMF, _VISCOUS = (PLACE[name] for name in ("gain_ratio", "full_torque", "back_emf", "viscous"))
_COULOMB, _COULOMB_S = PLACE["coulomb"], PLACE["coulomb_stribeck"]
_LM, _LE, _LMS, _LES = (PLACE[f"load_{name}"] for name in ("motor", "external", "motor_stribeck", "external_stribeck"))
_LMQ, _LEQ = PLACE["load_motor_quadratic"], PLACE["load_external_quadratic"]
_VS, _ALPHA, _ARMATURE = PLACE["stribeck_velocity"], PLACE["stribeck_exponent"], PLACE["armature"]
_OFFSET, _DELAY, _SLEW, _KD = (PLACE[name] for name in ("angle_offset", "delay", "slew_limit", "damping_gain"))

#: Columns of the samples that the loop takes: time, command, commanded velocity, duty that is added, whether the drive
#: is on, supply voltage over the nominal one, inertia, and the bias torque c0 + c1 cos q + c2 sin q.
COLUMNS = 10
_COLUMNS = COLUMNS

#: Entries of the work array ``now`` of one step: drive, friction budget, step.
(
    _COMMAND, _JUMP, _GAP, _MOVED, _ERROR, _PER_ERROR, _RATE_ERROR, _FED, _LIMITED, _DUTY, _ON, _ACTIVE, _STIFFNESS,
    _RATIO, _FADE, _FADE_V, _REST, _BUDGET, _SIGN_1, _SIGN_2, _SQUARE_M, _SQUARE_E,
    _FORCE, _INERTIA, _DAMPING, _BRAKE, _STUCK, _SIGN, _NUMBER, _HAS_FADE,
) = range(30)  # fmt: skip
_ENTRIES = 30


@compiled
def _delayed(samples: Array, moment: float, step: float, place: int) -> tuple[int, float, float]:
    """Return the row of the command at a moment, its mean over a step from there, and its change over the step."""
    while place + 1 < len(samples) and samples[place + 1, 0] <= moment:
        place += 1
    last, total, at = place, 0.0, moment
    while last + 1 < len(samples) and samples[last + 1, 0] < moment + step:
        total += samples[last, 1] * (samples[last + 1, 0] - at)
        at = samples[last + 1, 0]
        last += 1
    total += samples[last, 1] * (moment + step - at)
    return place, total / step, samples[last, 1] - samples[place, 1]


@compiled
def _budget(p: Array, v: float, motor: float, external: float, now: Array) -> None:
    """Write the friction budget and what its derivatives need: see the entries of ``now`` below."""
    if now[_HAS_FADE] < 0.5:
        one = p[_LE] * external - p[_LM] * motor
        now[_SIGN_1] = math.copysign(1.0, one if one != 0.0 else external - motor)
        now[_BUDGET] = p[_COULOMB] + abs(one)
        return
    speed = abs(v)
    ratio = (speed / p[_VS]) ** p[_ALPHA] if speed > 0.0 else 0.0
    fade = math.exp(-ratio)
    one = p[_LE] * external - p[_LM] * motor
    two = p[_LES] * external - p[_LMS] * motor
    square = now[_SQUARE_M] = now[_SQUARE_E] = 0.0
    if external * motor < 0.0 and abs(external) < abs(motor):
        square, now[_SQUARE_E] = p[_LEQ] * external * external, 2.0 * p[_LEQ] * external
    elif external * motor < 0.0 and abs(external) > abs(motor):
        square, now[_SQUARE_M] = p[_LMQ] * motor * motor, 2.0 * p[_LMQ] * motor
    toward = math.copysign(1.0, external - motor)  # the side on which a coefficient that is 0 can grow
    now[_SIGN_1] = math.copysign(1.0, one) if one != 0.0 else toward
    now[_SIGN_2] = math.copysign(1.0, two) if two != 0.0 else toward
    now[_RATIO], now[_FADE] = ratio, fade
    now[_REST] = p[_COULOMB_S] + abs(two) + square
    now[_BUDGET] = p[_COULOMB] + abs(one) + fade * now[_REST]
    now[_FADE_V] = 0.0 if speed == 0.0 else -fade * p[_ALPHA] * ratio / speed * math.copysign(1.0, v)


@compiled
def _budget_slopes(p: Array, v: float, motor: float, external: float, now: Array, slopes: Array, at: IntArray) -> None:
    """Write the derivatives of the friction budget, ``slopes[4]``, from those of the torques and the speed."""
    sv, dm, de, df = slopes[1], slopes[2], slopes[3], slopes[4]
    fade, s1, s2 = now[_FADE], now[_SIGN_1], now[_SIGN_2]
    by_external = s1 * p[_LE] + fade * (s2 * p[_LES] + now[_SQUARE_E])
    by_motor = -s1 * p[_LM] + fade * (now[_SQUARE_M] - s2 * p[_LMS])
    by_speed = now[_REST] * now[_FADE_V]
    for k in range(len(df)):
        df[k] = by_external * de[k] + by_motor * dm[k] + by_speed * sv[k]
    df[at[_COULOMB]] += 1.0
    df[at[_LE]] += s1 * external
    df[at[_LM]] -= s1 * motor
    if now[_HAS_FADE] < 0.5:
        return
    df[at[_COULOMB_S]] += fade
    df[at[_LES]] += fade * s2 * external
    df[at[_LMS]] -= fade * s2 * motor
    if external * motor < 0.0 and abs(external) < abs(motor):
        df[at[_LEQ]] += fade * external * external
    elif external * motor < 0.0 and abs(external) > abs(motor):
        df[at[_LMQ]] += fade * motor * motor
    if v != 0.0:
        df[at[_VS]] += now[_REST] * fade * now[_RATIO] * p[_ALPHA] / p[_VS]
        df[at[_ALPHA]] -= now[_REST] * fade * now[_RATIO] * math.log(abs(v) / p[_VS])


@compiled
def _drive_slopes(p: Array, h: float, v: float, now: Array, slopes: Array, goal: Array, at: IntArray) -> None:
    """Write the derivatives of the torque (``slopes[5]``), of motor and external torque, and of the goal inside."""
    sq, sv, dm, de, duty = slopes[0], slopes[1], slopes[2], slopes[3], slopes[5]
    if now[_MOVED] > 0.5:
        goal[:] = 0.0
        goal[at[_DELAY]] = -now[_JUMP] / h
    else:
        goal[at[_SLEW]] += math.copysign(h, now[_GAP])
    most = now[_ACTIVE] * p[_TORQUE] if now[_LIMITED] < 0.5 else 0.0
    by_error = most * p[_GAIN] * now[_PER_ERROR] if now[_ERROR] != 0.0 else 0.0
    by_speed, brake, stiffness = most * p[_KD], now[_ON] * p[_EMF], now[_STIFFNESS]
    for k in range(len(duty)):
        duty[k] = by_error * (goal[k] - sq[k]) - by_speed * sv[k]
    duty[at[_GAIN]] += most * now[_PER_ERROR] * now[_ERROR]
    duty[at[_KD]] += most * now[_RATE_ERROR]
    duty[at[_TORQUE]] += now[_ACTIVE] * now[_DUTY]
    for k in range(len(duty)):
        dm[k] = duty[k] - brake * sv[k]
        de[k] = stiffness * sq[k]
    dm[at[_EMF]] -= now[_ON] * v
    de[at[_OFFSET]] += stiffness


@compiled
def _carry(p: Array, h: float, now: Array, slopes: Array, at: IntArray) -> None:
    """Carry the derivatives of position and velocity over one step."""
    sq, sv, de, df, duty = slopes[0], slopes[1], slopes[3], slopes[4], slopes[5]
    if now[_STUCK] > 0.5:
        sv[:] = 0.0
        return
    per_torque, less, sign = h / now[_INERTIA], 1.0 / now[_BRAKE], now[_SIGN]
    for k in range(len(sv)):
        sv[k] = (sv[k] + per_torque * (duty[k] + de[k] - sign * df[k])) * less
    braked = now[_NUMBER] * less * less * per_torque
    pushed = (now[_FORCE] - sign * now[_BUDGET]) * per_torque / now[_INERTIA] * less
    sv[at[_ARMATURE]] += braked * now[_DAMPING] / now[_INERTIA] - pushed
    sv[at[_VISCOUS]] -= braked
    sv[at[_EMF]] -= braked * now[_ON]
    for k in range(len(sv)):
        sq[k] += h * sv[k]


@compiled
def _step(p: Array, h: float, sample: Array, law: Array, state: Array, now: Array) -> tuple[float, float]:
    """Advance position, velocity and goal, ``state``, by one step; return motor and external torque at its start."""
    gap, reach = now[_COMMAND] - state[2], p[_SLEW] * h
    now[_GAP], now[_MOVED] = gap, 1.0 if abs(gap) <= reach else 0.0
    state[2] = now[_COMMAND] if abs(gap) <= reach else state[2] + math.copysign(reach, gap)
    q, v, error = state[0], state[1], state[2] - state[0]
    error = 0.0 if abs(error) <= law[2] else error
    now[_ERROR], now[_PER_ERROR] = error, law[0]
    raw = p[_GAIN] * law[0] * error + p[_KD] * now[_RATE_ERROR] + now[_FED]
    if error != 0.0:
        raw += math.copysign(law[3], error)
    now[_LIMITED] = 1.0 if abs(raw) >= law[1] else 0.0
    now[_DUTY] = math.copysign(law[1], raw) if abs(raw) >= law[1] else raw
    on = now[_ON]
    torque = now[_ACTIVE] * p[_TORQUE] * now[_DUTY]
    motor = torque - on * p[_EMF] * v
    cosine, sine = math.cos(q + p[_OFFSET]), math.sin(q + p[_OFFSET])
    external = -(sample[7] + sample[8] * cosine + sample[9] * sine)
    now[_STIFFNESS] = sample[8] * sine - sample[9] * cosine  # d external / d angle
    _budget(p, v, motor, external, now)
    inertia = sample[6] + p[_ARMATURE]
    now[_FORCE], now[_INERTIA], now[_DAMPING] = torque + external, inertia, p[_VISCOUS] + on * p[_EMF]
    free, band = v + h * now[_FORCE] / inertia, h * now[_BUDGET] / inertia
    now[_BRAKE] = 1.0 + h * now[_DAMPING] / inertia
    now[_STUCK], now[_SIGN] = 1.0 if abs(free) <= band else 0.0, math.copysign(1.0, free)
    now[_NUMBER] = 0.0 if abs(free) <= band else free - math.copysign(band, free)
    state[1] = now[_NUMBER] / now[_BRAKE]
    state[0] = q + h * state[1]
    return motor, external


@compiled
def roll_out(
    p: Array,
    samples: Array,
    law: Array,
    start: Array,
    longest: float,
    at: IntArray,
    out: Array,
    saturated: BoolArray,
) -> None:
    """Integrate one joint from the first sample; the commands and the load are all that it is given.

    J (v' - v) / h = K u + tau_e - (d + Fv) v' - f with |f| <= F, then q' = q + h v': semi-implicit Euler in which dry
    friction holds the joint where F can. F is the friction budget of FRICTION_MODELS at the start of the step.

    Args:
        p: Parameters in the order of PARAMETERS, shape (COUNT,).
        samples: Shape (N, COLUMNS).
        law: Duty per rad of error, duty limit, dead zone in rad, punch (duty added outside the dead zone), shape (4,).
        start: Position and velocity at the first sample, shape (2,).
        longest: Longest step in s.
        at: Column of the derivatives by each parameter, shape (COUNT,): parameters that are equal share one; -1
            where the derivative is not asked for.
        out: Positions at the samples and their derivatives, shape (N, 1 + f); written.
        saturated: Whether the duty was at its limit somewhere in the interval after a sample, shape (N,); written.
    """
    state, now, sample = np.array([start[0], start[1], samples[0, 1]]), np.zeros(_ENTRIES), np.zeros(_COLUMNS)
    count = out.shape[1] - 1
    slopes, goal = np.zeros((6, count + 1)), np.zeros(count + 1)
    place = 0
    for k in (_COULOMB_S, _LMS, _LES, _LMQ, _LEQ):  # without these no part of the friction fades with the speed
        now[_HAS_FADE] = 1.0 if p[k] != 0.0 or at[k] >= 0 else now[_HAS_FADE]
    for i in range(len(samples)):
        out[i, 0], saturated[i] = state[0], False
        for k in range(count):
            out[i, 1 + k] = slopes[0, k]
        if i + 1 == len(samples):
            break
        steps = max(1, math.ceil((samples[i + 1, 0] - samples[i, 0]) / longest - 1e-9))
        h = (samples[i + 1, 0] - samples[i, 0]) / steps
        now[_ON], now[_ACTIVE] = samples[i, 4], samples[i, 4] * samples[i, 5]
        for step in range(steps):
            place, now[_COMMAND], now[_JUMP] = _delayed(samples, samples[i, 0] + step * h - p[_DELAY], h, place)
            share, v = (step + 0.5) / steps, state[1]
            for k in range(6, _COLUMNS):
                sample[k] = samples[i, k] + share * (samples[i + 1, k] - samples[i, k])
            now[_RATE_ERROR], now[_FED] = samples[place, 2] - v, samples[place, 3]
            motor, external = _step(p, h, sample, law, state, now)
            saturated[i] = saturated[i] or (now[_LIMITED] > 0.5 and now[_ON] > 0.5)
            if count:
                _drive_slopes(p, h, v, now, slopes, goal, at)
                _budget_slopes(p, v, motor, external, now, slopes, at)
                _carry(p, h, now, slopes, at)
