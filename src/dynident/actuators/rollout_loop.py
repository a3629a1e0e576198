"""The compiled roll-out of one servo joint under logged commands, with its exact derivatives by the parameters."""

from __future__ import annotations

import math

import numpy as np

from dynident.actuators.parameters import COUNT, PLACE
from dynident.arrays import Array, IntArray
from dynident.model.kernels.jit import compiled, inlined

_GAIN, _TORQUE, _EMF, _VISCOUS = (PLACE[name] for name in ("gain_ratio", "full_torque", "back_emf", "viscous"))
_COULOMB, _COULOMB_S = PLACE["coulomb"], PLACE["coulomb_stribeck"]
_LM, _LE, _LMS, _LES = (PLACE[f"load_{name}"] for name in ("motor", "external", "motor_stribeck", "external_stribeck"))
_LMQ, _LEQ = PLACE["load_motor_quadratic"], PLACE["load_external_quadratic"]
_VS, _ALPHA, _ARMATURE = PLACE["stribeck_velocity"], PLACE["stribeck_exponent"], PLACE["armature"]
_OFFSET, _DELAY, _SLEW, _KD = (PLACE[name] for name in ("angle_offset", "delay", "slew_limit", "damping_gain"))

#: Columns of the samples that the loop takes: time, command, commanded velocity, duty that is added, whether the drive
#: is on, supply voltage over the nominal one.
COLUMNS = 6

#: Columns of the load: inertia, and the bias torque c0 + c1 cos q + c2 sin q.
LOADS = 4

#: Places of position and velocity at the first sample behind the parameters, where their derivatives are asked for.
START_Q, START_V = COUNT, COUNT + 1

#: Entries of the work array ``now`` of one step: drive, friction budget, step.
(
    _COMMAND, _ERROR, _PER_ERROR, _RATE, _FED, _LIMITED, _DUTY, ON, ACTIVE, _STIFFNESS,
    _RATIO, _FADE, _FADE_V, _REST, _BUDGET, _SIGN_1, _SIGN_2, _SQUARE_M, _SQUARE_E,
    _FORCE, _INERTIA, _DAMPING, _STUCK, _SIGN, _HAS_FADE, _DECAY, _SHARE, _SHARE_X, _UNTURNED, _FIRST, _NEXT, _JUMP,
    _GOAL, _LOG, _LAST_V, _LAST_H, _SPAN, _EARLIER, _BY_DELAY,
) = range(39)  # fmt: skip
ENTRIES = 39

#: Steps of an interval in which the command changes by this share of its range are divided into so many.
WIDE, _PIECES = 0.2, 8

#: Rows of ``slopes``: position, velocity, motor torque, external torque, friction budget, drive force, goal inside the
#: drive, its mean over a step, velocity before a reversal, in the middle of the step, a step before.
ROWS = 11


@inlined
def _jump(samples: Array, begin: float, h: float, place: int, both: Array, now: Array) -> bool:
    """Write the goal a step later where it is the command itself, and what it is within the step.

    That is the goal before a change of the command, its share of the step, and the goal after it. Return False, with
    nothing written, where the command changes more than once.
    """
    row = place + 1
    if row + 1 < len(samples) and samples[row + 1, 0] < begin + h:
        return False
    both[1, :] = 0.0
    now[_COMMAND], now[_GOAL], now[_FIRST] = samples[place, 1], samples[place, 1], 1.0
    if row < len(samples) and samples[row, 0] < begin + h:
        now[_NEXT] = now[_GOAL] = samples[row, 1]
        now[_FIRST] = (samples[row, 0] - begin) / h
    return True


@inlined
def added_duty(p: Array, samples: Array, begin: float, h: float, place: int, now: Array) -> None:
    """Write mean commanded velocity and added duty of a step, and the derivative of their duty by the delay."""
    row, moment, rate, fed = place, begin, 0.0, 0.0
    while row + 1 < len(samples) and samples[row + 1, 0] < begin + h:
        span, moment = samples[row + 1, 0] - moment, samples[row + 1, 0]
        rate, fed, row = rate + samples[row, 2] * span, fed + samples[row, 3] * span, row + 1
    left = begin + h - moment
    now[_RATE], now[_FED] = (rate + samples[row, 2] * left) / h, (fed + samples[row, 3] * left) / h
    change = p[_KD] * (samples[place, 2] - samples[row, 2]) + samples[place, 3] - samples[row, 3]
    now[_BY_DELAY] = change / h


@inlined
def follow(p: Array, samples: Array, begin: float, h: float, place: int, both: Array, now: Array, at: IntArray) -> int:
    """Return the row of the command at a moment; write the goal inside the drive a step later, and its mean.

    The goal follows the command at the slew limit at most. Times at which the command changes divide the step, so that
    goal and mean are exact, as are their derivatives, the two rows of ``both``, by the delay too.
    """
    slew = p[_SLEW]
    while place + 1 < len(samples) and samples[place + 1, 0] <= begin:
        place += 1
    if slew == math.inf and _jump(samples, begin, h, place, both, now):
        return place
    row, total, moment, after_cut, goal, now[_FIRST] = place, 0.0, begin, 0.0, now[_GOAL], 1.0
    both[1, :] = 0.0
    while True:
        is_cut = row + 1 < len(samples) and samples[row + 1, 0] < begin + h
        span = (samples[row + 1, 0] if is_cut else begin + h) - moment
        by_delay, gap = (1.0 if is_cut else 0.0) - after_cut, samples[row, 1] - goal  # by_delay: growth with the delay
        if abs(gap) <= slew * span:
            late = abs(gap) / slew
            total += samples[row, 1] * span - 0.5 * gap * late
            for k in range(both.shape[1]):
                both[1, k] += late * both[0, k]
                both[0, k] = 0.0
            both[1, at[_SLEW]] += 0.5 * gap * late / slew
            both[1, at[_DELAY]] += samples[row, 1] * by_delay
            goal = samples[row, 1]
        else:
            side = math.copysign(1.0, gap)
            total += goal * span + 0.5 * side * slew * span * span
            for k in range(both.shape[1]):
                both[1, k] += both[0, k] * span
            both[1, at[_SLEW]] += 0.5 * side * span * span
            goal += side * slew * span
            both[1, at[_DELAY]] += goal * by_delay
            both[0, at[_SLEW]] += side * span
            both[0, at[_DELAY]] += side * slew * by_delay
        if not is_cut:
            break
        row, moment, after_cut = row + 1, samples[row + 1, 0], 1.0
    for k in range(both.shape[1]):
        both[1, k] /= h
    now[_COMMAND], now[_GOAL] = total / h, goal
    return place


@inlined
def pieces(samples: Array, end: float, place: int, wide: float) -> int:
    """Return into how many a step is divided: a joint at rest or reversing then has another friction than the mean."""
    row = place + 1
    while row < len(samples) and samples[row, 0] < end:
        if abs(samples[row, 1] - samples[row - 1, 1]) > wide:
            return _PIECES
        row += 1
    return 1


@inlined
def _budget(p: Array, v: float, motor: float, external: float, now: Array) -> None:
    """Write the friction budget and what its derivatives need: see the entries of ``now`` below."""
    one = p[_LE] * external - p[_LM] * motor
    toward = math.copysign(1.0, external - motor)  # the side on which a coefficient that is 0 can grow
    now[_SIGN_1] = math.copysign(1.0, one) if one != 0.0 else toward
    if now[_HAS_FADE] < 0.5:
        now[_BUDGET] = p[_COULOMB] + abs(one)
        return
    speed = abs(v)
    now[_LOG] = math.log(speed / p[_VS]) if speed > 0.0 else -math.inf
    ratio = math.exp(p[_ALPHA] * now[_LOG])
    fade = math.exp(-ratio)
    two = p[_LES] * external - p[_LMS] * motor
    square = now[_SQUARE_M] = now[_SQUARE_E] = 0.0
    if external * motor < 0.0 and abs(external) < abs(motor):
        square, now[_SQUARE_E] = p[_LEQ] * external * external, 2.0 * p[_LEQ] * external
    elif external * motor < 0.0 and abs(external) > abs(motor):
        square, now[_SQUARE_M] = p[_LMQ] * motor * motor, 2.0 * p[_LMQ] * motor
    now[_SIGN_2] = math.copysign(1.0, two) if two != 0.0 else toward
    now[_RATIO], now[_FADE] = ratio, fade
    now[_REST] = p[_COULOMB_S] + abs(two) + square
    now[_BUDGET] = p[_COULOMB] + abs(one) + fade * now[_REST]
    now[_FADE_V] = 0.0 if speed == 0.0 else -fade * p[_ALPHA] * ratio / speed * math.copysign(1.0, v)


@inlined
def _budget_slopes(p: Array, v: float, motor: float, external: float, now: Array, slopes: Array, at: IntArray) -> None:
    """Write the derivatives of the friction budget, ``slopes[4]``, from those of the torques and the speed."""
    sv, dm, de, df = slopes[9], slopes[2], slopes[3], slopes[4]
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
        df[at[_ALPHA]] -= now[_REST] * fade * now[_RATIO] * now[_LOG]


@inlined
def _drive_slopes(p: Array, v: float, now: Array, slopes: Array, at: IntArray) -> None:
    """Write the derivatives of the force of the drive (``slopes[5]``) and of motor and external torque."""
    sq, sv, dm, de, force, mean = slopes[0], slopes[9], slopes[2], slopes[3], slopes[5], slopes[7]
    full, free = now[ACTIVE] * p[_TORQUE], 1.0 - now[_LIMITED]
    most = full * free
    by_error = most * p[_GAIN] * now[_PER_ERROR] if now[_ERROR] != 0.0 else 0.0
    by_speed, stiffness = now[ON] * p[_EMF] + most * p[_KD], now[_STIFFNESS]
    for k in range(len(force)):
        force[k] = by_error * (mean[k] - sq[k])
    if now[_FIRST] < 1.0:
        force[at[_DELAY]] += full * now[_JUMP] / now[_SPAN]
    force[at[_GAIN]] += full * now[_PER_ERROR] * now[_ERROR]
    force[at[_DELAY]] += most * now[_BY_DELAY]
    force[at[_KD]] += most * now[_RATE]
    force[at[_TORQUE]] += now[ACTIVE] * now[_DUTY]
    for k in range(len(force)):
        dm[k] = force[k] - by_speed * sv[k]
        de[k] = stiffness * sq[k]
    dm[at[_EMF]] -= now[ON] * v
    dm[at[_KD]] -= most * v
    dm[at[_TORQUE]] -= now[ACTIVE] * free * p[_KD] * v
    de[at[_OFFSET]] += stiffness


@inlined
def _carry(p: Array, v: float, now: Array, slopes: Array, at: IntArray) -> None:
    """Carry the derivatives of the velocity over one step."""
    sv, de, df, force, before = slopes[1], slopes[3], slopes[4], slopes[5], slopes[8]
    if now[_STUCK] > 0.5:
        sv[:] = 0.0
        return
    h, sign, inertia, unturned = now[_SPAN], now[_SIGN], now[_INERTIA], now[_UNTURNED]
    share, pushed = h / inertia * now[_SHARE], now[_FORCE] - sign * now[_BUDGET]
    turns = unturned * v < 0.0
    for k in range(len(sv)):
        before[k] = sv[k]
        sv[k] = now[_DECAY] * sv[k] + share * (force[k] + de[k] - sign * df[k])
    by_x = h / inertia * now[_SHARE_X] * pushed - now[_DECAY] * v
    by_damping = by_x * h / inertia
    sv[at[_DELAY]] -= now[_EARLIER]
    sv[at[_VISCOUS]] += by_damping
    sv[at[_EMF]] += by_damping * now[ON]
    free = now[ACTIVE] * (1.0 - now[_LIMITED])
    sv[at[_KD]] += by_damping * free * p[_TORQUE]
    sv[at[_TORQUE]] += by_damping * free * p[_KD]
    sv[at[_ARMATURE]] -= by_damping * now[_DAMPING] / inertia + share * pushed / inertia
    if not turns:
        return
    whole, twice = v - unturned, 2.0 * sign / inertia
    rest, gain = -unturned / whole * h, h * now[_BUDGET] / (whole * whole)
    for k in range(len(sv)):
        sv[k] += twice * (rest * df[k] + gain * (unturned * before[k] - v * sv[k]))
    sv[at[_ARMATURE]] -= twice * rest * now[_BUDGET] / inertia


@inlined
def _drift(h: float, slopes: Array) -> None:
    """Carry the derivatives of the position over half a step."""
    for k in range(slopes.shape[1]):
        slopes[0, k] += 0.5 * h * slopes[1, k]


@inlined
def middle_speed(h: float, v: float, now: Array, slopes: Array) -> float:
    """Return the velocity in the middle of a step, on the line through those at its begin and a step before.

    A joint that rests or would turn round there counts as at rest. Its derivatives are written, ``slopes[9]``.
    """
    ratio = 0.5 * h / now[_LAST_H]
    middle = v + ratio * (v - now[_LAST_V])
    now[_LAST_V], now[_LAST_H] = v, h
    moves = 1.0 if middle * v > 0.0 else 0.0
    sv, mid, last = slopes[1], slopes[9], slopes[10]
    for k in range(len(sv)):
        mid[k] = moves * (sv[k] + ratio * (sv[k] - last[k]))
        last[k] = sv[k]
    return moves * middle


@inlined
def _drive(p: Array, h: float, q: float, v: float, middle: float, external: float, law: Array, now: Array) -> bool:
    """Write what the drive does in a step; return whether the joint rests until the command jumps within it.

    Such a joint has the rest of the step alone to move: the span of its forces is shorter than the step.
    """
    now[_DUTY] = now[_LIMITED] = now[_ERROR] = now[_JUMP] = 0.0
    now[_PER_ERROR], now[_SPAN], share, sign, rests = law[0], h, now[_FIRST], 1.0, False
    for goal in (now[_COMMAND], now[_NEXT]):
        if share > 0.0:
            error = 0.0 if abs(goal - q) <= law[2] else goal - q
            duty = p[_GAIN] * law[0] * error + p[_KD] * now[_RATE] + now[_FED]
            if error != 0.0:
                duty += math.copysign(law[3], error)
            whole = duty - p[_KD] * middle
            if abs(whole) >= law[1]:
                duty = whole = math.copysign(law[1], whole)
                now[_LIMITED] += share
            else:
                now[_ERROR] += share * error
            now[_DUTY], now[_JUMP] = now[_DUTY] + share * duty, now[_JUMP] + sign * whole
        if sign > 0.0 and share < 1.0 and v == 0.0:
            force = now[ACTIVE] * p[_TORQUE] * now[_JUMP]
            _budget(p, 0.0, force, external, now)
            rests = abs(force + external) <= now[_BUDGET]
        share, sign = 1.0 - share, -1.0
        if rests and now[_SPAN] == h:
            sign = now[_JUMP] = now[_DUTY] = now[_LIMITED] = now[_ERROR] = 0.0
            now[_SPAN], share = share * h, 1.0
    return rests


@inlined
def push(
    p: Array, step: float, q: float, v: float, middle: float, load: Array, law: Array, now: Array
) -> tuple[float, float, float]:
    """Return the velocity after one step with the forces in its middle, and motor and external torque."""
    cosine, sine = math.cos(q + p[_OFFSET]), math.sin(q + p[_OFFSET])
    external = -(load[1] + load[2] * cosine + load[3] * sine)
    now[_STIFFNESS] = load[2] * sine - load[3] * cosine  # d external / d angle
    rests = _drive(p, step, q, v, middle, external, law, now)
    h, full = now[_SPAN], now[ACTIVE] * p[_TORQUE]
    force, braking = full * now[_DUTY], now[ON] * p[_EMF] + full * p[_KD] * (1.0 - now[_LIMITED])
    motor = force - braking * middle
    _budget(p, middle, motor, external, now)
    inertia = load[0] + p[_ARMATURE]
    now[_FORCE], now[_INERTIA], now[_DAMPING] = force + external, inertia, p[_VISCOUS] + braking
    x = h * now[_DAMPING] / inertia
    if x < 0.05:  # by series, to 1e-11
        now[_SHARE] = 1.0 + x * (-0.5 + x * (1.0 / 6.0 + x * (-1.0 / 24.0 + x * (1.0 / 120.0 - x * (1.0 / 720.0)))))
        now[_SHARE_X] = -0.5 + x * (1.0 / 3.0 + x * (-0.125 + x * (1.0 / 30.0 - x * (1.0 / 144.0))))
        now[_DECAY] = 1.0 - x * now[_SHARE]
    else:
        now[_DECAY] = math.exp(-x)
        now[_SHARE] = (1.0 - now[_DECAY]) / x
        now[_SHARE_X] = (now[_DECAY] - now[_SHARE]) / x
    share, total, budget = h / inertia * now[_SHARE], now[_FORCE], now[_BUDGET]
    sign = math.copysign(1.0, v if v != 0.0 else total)
    unturned = now[_DECAY] * v + share * (total - sign * budget)
    now[_SIGN], now[_UNTURNED] = sign, unturned
    now[_EARLIER] = now[_DECAY] * (total - sign * budget) / inertia if rests else 0.0  # by the moment of the jump
    is_stuck = abs(total) <= budget and (v == 0.0 or sign * unturned < 0.0)
    now[_STUCK] = 1.0 if is_stuck else 0.0
    if is_stuck:
        return 0.0, motor, external
    if unturned * v >= 0.0:
        return unturned, motor, external
    rest = -unturned / (v - unturned) * h  # after the reversal, with friction of the other sign
    return unturned + 2.0 * sign * budget * rest / inertia, motor, external


@inlined
def begin_joint(p: Array, samples: Array, v: float, now: Array, at: IntArray) -> None:
    """Write what a joint begins with at a velocity."""
    now[_GOAL], now[_LAST_V], now[_LAST_H] = samples[0, 1], v, math.inf
    for k in (_COULOMB_S, _LMS, _LES, _LMQ, _LEQ):  # without these no part of the friction fades with the speed
        now[_HAS_FADE] = 1.0 if p[k] != 0.0 or at[k] >= 0 else now[_HAS_FADE]


@compiled
def roll_out(
    p: Array, samples: Array, loads: Array, law: Array, start: Array, longest: float, at: IntArray, out: Array
) -> None:
    """Integrate one joint from the first sample; the commands and the load are all that it is given.

    J v' = K u + tau_e - (d + Fv) v - f with |f| <= F, of second order in the step h (Strang 1968): a drift of h / 2,
    the velocity under the forces there, its damping by the exponential, another drift. A joint that comes to rest
    within the step is held where F can, else friction turns its sign at that moment. A goal that jumps within the step
    counts before and after it by their shares (steps are short there), a ramp by its mean. F is that in its middle.

    Args:
        p: Parameters in the order of PARAMETERS, shape (COUNT,).
        samples: Shape (N, COLUMNS).
        loads: Mean load of each of the S equal parts of each interval between two samples, shape ((N - 1) S, LOADS).
        law: Duty per rad of error, duty limit, dead zone in rad, punch (duty added outside the dead zone), shape (4,).
        start: Position and velocity at the first sample, shape (2,).
        longest: Longest step in s.
        at: Column of the derivatives by each parameter, and by position and velocity at the first sample, shape
            (COUNT + 2,): parameters that are equal share one; -1 where the derivative is not asked for.
        out: Positions and velocities at the samples, 1 where the duty was at its limit in the interval after a
            sample, and the derivatives of the positions, shape (N, 3 + f); written.
    """
    (q, v), place, count, wide = start, 0, out.shape[1] - 3, WIDE * float(np.ptp(samples[:, 1]))
    now, parts = np.zeros(ENTRIES), len(loads) // max(len(samples) - 1, 1)
    slopes = np.zeros((ROWS, count + 1))
    slopes[0, at[START_Q]] = slopes[1, at[START_V]] = 1.0
    begin_joint(p, samples, v, now, at)
    for i in range(len(samples)):
        out[i, 0], out[i, 1], out[i, 2] = q, v, 0.0
        out[i, 3:] = slopes[0, :count]
        if i + 1 == len(samples):
            break
        steps = parts * max(1, math.ceil((samples[i + 1, 0] - samples[i, 0]) / (parts * longest) - 1e-9))
        steps *= pieces(samples, samples[i + 1, 0] - p[_DELAY], place, wide)
        h = (samples[i + 1, 0] - samples[i, 0]) / steps
        now[ON], now[ACTIVE] = samples[i, 4], samples[i, 4] * samples[i, 5]
        for step in range(steps):
            begin = samples[i, 0] + step * h - p[_DELAY]
            place = follow(p, samples, begin, h, place, slopes[6:8], now, at)
            load = loads[parts * i + step * parts // steps]
            added_duty(p, samples, begin, h, place, now)
            before, middle = v, middle_speed(h, v, now, slopes)
            q += 0.5 * h * v
            v, motor, external = push(p, h, q, before, middle, load, law, now)
            q += 0.5 * h * v
            out[i, 2] = max(out[i, 2], math.ceil(now[_LIMITED]) * now[ON])
            if count:
                _drift(h, slopes)
                _drive_slopes(p, middle, now, slopes, at)
                _budget_slopes(p, middle, motor, external, now, slopes, at)
                _carry(p, before, now, slopes, at)
                _drift(h, slopes)
