"""What may explain the torque that the bodies ask of a joint along its measured motion: friction, armature, a drive."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.optimize import nnls

from dynident.actuators.drive_law import DriveLaw
from dynident.actuators.joint_load import CUTOFF_HZ, MeasuredMotion, between, carrying, measured_motion, rigid_inertia
from dynident.actuators.linear_start import OFF_S, REST, SLEWS, limited_goal
from dynident.actuators.servo_log import ServoLog
from dynident.arrays import Array, BoolArray
from dynident.model.kernels import batched
from dynident.model.robot import Robot

#: Delay in s of the torques that is assumed: servos have 2 to 20 ms, and the filter lets 10 Hz pass.
_DELAY_S = 0.01

#: Delays that are tried where torques jump with the sign of the error.
_DELAYS = (0.003, 0.006, 0.01, 0.015, 0.02)

#: Quantiles of the position error at which the torque of a drive may bend: any torque that grows with the error and
#: saturates is close to a sum of these.
_BENDS = (0.1, 0.25, 0.5, 0.75, 1.0)

#: Step in s of the torques of the bodies, and change of an angle in rad by which their slope is found.
_STEP_S, _TURN = 0.01, 1e-4

#: Farthest zero of an encoder in rad that a fit makes up for.
ZERO = 0.3

#: What of a drive may be turned over: its command against its position, and the column of the torque.
COMMAND, STATE = "command", "state"

#: A drive at its limit throughout, whose torque has the sign of the error alone, and one that never is.
LIMITED, PROPORTIONAL = "limited", "proportional"

#: What is said of a drive at its limit in all of its motion, and what to do.
LIMITED_WORDS = "at its limit throughout: its torque has one size, whatever the position error"
LESS = "log slower or smaller motions, or a lower position gain, so that the torque stays below its limit"

#: What is told has to be this much more likely than the logs as they are.
ODDS = 1e3


@dataclass(frozen=True)
class TorqueRows:
    """What may explain the torque of the bodies about one joint in one log.

    Attributes:
        always: Filtered columns of friction and armature, shape (K, c).
        drive: Returns those of the drive, shape (K, d), by what is turned over or LIMITED or PROPORTIONAL, empty for
            nothing, and the place of the slew limit in SLEWS.
        moves: Samples of the grid of the motion where the joint moves, K of them.
        count: Values of the filtered torque there that are independent.
        factors: Columns and their QR factors by kind and place of the slew limit, made when asked for.
    """

    always: Array
    drive: Callable[[str, int], Array]
    moves: BoolArray
    count: float
    factors: dict[tuple[str, int], tuple[Array, Array, Array]] = field(default_factory=dict)

    def left(self, kind: str, target: Array, slope: Array | None = None) -> Array:
        """Return what is left of a torque on the grid of the motion, shape (K,), at the slew limit that leaves least.

        As a share of the root mean square of the torque: the drive's is not known, and bodies of less inertia or weight
        would else leave less.

        Args:
            kind: As of ``drive``.
            target: The torque, shape (M,).
            slope: Its change by the zero of the encoder, which may be off by up to 0.3 rad, shape (M,); None for none.
        """
        aim, turn = target[self.moves], np.zeros(self.moves.sum()) if slope is None else slope[self.moves]
        errors = [self._left(kind, slew, aim, turn) for slew in range(len(SLEWS))]
        return min(errors, key=lambda error: float(error @ error))

    def cost(self, kind: str, target: Array, slope: Array) -> float:
        """Return minus the logarithm of the likelihood of a torque, each (M,), without a slew limit of the command."""
        error = self._left(kind, 0, target[self.moves], slope[self.moves])
        return 0.5 * self.count * math.log(max(float(np.mean(error**2)), float(np.finfo(float).tiny)))

    def _factors(self, kind: str, slew: int) -> tuple[Array, Array, Array]:
        """Return the columns at a slew limit in units of their length, and their QR factors."""
        if (kind, slew) not in self.factors:
            columns = np.hstack([self.always, self.drive(kind, slew)])
            sizes = np.linalg.norm(columns, axis=0)
            columns = columns / np.where(sizes > 0, sizes, 1.0)
            basis, factor = np.linalg.qr(columns)
            self.factors[kind, slew] = columns, basis, factor
        return self.factors[kind, slew]

    def _left(self, kind: str, slew: int, target: Array, slope: Array) -> Array:
        columns, basis, factor = self._factors(kind, slew)
        size = max(float(np.sqrt(np.mean(target**2))), float(np.finfo(float).tiny))
        both = np.column_stack([slope, target]) / size
        within = basis.T @ both
        turn, aim = np.vstack([within, np.linalg.qr(both - basis @ within, mode="r")]).T
        matrix = np.vstack([factor, np.zeros((2, len(factor.T)))])
        found = nnls(np.column_stack([matrix, turn, -turn]), aim)[0]
        zero = float(np.clip(found[-2] - found[-1], -ZERO, ZERO))
        return columns @ nnls(matrix, aim - zero * turn)[0] + both @ (zero, -1.0)


def joint_rows(
    log: ServoLog, joint: int, motion: MeasuredMotion, has_weight: bool = False, delay: float = _DELAY_S
) -> TorqueRows | None:
    """Return what may explain the torque of a joint; None where it hardly moves.

    Args:
        log: The log.
        joint: Number of the joint.
        motion: Measured motion of the log.
        has_weight: Whether any weight over its own angle may explain it too.
        delay: Of the torques, in s.
    """
    time, q, dq = motion.time, motion.q[:, joint], motion.dq[:, joint]
    now, before = (np.clip(np.searchsorted(log.time, at, side="right") - 1, 0, None) for at in (time, time - delay))
    rest, step, on = log.sized(joint, REST), float(time[1] - time[0]), log.enabled[now, joint]
    moves = np.abs(dq) > rest
    if np.sum(moves) * step <= OFF_S:
        return None
    angle, command = between(log.time, log.q[:, [joint]], time)[:, 0], log.q_ref[before, joint]
    given = np.array([log.added[before, joint], log.dq_ref[before, joint]])

    def drive(kind: str, slew: int) -> Array:
        side, state = -1.0 if kind == COMMAND else 1.0, ~on if kind == STATE and not on.all() else on
        error = limited_goal(time, side * command, float(np.abs(dq).max()) * SLEWS[slew]) - angle
        bends = np.quantile(np.abs(error[moves]), _BENDS)
        own = [np.clip(error, -bend, bend) for bend in bends]
        own = {LIMITED: [np.sign(error)], PROPORTIONAL: [error]}.get(kind, own)
        return motion.filtered((np.array([*own, -dq, *(side * given)]) * state).T)[moves]

    weight = [np.ones(len(q)), np.sin(q), np.cos(q)] if has_weight else []
    always = np.array([*weight, *(-one for one in weight), -dq, -np.tanh(dq / rest), -motion.ddq[:, joint]])
    cutoff = min(CUTOFF_HZ, 0.2 / float(np.median(np.diff(log.time))))
    return TorqueRows(motion.filtered(always.T)[moves], drive, moves, 2.0 * cutoff * step * float(moves.sum()))


def limited_throughout(robot: Robot, laws: Sequence[DriveLaw], logs: Sequence[ServoLog]) -> list[int]:
    """Return the joints whose drives, of an unknown gain, are at their limit in all of their motion.

    Then a torque with the sign of the position error alone explains the torque of the bodies at least as well as any
    that grows with the error, and far better than one in proportion to it.

    Args:
        robot: With inertias, in SI units.
        laws: Drive law of each joint; a joint whose gain is known is none of them.
        logs: Logs of its joints.

    Raises:
        NotConsistent: The robot model has no inertias.
    """
    free = [joint for joint, law in enumerate(laws) if law.gain_is_free and math.isfinite(law.limit)]
    totals = {joint: np.zeros((len(_DELAYS), 3)) for joint in free}
    for log in logs:
        if not totals:
            break
        motion, joints = measured_motion(log), list(totals)
        targets, slopes = bodies_torques(carrying(robot, log), motion, joints=joints)
        for joint, *own in zip(joints, targets.T, slopes.T, strict=True):
            rows = [joint_rows(log, joint, motion, delay=delay) for delay in _DELAYS]
            costs = [[row.cost(kind, *own) for kind in (LIMITED, "", PROPORTIONAL)] for row in rows if row is not None]
            if costs:  # the joint moves
                totals[joint] += costs
            limited, growing, _ = totals[joint].min(axis=0).tolist()
            if limited - growing > math.log(ODDS):  # it was below its limit
                totals.pop(joint)
    least = {joint: total.min(axis=0).tolist() for joint, total in totals.items()}
    return [joint for joint, (limited, *more) in least.items() if limited <= min(more[0], more[1] - math.log(ODDS))]


def bodies_torques(
    robot: Robot,
    motion: MeasuredMotion,
    sides: Array | float = 1.0,
    turns: Array | float = 0.0,
    joints: Sequence[int] | None = None,
) -> tuple[Array, Array]:
    """Return the torques of the bodies in the directions of a log and their slope, filtered, each (M, j).

    Args:
        robot: With inertias.
        motion: Measured motion of the log, on a grid of M samples.
        sides: Direction of each joint of the robot model in the log, 1 or -1, shape (n,).
        turns: What is added to its angles, in rad, shape (n,).
        joints: The j joints that are asked for; None for all.
    """
    time = np.arange(motion.time[0], motion.time[-1], _STEP_S)
    joints = range(robot.dof) if joints is None else joints

    def on(grid: Array, stamps: Array, values: Array) -> Array:
        return np.array([np.interp(grid, stamps, column) for column in values.T]).T

    q, dq, ddq = (sides * on(time, motion.time, values) for values in (motion.q, motion.dq, motion.ddq))
    theta, q = rigid_inertia(robot), q + turns
    torque = batched.inverse_dynamics(robot.chain, theta, q, dq, ddq)
    columns = [(sides * torque)[:, joint] for joint in joints]
    for joint in joints:
        moved = q + _TURN * (np.arange(robot.dof) == joint)
        turned = batched.inverse_dynamics(robot.chain, theta, moved, dq, ddq)
        columns.append((turned - torque)[:, joint] / _TURN)
    whole = motion.filtered(on(motion.time, time, np.array(columns).T))
    return whole[:, : len(joints)], whole[:, len(joints) :]
