"""Linear start: known rigid body, unknown drive, one bounded regression for each delay and slew limit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.optimize import lsq_linear

from dynident.actuators.drive_law import DriveLaw
from dynident.actuators.joint_load import JointLoad, MeasuredMotion, between
from dynident.actuators.parameters import COUNT, PARAMETERS, PLACE, FrictionModel, neutral
from dynident.actuators.rollout import JointRecord, mean_errors
from dynident.actuators.servo_log import ServoLog
from dynident.arrays import Array, BoolArray, IntArray
from dynident.errors import LogMismatch
from dynident.model.kernels.jit import compiled

#: Slower than this, in rad/s, a joint is at rest: Coulomb friction then has any value within its level, and the sample
#: is left out.
REST = 0.05

#: Shortest time in s of motion with the drive off that tells back-EMF from viscous friction.
OFF_S = 0.2

#: Delays in s that are scanned where none is stated.
DELAYS = (0.0, 0.004, 0.008, 0.012, 0.016, 0.024, 0.032)

#: Slew limits that are scanned, as shares of the fastest measured speed.
SLEWS = (np.inf, 2.0, 1.4, 1.1, 0.9, 0.7, 0.5)

#: Passes over the load that friction depends on.
_PASSES = 2

#: A slew limit is kept where it lowers the error of the roll-outs by this share at least.
_SLEW_GAIN = 0.05

#: Largest slope of the weight over the angle, as a share of the largest torque of the rigid body, below which no weight
#: tells the angle offset of a joint: an axis along gravity.
WEIGHTLESS = 0.02

#: Fewest rows of motion without saturation.
_FEWEST = 100


@compiled
def _goals(time: Array, command: Array, slew: float, goal: Array) -> None:
    """Write the goal inside the drive, shape (K,), that follows a command at a limited speed."""
    goal[0] = command[0]
    for k in range(1, len(time)):
        reach = slew * (time[k] - time[k - 1])
        goal[k] = goal[k - 1] + min(max(command[k] - goal[k - 1], -reach), reach)


@dataclass(frozen=True)
class StartRows:
    """Filtered rows of one joint in one log, without those of the drive.

    Attributes:
        log: The log.
        joint: Column of the joint.
        law: Numbers of the drive law at the gain of the log, shape (4,).
        motion: Filtered motion of the log.
        target: Torque of the rigid body, shape (K,), in N m, filtered.
        angle: Measured position on the grid, shape (K,), not filtered.
        external: Torque of the rest of the robot on the joint at rest, shape (K,), in N m.
        slope: Its derivative by the angle, shape (K,).
        on: Whether the drive is on, shape (K,).
        supply: Shape (K,).
        damping: Known duty per rad/s of velocity error.
        fixed: Filtered columns that depend on neither delay nor slew limit, made when asked for.
    """

    log: ServoLog
    joint: int
    law: Array
    motion: MeasuredMotion
    target: Array
    angle: Array
    external: Array
    slope: Array
    on: Array
    supply: Array
    damping: float = 0.0
    fixed: dict[str, Array] = field(default_factory=dict)

    @property
    def rest(self) -> float:
        """Speed below which the joint is at rest, in rad/s or m/s."""
        return self.log.sized(self.joint, REST)

    def column(self, name: str, duty: Array, torque: float) -> Array:
        """Return one filtered column, shape (K,): what the parameter adds to the torque of the rigid body."""
        if name == "load_motor":
            return self.motion.filtered(_column(name, self, duty, torque))
        if name not in self.fixed:
            self.fixed[name] = self.motion.filtered(_column(name, self, duty, torque))
        return self.fixed[name]


def start_rows(log: ServoLog, joint: int, load: JointLoad, motion: MeasuredMotion, law: DriveLaw) -> StartRows:
    """Return what the regression of one joint needs of a log, for all delays and slew limits."""
    time = motion.time

    def on_grid(values: Array) -> Array:
        return np.interp(time, load.time, values)

    q = motion.q[:, joint]
    c0, c1, c2 = (on_grid(column) for column in load.bias.T)
    bias = c0 + c1 * np.cos(q) + c2 * np.sin(q)
    held = _held(log, time)
    return StartRows(
        log=log,
        joint=joint,
        law=law.numbers(log.kp),
        motion=motion,
        target=motion.filtered(on_grid(load.inertia) * motion.ddq[:, joint] + bias),
        angle=between(log.time, log.q[:, [joint]], time)[:, 0],
        external=-bias,
        slope=c2 * np.cos(q) - c1 * np.sin(q),
        on=log.enabled[held, joint].astype(float),
        supply=log.supply[held],
        damping=law.damping_gain,
    )


def has_weight(rows: Sequence[StartRows]) -> bool:
    """Return whether a weight that changes with the angle of the joint is a part of the torque of the rigid body."""
    slope = max(float(np.abs(one.slope).max()) for one in rows)
    most = max(float(np.abs(one.target).max()) for one in rows)
    return slope > WEIGHTLESS * most


def limited_goal(time: Array, command: Array, slew: float) -> Array:
    """Return the goal inside the drive, shape (K,), that follows a command (K,) at a speed limited to slew in rad/s."""
    if not np.isfinite(slew):
        return command
    goal = np.empty(len(time))
    _goals(time, np.ascontiguousarray(command), slew, goal)
    return goal


def _held(log: ServoLog, time: Array) -> IntArray:
    """Return the sample of a log that holds at each time, shape (K,)."""
    return np.clip(np.searchsorted(log.time, time, side="right") - 1, 0, log.samples - 1)


def duty_of(rows: StartRows, delay: float, slew: float) -> tuple[Array, BoolArray]:
    """Return the duty on the grid at the measured position, and where it is at its limit or nearly so."""
    log, time = rows.log, rows.motion.time
    held = _held(log, time - delay)
    per_error, most, dead, punch = rows.law
    error = limited_goal(time, log.q_ref[held, rows.joint], slew) - rows.angle
    error = np.where(np.abs(error) <= dead, 0.0, error)
    raw = per_error * error + punch * np.sign(error) + log.added[held, rows.joint]
    raw += rows.damping * (log.dq_ref[held, rows.joint] - rows.motion.dq[:, rows.joint])
    limited = np.abs(raw) >= most
    width = max(1, round(0.05 / (time[1] - time[0])))
    near = np.convolve(limited & (rows.on > 0.5), np.ones(2 * width + 1), mode="same") > 0.5
    return np.clip(raw, -most, most), near


def saturated_share(rows: Sequence[StartRows], parameters: Array) -> tuple[float, float]:
    """Return the share of the samples whose duty is at its limit by the measured positions, and the largest duty.

    Args:
        rows: Of each log.
        parameters: Shape (COUNT,).
    """
    ratio, delay, slew = (float(parameters[PLACE[name]]) for name in ("gain_ratio", "delay", "slew_limit"))
    shares, most = [], 0.0
    for one in rows:
        scaled = replace(one, law=one.law * [ratio, 1.0, 1.0, 1.0])
        duty = np.abs(duty_of(scaled, delay, slew)[0]) * (one.on > 0.5)
        shares.append(duty >= scaled.law[1])
        most = max(most, float(duty.max()))
    return float(np.mean(np.concatenate(shares))), most


@dataclass(frozen=True)
class LinearStart:
    """What the linear start found.

    Attributes:
        parameters: Shape (COUNT,).
        error: Mean over the logs of the mean absolute position error of its roll-outs, in rad.
        delay_s: Delay of the scan.
        slew_limit: Slew limit of the scan, infinite for none.
        scanned: Pairs of delay and slew limit that were tried.
        saturated: Share of the samples with the drive on that are saturated.
    """

    parameters: Array
    error: float
    delay_s: float
    slew_limit: float
    scanned: int
    saturated: float


def linear_start(
    rows: Sequence[StartRows], records: Sequence[JointRecord], law: DriveLaw, friction: FrictionModel
) -> LinearStart:
    """Return the parameters of one regression, at the delay and slew limit whose roll-outs are nearest.

    Raises:
        LogMismatch: All samples rest or are saturated.
    """
    fastest = max(float(np.quantile(np.abs(one.motion.dq[:, one.joint]), 0.999)) for one in rows)
    delays = DELAYS if law.delay_s is None else (law.delay_s,)
    slews = [share * fastest for share in SLEWS] if law.slew_limit is None else [law.slew_limit]
    found: dict[tuple[float, float], tuple[float, Array, float]] = {}

    def tried(delay: float, slew: float) -> tuple[float, Array, float]:
        if (delay, slew) not in found:
            parameters, saturated = _regression(rows, law, friction, delay, slew)
            errors = mean_errors(records, parameters)
            found[delay, slew] = (float(np.mean(np.minimum(errors, np.pi))), parameters, saturated)
        return found[delay, slew]

    def nearest(pairs: Sequence[tuple[float, float]]) -> tuple[float, float]:
        return min(pairs, key=lambda pair: tried(*pair)[0])

    best = free = nearest([(delay, slews[0]) for delay in delays])
    if law.slew_limit is None:  # a goal that is followed slowly looks late
        limited = slews[1:]
        best = nearest([(best[0], slew) for slew in limited])
        best = nearest([(delay, best[1]) for delay in delays])
        best = nearest([(best[0], slew) for slew in limited])
        best = best if tried(*best)[0] < (1.0 - _SLEW_GAIN) * tried(*free)[0] else free
    if law.delay_s is None:
        near = [best[0] + step for step in (-0.003, -0.002, -0.001, 0.001, 0.002, 0.003) if best[0] + step >= 0]
        best = nearest([best, *((delay, best[1]) for delay in near)])
    error, parameters, saturated = found[best]
    return LinearStart(parameters, error, best[0], best[1], len(found), saturated)


def start_at(rows: Sequence[StartRows], law: DriveLaw, friction: FrictionModel, scanned: LinearStart) -> Array:
    """Return the regression of another friction model at the delay and slew limit of a start, shape (COUNT,)."""
    return _regression(rows, law, friction, scanned.delay_s, scanned.slew_limit)[0]


def tells_back_emf(law: DriveLaw, friction: FrictionModel, has_off: bool) -> bool:
    """Return whether the output error has back-EMF beside viscous friction.

    Motion without torque tells them apart, and friction that grows with the motor torque, of which back-EMF is a part.
    """
    return not law.controls_torque and (has_off or "load_motor" in friction.free)


def refinable(start: Array, law: DriveLaw, friction: FrictionModel, has_off: bool) -> Array:
    """Return the start of the output error, shape (COUNT,).

    Where nothing tells back-EMF from viscous friction, viscous friction has the sum of both; where the load alone does,
    and back-EMF starts at 0, each has half of it.
    """
    found, places = start.copy(), [PLACE["viscous"], PLACE["back_emf"]]
    if not tells_back_emf(law, friction, has_off):
        found[places] = found[places].sum(), 0.0
    elif not has_off and found[places[1]] == 0.0:
        found[places] = 0.5 * found[places[0]]
    return found


def _regression(
    rows: Sequence[StartRows], law: DriveLaw, friction: FrictionModel, delay: float, slew: float
) -> tuple[Array, float]:
    """Return the parameters at one delay and slew limit, and the share of saturated samples."""
    has_load = "load_motor" in friction.free
    names = ["full_torque", "viscous", "coulomb", "armature"]
    if has_weight(rows):
        names.append("angle_offset")
    if not law.controls_torque:
        names.insert(1, "back_emf")
    if law.has_damping_gain:
        names.append("damping_gain")
    if has_load:
        names.append("load_motor")
    drives = [duty_of(one, delay, slew) for one in rows]
    for one in rows:
        one.fixed.pop("full_torque", None)
    on_count = sum(float(one.on.sum()) for one in rows)
    share = sum(float((near * one.on).sum()) for one, (_, near) in zip(rows, drives, strict=True)) / max(on_count, 1.0)
    torque = 0.0
    parameters = neutral()
    for _ in range(_PASSES if has_load else 1):
        blocks, targets = [], []
        for one, (duty, near) in zip(rows, drives, strict=True):
            keep = (np.abs(one.motion.dq[:, one.joint]) > one.rest) & ~near
            blocks.append(np.column_stack([one.column(name, duty, torque) for name in names])[keep])
            targets.append(one.target[keep])
        matrix, target = np.concatenate(blocks), np.concatenate(targets)
        if len(matrix) < _FEWEST:
            raise _too_few(rows, len(matrix))
        factor = np.asarray(np.linalg.qr(np.column_stack([matrix, target]), mode="r"))
        matrix, target = factor[:, :-1], factor[:, -1]
        norms = np.linalg.norm(matrix, axis=0)
        norms[norms == 0] = 1.0
        own = [PARAMETERS[PLACE[name]] for name in names]
        lower = np.array([one.lower for one in own]) * norms
        upper = np.array([one.upper for one in own]) * norms
        solution = lsq_linear(matrix / norms, target, (lower, upper)).x / norms
        parameters = neutral()
        for name, value in zip(names, solution, strict=True):
            parameters[PLACE[name]] = value
        torque = float(parameters[PLACE["full_torque"]])
    for tied, other in friction.tied:
        parameters[PLACE[tied]] = parameters[PLACE[other]]
    if "load_external" in friction.free:
        parameters[PLACE["load_external"]] = parameters[PLACE["load_motor"]]
    parameters[PLACE["delay"]], parameters[PLACE["slew_limit"]] = delay, slew
    parameters[PLACE["damping_gain"]] += law.damping_gain  # 0 where it is found
    return parameters, share


def _too_few(rows: Sequence[StartRows], count: int) -> LogMismatch:
    """Return the error that only some samples of a joint move without saturation, with what to log."""
    many, name = ", ".join(dict.fromkeys(one.log.name for one in rows[:4])), rows[0].log.joints[rows[0].joint]
    moving = sum(int(np.sum(np.abs(one.motion.dq[:, one.joint]) > one.rest)) for one in rows)
    if moving < _FEWEST:
        rate = 1.0 / float(np.median(np.diff(rows[0].log.time)))
        step = (
            "log motions of tens of degrees with the drive on, and check the column of its position and the unit of "
            "the time (log: {units: {time: ms}})"
        )
        return LogMismatch(many, f"{name} moves in {moving} samples only (logs of {rate:.3g} Hz)", step)
    evidence = f"{f'only {count}' if count else 'no'} samples of {name} move without saturation"
    return LogMismatch(
        many, evidence, "log slower or smaller motions, or a lower kp, so that the duty stays below its limit"
    )


def _column(name: str, rows: StartRows, duty: Array, torque: float) -> Array:
    """Return one column of the regression, shape (K,): what the parameter adds to the torque of the rigid body."""
    dq, drive = rows.motion.dq[:, rows.joint], rows.on * rows.supply
    sign = np.tanh(dq / rows.rest)
    if name == "damping_gain":
        return drive * (rows.log.dq_ref[_held(rows.log, rows.motion.time), rows.joint] - dq)
    if name == "load_motor":
        motor = drive * duty * torque if torque else -rows.on * rows.external
        return -np.abs(rows.external - motor) * sign
    return {
        "full_torque": drive * duty,
        "back_emf": -rows.on * dq,
        "viscous": -dq,
        "coulomb": -sign,
        "armature": -rows.motion.ddq[:, rows.joint],
        "angle_offset": -rows.slope,
    }[name]


def free_parameters(
    law: DriveLaw, friction: FrictionModel, start: Array, has_gain: bool = False, has_off: bool = True
) -> tuple[str, ...]:
    """Return the names of the parameters that the output error refines.

    Args:
        law: Drive law.
        friction: Friction model.
        start: Parameters that it starts from, shape (COUNT,).
        has_gain: Whether the gain is free beside the torque at full duty.
        has_off: Whether some logs have the drive off in motion.
    """
    names = ["full_torque", *friction.free, "armature"]
    if start[PLACE["angle_offset"]] != 0.0:  # else no weight tells it
        names.append("angle_offset")
    if has_gain:
        names.insert(0, "gain_ratio")
    if tells_back_emf(law, friction, has_off):
        names.append("back_emf")
    if law.has_damping_gain:
        names.append("damping_gain")
    if law.delay_s is None:
        names.append("delay")
    if law.slew_limit is None and np.isfinite(start[PLACE["slew_limit"]]):
        names.append("slew_limit")
    assert len(names) <= COUNT
    return tuple(names)
