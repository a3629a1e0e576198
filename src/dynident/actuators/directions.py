"""Joints that run the other way, against the robot model or against their commands: by the torques of the bodies."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import nnls

from dynident.actuators.joint_fit import OFF_S
from dynident.actuators.joint_load import CUTOFF_HZ, MeasuredMotion, between, carrying, measured_motion, rigid_inertia
from dynident.actuators.linear_start import REST, SLEWS, limited_goal
from dynident.actuators.servo_log import MOVED, ServoLog
from dynident.arrays import Array, BoolArray
from dynident.model.kernels import batched
from dynident.model.robot import Robot

#: Delay in s of the torques that is assumed: servos have 2 to 20 ms, and the filter lets 10 Hz pass.
_DELAY_S = 0.01

#: Quantiles of the position error at which the torque of a drive may bend: any torque that grows with the error and
#: saturates is close to a sum of these.
_BENDS = (0.1, 0.25, 0.5, 0.75, 1.0)

#: What is told has to be this much more likely than the logs as they are, by this many standard deviations over pieces
#: of this length in s, and lower the logarithm of what is left by this on average.
ODDS, _DEVIATIONS, _PIECE_S, _LEAST = 1e3, 4.0, 1.0, 0.05

#: Step in s of the torques of the bodies, and change of an angle in rad by which their slope is found.
_STEP_S, _TURN = 0.01, 1e-4

#: Farthest zero of an encoder in rad that a fit makes up for, and those beyond it that are tried.
_ZERO = 0.3
_ZEROS = [angle for angle in np.linspace(-np.pi, np.pi, 24, endpoint=False).tolist() if abs(angle) > _ZERO]

#: What explains this share of what the best does is told beside it; a zero that explains more than that: in its place.
_NEARLY = 0.9

#: Logs of this length in s in all are looked at.
_LONG_S = 300.0

#: First words of what is said of a joint that runs the other way.
TURNED = "another direction"

#: What may run the other way: positions and commands against the robot model, one of them, and the torque's column.
AXIS, COMMAND, POSITION, STATE = "axis", "command", "position", "state"

#: What is seen of a joint, and what to do.
_SEEN = {
    AXIS: "moves against the axis of the robot model",
    COMMAND: "is commanded against its positions",
    POSITION: "has positions against its commands and the axis of the robot model",
    STATE: "is driven where its drive is off by the column, and not where it is on",
}
_REMEDY = {
    AXIS: "turn over the axis of {} in the robot model, or its sign in the log (log: {{units: {{position: -rad}}}})",
    COMMAND: "turn over the sign of the commands of {} in the log",
    POSITION: "turn over the sign of the positions of {} in the log",
    STATE: "the column of the torque is inverted: turn it over (1 is on)",
}


@dataclass(frozen=True)
class Turned:
    """What explains the logs of an arm far better than they are.

    Attributes:
        kind: AXIS, COMMAND, POSITION or STATE.
        joint: Number of the joint that is turned over; of STATE the one whose torque says it most.
        more: Logarithm of how much more likely the logs are.
        is_sure: Whether that is more than chance.
        left: What drive and friction leave of the torque of the joint that says it most, over what they leave as it is.
        zero: Zero of the joint's encoder in rad that explains the logs as well or better; 0 for none.
        is_zero: Whether that explains them better.
        others: Other kinds and joints that explain the logs nearly as well.
    """

    kind: str
    joint: int
    more: float
    is_sure: bool
    left: float
    zero: float = 0.0
    is_zero: bool = False
    others: tuple[tuple[str, int], ...] = ()

    def told(self, joints: Sequence[str]) -> tuple[str, str]:
        """Return evidence and remedy, in words."""
        name = joints[self.joint]
        zero = f"correct the angle where the encoder of {name} reads 0 (log: zero), by about {self.zero:.1f} rad"
        if self.is_zero:
            mounting = "or state how the arm is mounted (gravity: in the case file)"
            return f"the weight fits about {self.zero:.1f} rad more at the encoder of {name}", f"{zero}; {mounting}"
        share = f"drive and friction leave {100 * self.left:.0f} % of what they leave of its torque as it is"
        evidence = f"{name} {_SEEN[self.kind]}: turned over, {share}"
        ways = [_REMEDY[kind].format(joints[joint]) for kind, joint in ((self.kind, self.joint), *self.others)]
        return evidence, "; or ".join([*ways, *([zero] if self.zero else [])])

    def remark(self, joints: Sequence[str]) -> str:
        """Return evidence and remedy as one remark on the joint."""
        return f"{TURNED}: {'; '.join(self.told(joints))}"


def turned_over(robot: Robot, logs: Sequence[ServoLog]) -> list[Turned]:
    """Return the joints that run the other way, one after the other, the plainest first.

    Friction, armature and a drive whose torque grows with the position error, of any law, explain the torque that the
    bodies ask for along the measured motion, in each log, with a zero of the encoder that is off by up to 0.3 rad: once
    as the log is, and once with each joint turned over. That is told where the logs are far more likely with it, by the
    test of Vuong, "Likelihood ratio tests for model selection and non-nested hypotheses", Econometrica 57, 1989, over
    pieces of the logs. An arm that looks the same from both sides is not told, and commands of a joint that follows
    them are right.

    Args:
        robot: With inertias, in SI units.
        logs: Logs of its joints.

    Raises:
        NotConsistent: The robot model has no inertias.
    """
    found, chosen = list[Turned](), _some(logs)
    while len(found) < robot.dof:
        parts = [LogTorques.of(robot, log) for log in chosen]
        best = likeliest(parts, robot.dof)
        if best is None:
            break
        found.append(_beside_zeros(parts, best))
        if found[-1].is_zero:
            break
        chosen = [_as_turned(log, best) for log in chosen]
    return found


def likeliest(parts: Sequence[LogTorques], joints: int, is_switched: bool = False) -> Turned | None:
    """Return what explains some logs best, turned over; None where nothing does.

    Args:
        parts: Of each log.
        joints: Number of joints.
        is_switched: Whether the column of the torque state may be turned over too.
    """
    away = np.sum([part.followed for part in parts], axis=0) < 0.0
    tried = [(AXIS, joint) for joint in range(joints)]
    tried += [(kind, joint) for kind in (COMMAND, POSITION) for joint in np.flatnonzero(away).tolist()]
    tried += [(STATE, 0)] if is_switched else []
    found = [_compared(*each, parts, [part.turned(*each) for part in parts]) for each in tried]
    best = max((one for one in found if one.is_sure), key=lambda one: one.more, default=None)
    if best is None:
        return None
    near = [(one.kind, one.joint) for one in found if one is not best and one.more > _NEARLY * best.more]
    return replace(best, others=tuple(near))


def _beside_zeros(parts: Sequence[LogTorques], best: Turned) -> Turned:
    """Return what is turned over with the zero of the encoder that explains the logs as well."""
    joint = best.joint
    others = [_compared(AXIS, joint, parts, [part.turned(AXIS, joint, zero) for part in parts]).more for zero in _ZEROS]
    most = int(np.argmax(others))
    if others[most] < _NEARLY * best.more:
        return best
    return replace(best, zero=_ZEROS[most], is_zero=others[most] > best.more / _NEARLY)


def _some(logs: Sequence[ServoLog]) -> list[ServoLog]:
    """Return logs of some minutes in all, drawn from those that are given."""
    order = np.random.default_rng(0).permutation(len(logs))
    lengths = np.cumsum([logs[k].time[-1] - logs[k].time[0] for k in order])
    return [logs[k] for k in sorted(order[: 1 + int(np.searchsorted(lengths, _LONG_S))].tolist())]


def _as_turned(log: ServoLog, found: Turned) -> ServoLog:
    """Return a log with a joint turned over."""
    sides = np.where(np.arange(len(log.joints)) == found.joint, -1.0, 1.0)
    if found.kind != COMMAND:
        log = replace(log, q=sides * log.q)
    if found.kind != POSITION:
        log = replace(log, q_ref=sides * log.q_ref, dq_ref=sides * log.dq_ref, added=sides * log.added)
    return log


@dataclass(frozen=True)
class TorqueRows:
    """What may explain the torque of the bodies about one joint in one log.

    Attributes:
        always: Filtered columns of friction and armature, shape (K, c).
        drives: Those of the drive at each slew limit with the log as it is, and by the kind that is turned over.
        moves: Samples of the grid of the motion where the joint moves, K of them.
        count: Values of the filtered torque there that are independent.
    """

    always: Array
    drives: dict[str, list[Array]]
    moves: BoolArray
    count: float

    def left(self, kind: str, target: Array, slope: Array | None = None) -> Array:
        """Return what is left of a torque on the grid of the motion, shape (K,), at the slew limit that leaves least.

        Args:
            kind: COMMAND or STATE where that is turned over; else empty.
            target: The torque, shape (M,).
            slope: Its change by the zero of the encoder, which may be off by up to 0.3 rad, shape (M,); None for none.
        """
        aim, turn = target[self.moves], np.zeros(self.moves.sum()) if slope is None else slope[self.moves]
        errors = [self._left(drive, aim, turn) for drive in self.drives[kind]]
        return min(errors, key=lambda error: float(error @ error))

    def _left(self, drive: Array, target: Array, slope: Array) -> Array:
        columns = np.hstack([self.always, drive])
        sizes = np.linalg.norm(columns, axis=0)
        columns = columns / np.where(sizes > 0, sizes, 1.0)
        factor = np.asarray(np.linalg.qr(np.column_stack([columns, slope, target]), mode="r"))
        matrix, turn, aim = factor[:, :-2], factor[:, -2], factor[:, -1]
        found = nnls(np.column_stack([matrix, turn, -turn]), aim)[0]
        zero = float(np.clip(found[-2] - found[-1], -_ZERO, _ZERO))
        return columns @ nnls(matrix, aim - zero * turn)[0] + zero * slope - target


@dataclass(frozen=True)
class LogTorques:
    """One log.

    Attributes:
        robot: With what it carries.
        motion: Measured motion, on a grid.
        rows: Of each joint; None of one that hardly moves or is not told to.
        left: What is left of each torque with the log as it is, each (K,); None the same.
        followed: Sum of products of command and position about their means where the drive is on, shape (n,): below 0
            where a joint goes away from its command. That alone lets the direction of commands be in doubt: a joint of
            next to no weight has next to no torque of the bodies, which errors of the drive's torque explain as well.
    """

    robot: Robot
    motion: MeasuredMotion
    rows: list[TorqueRows | None]
    left: list[Array | None]
    followed: Array

    @classmethod
    def of(cls, robot: Robot, log: ServoLog) -> LogTorques:
        """Return what a log says."""
        motion, robot = measured_motion(log), carrying(robot, log)
        told = np.ptp(log.q_ref, axis=0) > MOVED
        rows = [joint_rows(log, joint, motion) if told[joint] else None for joint in range(robot.dof)]
        on = log.enabled & ~log.failed
        pairs = zip(log.q_ref.T, log.q.T, on.T, strict=True)
        followed = [float((c[k] - c[k].mean()) @ (q[k] - q[k].mean())) if k.any() else 0.0 for c, q, k in pairs]
        part = cls(robot, motion, rows, [None] * robot.dof, np.array(followed))
        return replace(part, left=part._errors([""] * robot.dof, np.ones(robot.dof)))

    def turned(self, kind: str, joint: int, zero: float | None = None) -> list[Array | None]:
        """Return what is left of each torque with a joint turned over, or with another zero of its encoder."""
        here = np.arange(self.robot.dof) == joint
        if zero is not None:
            return self._errors([""] * self.robot.dof, np.ones(self.robot.dof), zero * here)
        if kind == STATE:
            return self._errors([kind] * self.robot.dof, np.ones(self.robot.dof))
        kinds = ["" if kind == AXIS or k != joint else COMMAND for k in range(self.robot.dof)]
        return self._errors(kinds, np.where(here & (kind != COMMAND), -1.0, 1.0))

    def _errors(self, kinds: Sequence[str], sides: Array, turns: Array | float = 0.0) -> list[Array | None]:
        target, slope = bodies_torques(self.robot, self.motion, sides, turns)
        found = list[Array | None]()
        for rows, kind, *columns in zip(self.rows, kinds, target.T, slope.T, strict=True):
            found.append(None if rows is None else rows.left(kind, *columns))
        return found


def joint_rows(log: ServoLog, joint: int, motion: MeasuredMotion, has_weight: bool = False) -> TorqueRows | None:
    """Return what may explain the torque of a joint; None where it hardly moves.

    Args:
        log: The log.
        joint: Number of the joint.
        motion: Measured motion of the log.
        has_weight: Whether any weight over its own angle may explain it too.
    """
    time, q, dq = motion.time, motion.q[:, joint], motion.dq[:, joint]
    now, before = (np.clip(np.searchsorted(log.time, at, side="right") - 1, 0, None) for at in (time, time - _DELAY_S))
    moves, step, on = np.abs(dq) > REST, float(time[1] - time[0]), log.enabled[now, joint]
    if np.sum(moves) * step <= OFF_S:
        return None
    angle, command = between(log.time, log.q[:, [joint]], time)[:, 0], log.q_ref[before, joint]
    given = np.array([log.added[before, joint], log.dq_ref[before, joint]])

    def drives(side: float, state: BoolArray) -> list[Array]:
        found = []
        for slew in float(np.abs(dq).max()) * np.array(SLEWS):
            error = limited_goal(time, side * command, slew) - angle
            bends = np.quantile(np.abs(error[moves]), _BENDS)
            own = [np.clip(error, -bend, bend) for bend in bends]
            found.append(motion.filtered((np.array([*own, -dq, *(side * given)]) * state).T)[moves])
        return found

    weight = [np.ones(len(q)), np.sin(q), np.cos(q)] if has_weight else []
    always = np.array([*weight, *(-one for one in weight), -dq, -np.tanh(dq / REST), -motion.ddq[:, joint]])
    cutoff = min(CUTOFF_HZ, 0.2 / float(np.median(np.diff(log.time))))
    return TorqueRows(
        motion.filtered(always.T)[moves],
        {"": drives(1.0, on), COMMAND: drives(-1.0, on), STATE: drives(1.0, on if on.all() else ~on)},
        moves,
        2.0 * cutoff * step * float(moves.sum()),
    )


def bodies_torques(
    robot: Robot, motion: MeasuredMotion, sides: Array | float = 1.0, turns: Array | float = 0.0
) -> tuple[Array, Array]:
    """Return the torques of the bodies in the directions of a log and their slope, filtered, each (M, n).

    Args:
        robot: With inertias.
        motion: Measured motion of the log, on a grid of M samples.
        sides: Direction of each joint of the robot model in the log, 1 or -1, shape (n,).
        turns: What is added to its angles, in rad, shape (n,).
    """
    time = np.arange(motion.time[0], motion.time[-1], _STEP_S)

    def on(grid: Array, stamps: Array, values: Array) -> Array:
        return np.column_stack([np.interp(grid, stamps, column) for column in values.T])

    q, dq, ddq = (sides * on(time, motion.time, values) for values in (motion.q, motion.dq, motion.ddq))
    theta, q = rigid_inertia(robot), q + turns
    torque = batched.inverse_dynamics(robot.chain, theta, q, dq, ddq)
    slope = np.empty_like(torque)
    for joint in range(robot.dof):
        moved = q + _TURN * (np.arange(robot.dof) == joint)
        slope[:, joint] = batched.inverse_dynamics(robot.chain, theta, moved, dq, ddq)[:, joint] - torque[:, joint]
    whole = motion.filtered(on(motion.time, time, np.hstack([sides * torque, slope / _TURN])))
    return whole[:, : robot.dof], whole[:, robot.dof :]


def _compared(kind: str, joint: int, parts: Sequence[LogTorques], others: Sequence[list[Array | None]]) -> Turned:
    """Return how much more likely some logs are with what is left of the torques in place of that as they are."""
    more, count, squares = list[Array](), 0.0, np.zeros((2, parts[0].robot.dof))
    for part, other in zip(parts, others, strict=True):
        time = part.motion.time - part.motion.time[0]
        pieces = np.zeros(int(time[-1] / _PIECE_S) + 1)
        for k, (rows, as_is, turned) in enumerate(zip(part.rows, part.left, other, strict=True)):
            if rows is None or as_is is None or turned is None:
                continue
            own, than = (np.maximum(error**2, np.finfo(float).tiny) for error in (as_is, turned))
            gain = 0.5 * (math.log(own.mean() / than.mean()) + own / own.mean() - than / than.mean())
            np.add.at(pieces, (time[rows.moves] / _PIECE_S).astype(int), gain * rows.count / len(gain))
            squares[:, k] += own.sum(), than.sum()
            count += rows.count
        more.append(pieces[pieces != 0.0])
    each = np.concatenate(more) if more else np.zeros(0)
    total, spread = float(each.sum()), float(np.std(each) * math.sqrt(len(each))) if len(each) else 0.0
    is_sure = total > max(math.log(ODDS), _DEVIATIONS * spread, _LEAST * count)
    ratios = np.sqrt(squares[1] / np.maximum(squares[0], np.finfo(float).tiny))
    return Turned(kind, joint, total, is_sure, float(ratios[squares[0] > 0].min(initial=1.0)))
