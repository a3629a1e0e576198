"""All joints of an arm together: the loads that the roll-outs of all of them give, and the zeros of the encoders.

Each joint is rolled out along the motion of the others, found before: waveform relaxation (Lelarasmee, Ruehli and
Sangiovanni-Vincentelli 1982). Logged positions are coarse in time and in angle and count from the encoder's zero; the
load of a joint wants accelerations, and the angles that the robot model means.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dynident.actuators.drive_law import DriveLaw
from dynident.actuators.joint_fit import JointData, JointFit, fit_again
from dynident.actuators.joint_load import (
    FINE_LOAD_STEP,
    ArmMotion,
    JointLoad,
    MeasuredMotion,
    between,
    bias_of,
    carrying,
    divided,
    inertias_of,
    joint_loads,
    load_times,
    measured_loads,
    measured_motion,
    motion_at,
)
from dynident.actuators.output_error import log_errors, log_weights
from dynident.actuators.parameters import PARAMETERS, PLACE
from dynident.actuators.rollout import JointRecord, record_of, rolled_out
from dynident.actuators.servo_log import ServoLog
from dynident.actuators.verdict import Spread, encoder_step, spread_of
from dynident.arrays import Array
from dynident.model.robot import Robot

#: Times that the loads of an arm are found anew from the roll-outs of all joints, at least and at most; between them
#: until no encoder's zero moves by more than this share of its standard deviation.
LEAST_TURNS, MOST_TURNS, SETTLED = 2, 10, 0.2

#: The same of all logs, where the fits of some of them are settled.
FEW_TURNS = 2

#: Farthest that the zero of any encoder moves in one turn, in rad: far from the answer the derivatives mislead.
LONGEST_STEP = 0.05

#: Turns in a row with a larger error than the best one after which the best one stands.
_WORSE = 3

#: Passes over the joints in each turn, and where no turn follows.
_SWEEPS, _ALL_SWEEPS = 2, 4

#: Passes over the joints of an arm that is let go, at most, and the change of an angle in rad at which they agree.
_MOST_SWEEPS, _AGREED = 100, 1e-5

#: Evaluations of the output error of each joint in a turn, and with the step of the answer.
_EVALUATIONS, _FINISH = 15, 6

#: Change of an angle in rad by which the effect of the others' zeros is found.
_TURN = 1e-4


@dataclass(frozen=True)
class Arm:
    """An arm between two turns.

    Attributes:
        robots: The robot, of n joints, in each log.
        measured: Measured motion of each log.
        ends: Ends of the parts of the load of each log, each (K + 1,).
        motions: The motion of each log that the loads are of.
        datas: Each joint under these loads.
        fits: Of each joint.
        zeros: Angles of the robot model at which the encoders read zero, as the motions have them, shape (n,).
    """

    robots: Sequence[Robot]
    measured: Sequence[MeasuredMotion]
    ends: Sequence[Array]
    motions: Sequence[ArmMotion]
    datas: Sequence[JointData]
    fits: Sequence[JointFit]
    zeros: Array

    def error(self) -> float:
        """Return the mean logarithm of the errors of the roll-outs, over joints and logs."""
        pairs = zip(self.datas, self.fits, strict=True)
        return float(np.mean([np.log(log_errors(fit.problem(data), fit.parameters)).mean() for data, fit in pairs]))

    def part(self, logs: Sequence[int]) -> Arm:
        """Return the arm in some of the training logs."""
        return replace(
            self,
            robots=[self.robots[k] for k in logs],
            measured=[self.measured[k] for k in logs],
            ends=[self.ends[k] for k in logs],
            motions=[self.motions[k] for k in logs],
            datas=[data.part(logs) for data in self.datas],
        )


def settled(arm: Arm, progress: Callable[[str], None], least: int = LEAST_TURNS, most: int = MOST_TURNS) -> Arm:
    """Return an arm under loads that agree with the fits of all joints; a single joint has no others.

    Args:
        arm: With fits of each joint under its loads.
        progress: Called with each step in words.
        least: Turns at least.
        most: Turns at most.
    """
    best, error, worse = arm, np.inf, 0
    for turn in range(most if len(arm.fits) > 1 else 0):
        spreads = _spreads(arm)
        effects = _effects(arm, spreads)
        fits, agreed, wider = _agreed(arm, effects, spreads, _step(arm, effects))
        if turn >= least and _is_settled(arm, wider, agreed - arm.zeros):
            break
        progress(f"motion of the whole arm, turn {turn + 1}")
        arm = turned(arm, fits, agreed)
        now = arm.error()
        worse = 0 if now < error else worse + 1
        best, error = (arm, now) if now < error else (best, error)
        if worse == _WORSE:
            break
    return best if worse else arm


def turned(arm: Arm, fits: Sequence[JointFit], zeros: Array, finely: bool = False) -> Arm:
    """Return an arm with the motion, the loads and the fits that follow from fits and zeros of the encoders (n,).

    Args:
        arm: Before.
        fits: Of each joint.
        zeros: Of each joint, shape (n,), in rad.
        finely: Whether the fits are by the step of the answer.
    """
    parameters, motions = [fit.parameters for fit in fits], []
    for k, (robot, motion) in enumerate(zip(arm.robots, arm.motions, strict=True)):
        shifted = replace(motion, q=motion.q + zeros - arm.zeros)
        records = [data.records[k] for data in arm.datas]
        motions.append(relaxed(robot, records, parameters, arm.measured[k], shifted, arm.ends[k]))
    loads = [joint_loads(robot, motion) for robot, motion in zip(arm.robots, motions, strict=True)]
    datas = [data.under([load[joint] for load in loads]) for joint, data in enumerate(arm.datas)]
    most = _FINISH if finely else _EVALUATIONS
    fits = [fit_again(data, fit, most, finely) for data, fit in zip(datas, fits, strict=True)]
    return replace(arm, motions=motions, datas=datas, fits=fits, zeros=zeros)


def finished(arm: Arm, progress: Callable[[str], None]) -> tuple[Arm, list[Spread]]:
    """Return an arm that is settled with fits by the step of the answer, and how their errors spread them."""
    if len(arm.fits) == 1:
        return arm, [spread_of(arm.fits[0].problem(arm.datas[0]).finely, arm.fits[0].parameters)]
    progress("all joints with the step of the answer")
    effects = _effects(arm, _spreads(arm))
    ends = [divided(one, FINE_LOAD_STEP) for one in arm.ends]
    arm = replace(arm, ends=ends, motions=[motion_at(*pair) for pair in zip(arm.motions, ends, strict=True)])
    arm = turned(arm, arm.fits, arm.zeros, finely=True)
    pairs = zip(arm.datas, arm.fits, strict=True)
    spreads = [spread_of(fit.problem(data).finely, fit.parameters) for data, fit in pairs]
    fits, _, wider = _agreed(arm, effects, spreads, _step(arm, effects))
    return replace(arm, fits=fits), wider


def _spreads(arm: Arm) -> list[Spread]:
    pairs = zip(arm.datas, arm.fits, strict=True)
    return [spread_of(fit.problem(data), fit.parameters) for data, fit in pairs]


def _is_settled(arm: Arm, spreads: Sequence[Spread], moves: Array) -> bool:
    """Return whether no encoder's zero that is sought has moved by more than the noise of the logs."""
    sought = zip(_places(arm), spreads, moves.tolist(), strict=True)
    return all(abs(move) <= SETTLED * np.sqrt(own.covariance[k, k]) for k, own, move in sought if k >= 0)


def _effects(arm: Arm, spreads: Sequence[Spread]) -> list[Array]:
    """Return how the free parameters of each joint move with the zeros of all joints, each (f, n).

    A zero that is not sought has no effect, nor has the joint's own, which its fit finds.
    """
    n = len(arm.fits)
    errors, steps = [], []
    for data, fit, spread in zip(arm.datas, arm.fits, spreads, strict=True):
        problem = fit.problem(data)
        own, slopes = problem.errors(fit.parameters)
        weights = log_weights(problem, fit.parameters)
        scales = [weight / np.sqrt(len(error)) for weight, error in zip(weights, own, strict=True)]
        rows = np.concatenate([slope * scale for slope, scale in zip(slopes, scales, strict=True)])
        free = np.flatnonzero(spread.inner & spread.seen)
        sizes = np.maximum(np.linalg.norm(rows[:, free], axis=0), 1e-300)
        solve = np.zeros((rows.shape[1], len(rows)))
        solve[free] = np.linalg.pinv(rows[:, free] / sizes, rcond=1e-4) / sizes[:, None]
        errors.append(np.concatenate(own))
        steps.append(solve * np.concatenate([np.full(len(e), scale) for e, scale in zip(own, scales, strict=True)]))
    found: list[Array] = [np.zeros((len(fit.free), n)) for fit in arm.fits]
    for turned in [joint for joint, fit in enumerate(arm.fits) if "angle_offset" in fit.free]:
        loads = []
        for robot, motion in zip(arm.robots, arm.motions, strict=True):
            q = motion.q.copy()
            q[:, turned] += _TURN
            loads.append(joint_loads(robot, replace(motion, q=q)))
        for joint in set(range(n)) - {turned}:
            data, fit = arm.datas[joint].under([load[joint] for load in loads]), arm.fits[joint]
            moved = fit.problem(data).residuals(fit.parameters)
            found[joint][:, turned] = -steps[joint] @ (np.concatenate(moved) - errors[joint]) / _TURN
    return found


def _places(arm: Arm) -> list[int]:
    """Return the place of the encoder's zero among the free parameters of each joint; -1 where it is not sought."""
    return [fit.free.index("angle_offset") if "angle_offset" in fit.free else -1 for fit in arm.fits]


def _reach(arm: Arm, effects: Sequence[Array]) -> Array:
    """Return how the errors of the zeros of all joints reach each other, shape (n, n)."""
    n, place = len(arm.fits), _places(arm)
    between_zeros = np.array([effects[k][place[k]] if place[k] >= 0 else np.zeros(n) for k in range(n)])
    return np.asarray(np.linalg.inv(np.eye(n) - between_zeros))


def _step(arm: Arm, effects: Sequence[Array]) -> Array:
    """Return the step to the zeros that find themselves, shape (n,), no longer than LONGEST_STEP.

    A fit of joint k under the zeros o finds p_k(o); with its derivatives G_k these zeros are o + (I - G)^-1 (p(o) - o),
    G the rows of the zeros.
    """
    found = np.array([fit.parameters[PLACE["angle_offset"]] for fit in arm.fits])
    step = _reach(arm, effects) @ (found - arm.zeros)
    return step * min(1.0, LONGEST_STEP / max(float(np.abs(step).max()), 1e-12))


def _agreed(
    arm: Arm, effects: Sequence[Array], spreads: Sequence[Spread], step: Array
) -> tuple[list[JointFit], Array, list[Spread]]:
    """Return the fits after a step of the zeros of all joints, these zeros (n,), and the spread with theirs.

    The errors of all joints reach each other as their zeros do.
    """
    n, place, inverse = len(arm.fits), _places(arm), _reach(arm, effects)
    bounds = PARAMETERS[PLACE["angle_offset"]]
    moved = np.clip(arm.zeros + step, bounds.lower, bounds.upper)
    fits, wider = [], []
    for k, (data, fit, spread) in enumerate(zip(arm.datas, arm.fits, spreads, strict=True)):
        problem, covariance = fit.problem(data), spread.covariance
        lower, upper = problem.bounds()
        shift = effects[k] @ (moved - arm.zeros)
        values = fit.parameters[problem.places] + shift
        fits.append(replace(fit, parameters=problem.full(np.clip(values, lower, upper), fit.parameters)))
        reach = effects[k] @ inverse  # of the errors of all zeros, shape (f, n)
        own = np.eye(len(values))
        if place[k] >= 0:
            own[:, place[k]] += reach[:, k]
        total = own @ covariance @ own.T + np.outer(shift, shift)  # joints that do not agree yet are not known better
        for j in set(range(n)) - {k}:
            if place[j] >= 0:
                total += np.outer(reach[:, j], reach[:, j]) * spreads[j].covariance[place[j], place[j]]
        wider.append(replace(spread, covariance=total))
    return fits, moved, wider


def relaxed(
    robot: Robot,
    records: Sequence[JointRecord],
    parameters: Sequence[Array],
    measured: MeasuredMotion,
    motion: ArmMotion,
    ends: Array,
    sweeps: int = _SWEEPS,
    is_free: bool = False,
) -> ArmMotion:
    """Return the motion of an arm in one log by the roll-outs of its joints, and what these leave, filtered.

    One joint after the other, each under the load of what is known by then (Gauss-Seidel): as the mass matrix is
    positive definite, the accelerations come to agree however strongly joints are coupled.

    Args:
        robot: Of n joints.
        records: Each joint in the log.
        parameters: Of each joint, shape (COUNT,).
        measured: The measured motion, with its filter.
        motion: What is known of the motion so far.
        ends: Ends of the parts of the load, shape (K + 1,), in s.
        sweeps: Passes over the joints.
        is_free: Whether what the roll-outs leave of the positions is no part of the motion.
    """
    step = np.diff(ends)
    columns = [motion.q.copy(), motion.dq.copy(), motion.ddq.copy()]
    for _ in range(sweeps):
        inertias = inertias_of(robot, ArmMotion(motion.time, *columns))
        for joint, (record, own) in enumerate(zip(records, parameters, strict=True)):
            bias = bias_of(robot, ArmMotion(motion.time, *columns), joint)
            load = JointLoad(motion.time, inertias[:, joint], bias)
            model = rolled_out(record.under(load).finely(ends), own)
            if not np.isfinite(model.q).all():
                continue
            columns[0][:, joint] = 0.5 * (model.q[1:] + model.q[:-1]) + own[PLACE["angle_offset"]]
            columns[1][:, joint], columns[2][:, joint] = np.diff(model.q) / step, np.diff(model.dq) / step
            if is_free:
                continue
            stamps = record.samples[record.used, 0]
            rolled = model.q[:: len(step) // (len(record.q) - 1)]
            left = beyond_noise(record.q - rolled, record)[record.used, None]
            rest = measured.filtered(between(stamps, left, np.clip(measured.time, stamps[0], stamps[-1])))[:, 0]
            speed = np.gradient(rest, measured.time)
            parts = (rest, speed, np.gradient(speed, measured.time))
            for column, part in zip(columns, parts, strict=True):
                column[:, joint] += np.interp(motion.time, measured.time, part)
    return ArmMotion(motion.time, *columns)


def beyond_noise(left: Array, record: JointRecord) -> Array:
    """Return what a roll-out leaves of the positions, shape (N,), less the share that noise of the encoder explains.

    A twelfth of the squared step, or the noise that second differences show where that is more: where the model says
    all, its roll-out is the best that is known of the motion, and twice differentiated noise would be part of the load.
    """
    used = left[record.used]
    noise = max(encoder_step([record]) ** 2 / 12.0, float(np.mean(np.diff(used, 2) ** 2)) / 6.0)
    return left * max(0.0, 1.0 - noise / max(float(np.mean(used**2)), 1e-300))


def arm_loads(
    robot: Robot, log: ServoLog, laws: Sequence[DriveLaw], parameters: Sequence[Array], is_free: bool = False
) -> list[JointLoad]:
    """Return the load of every joint in a log whose drives are known; the measured one of a single joint.

    Args:
        robot: Of n joints.
        log: The log.
        laws: Drive law of each joint.
        parameters: Of each joint, shape (COUNT,).
        is_free: Whether the load is that of the whole arm let go: no joint is on its measured motion. It has no value
            where the roll-outs of the joints do not come to agree.
    """
    measured = measured_motion(log)
    loads = measured_loads(robot, log, measured)
    if robot.dof == 1:
        return loads
    records = [record_of(log, joint, loads[joint], law) for joint, law in enumerate(laws)]
    ends = divided(load_times(log, robot.dof), FINE_LOAD_STEP) if is_free else load_times(log, robot.dof)
    motion = motion_at(measured, ends)
    for joint, own in enumerate(parameters):
        motion.q[:, joint] += own[PLACE["angle_offset"]]
    own = carrying(robot, log)
    if not is_free:
        return joint_loads(own, relaxed(own, records, parameters, measured, motion, ends, _ALL_SWEEPS))
    for _ in range(_MOST_SWEEPS):
        before, motion = motion, relaxed(own, records, parameters, measured, motion, ends, 1, is_free=True)
        if np.abs(motion.q - before.q).max() < _AGREED:
            return joint_loads(own, motion)
    motion.q[:] = np.nan
    return joint_loads(own, motion)
