"""Joints that run the other way, against the robot model or against their commands: by the torques of the bodies."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dynident.actuators.joint_load import MeasuredMotion, carrying, measured_motion
from dynident.actuators.servo_log import MOVED, ServoLog
from dynident.actuators.torque_rows import COMMAND, ODDS, STATE, TorqueRows, bodies_torques, joint_rows
from dynident.arrays import Array, BoolArray
from dynident.model.robot import Robot

#: What is told has to be more likely than the logs as they are by this many standard deviations over pieces of this
#: length in s too, and lower the logarithm of what is left by this on average for each joint that runs otherwise.
_DEVIATIONS, _PIECE_S, _LEAST = 4.0, 1.0, 0.05

#: What explains this share of what the best does is told beside it.
NEARLY = 0.9

#: First words of what is said of a joint that runs the other way, and of one whose encoder has another zero.
TURNED, ZEROED, EXCHANGED = "another direction", "another zero", "another order"

#: What may run the other way: positions and commands against the robot model, one of them, and the torque's column.
AXIS, POSITION, ORDER = "axis", "position", "order"

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
        kind: AXIS, COMMAND, POSITION, STATE or ORDER, of two joints that are exchanged: this one and that of others.
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
        if self.kind == ORDER:
            both = f"{name} and {joints[self.others[0][1]]}"
            evidence = f"{both} are exchanged: the other way round the torques of the bodies fit, without another zero"
            return evidence, f"exchange the columns of {both}, of positions and of commands (log: columns: q, q_ref)"
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
        words = ZEROED if self.is_zero else EXCHANGED if self.kind == ORDER else TURNED
        return f"{words}: {'; '.join(self.told(joints))}"


def likeliest(parts: Sequence[LogTorques], is_switched: bool = False) -> Turned | None:
    """Return what explains some logs best, turned over; None where nothing does.

    Args:
        parts: Of each log.
        is_switched: Whether the column of the torque state may be turned over too.
    """
    away = np.flatnonzero(runs_away(parts)).tolist()
    tried = [(AXIS, joint) for joint in range(parts[0].robot.dof)]
    tried += [(kind, joint) for kind in (COMMAND, POSITION) for joint in away]
    tried += [(STATE, 0)] if is_switched else []
    found = [compared(*each, parts, parts[0].directions.turned(*each)) for each in tried]
    best = max((one for one in found if one.is_sure), key=lambda one: one.more, default=None)
    if best is None:
        return None
    near = [(one.kind, one.joint) for one in found if one is not best and one.more > NEARLY * best.more]
    return replace(best, others=tuple(near))


def runs_away(parts: Sequence[LogTorques]) -> BoolArray:
    """Return whether each joint goes away from its commands in some logs, shape (n,)."""
    return np.asarray(np.sum([part.followed for part in parts], axis=0) < 0.0)


@dataclass(frozen=True)
class Directions:
    """How the joints of an arm run in its logs, beside what the logs say.

    Attributes:
        sides: Direction of each joint of the robot model, 1 or -1, shape (n,).
        drives: COMMAND where the drive of a joint is turned over, STATE its torque's column, else empty; n of them.
        zeros: What is added to the angle of each joint in rad, shape (n,).
    """

    sides: Array
    drives: tuple[str, ...]
    zeros: Array

    @classmethod
    def as_is(cls, joints: int) -> Directions:
        """Return those of logs of some joints as they are."""
        return cls(np.ones(joints), ("",) * joints, np.zeros(joints))

    def turned(self, kind: str, joint: int) -> Directions:
        """Return them with a joint turned over; STATE: the column of all joints."""
        here = np.arange(len(self.sides)) == joint
        if kind == STATE:
            return replace(self, drives=(STATE,) * len(here))
        sides = np.where(here & (kind != COMMAND), -self.sides, self.sides)
        if kind == AXIS:
            return replace(self, sides=sides)
        other = "" if self.drives[joint] == COMMAND else COMMAND
        return replace(self, sides=sides, drives=(*self.drives[:joint], other, *self.drives[joint + 1 :]))

    def others(self, than: Directions) -> int:
        """Return how many joints run otherwise by others; 1 for the column of all."""
        pairs = zip(self.sides, than.sides, self.drives, than.drives, self.zeros, than.zeros, strict=True)
        if STATE in than.drives:
            return 1
        return sum(side != s or drive != d or zero != z for side, s, drive, d, zero, z in pairs)

    def without(self, joint: int) -> tuple[Directions, str]:
        """Return them with a joint as it is in the logs, and what of it was turned over; empty for nothing."""
        is_turned, is_driven = self.sides[joint] < 0.0, self.drives[joint] == COMMAND
        kind = (POSITION if is_turned else COMMAND) if is_driven else AXIS if is_turned else ""
        return (self.turned(kind, joint) if kind else self).zeroed(joint, 0.0), kind

    def zeroed(self, joint: int, zero: float) -> Directions:
        """Return them with another zero of the encoder of a joint, in rad."""
        return replace(self, zeros=np.where(np.arange(len(self.zeros)) == joint, zero, self.zeros))


@dataclass(frozen=True)
class LogTorques:
    """One log.

    Attributes:
        robot: With what it carries.
        motion: Measured motion, on a grid.
        rows: Of each joint; None of one that hardly moves or is not told to.
        followed: Sum of products of command and position about their means where the drive is on, shape (n,): below 0
            where a joint goes away from its command. That alone lets the direction of commands be in doubt: a joint of
            next to no weight has next to no torque of the bodies, which errors of the drive's torque explain as well.
        directions: How the joints are taken to run.
        left: What is left of each torque then, each (K,); None the same.
    """

    robot: Robot
    motion: MeasuredMotion
    rows: list[TorqueRows | None]
    followed: Array
    directions: Directions
    left: list[Array | None]

    @classmethod
    def of(cls, robot: Robot, log: ServoLog) -> LogTorques:
        """Return what a log says."""
        motion, robot = measured_motion(log), carrying(robot, log)
        told = np.ptp(log.q_ref, axis=0) > [log.sized(joint, MOVED) for joint in range(robot.dof)]
        rows = [joint_rows(log, joint, motion) if told[joint] else None for joint in range(robot.dof)]
        on = log.enabled & ~log.failed
        pairs = zip(log.q_ref.T, log.q.T, on.T, strict=True)
        followed = [float((c[k] - c[k].mean()) @ (q[k] - q[k].mean())) if k.any() else 0.0 for c, q, k in pairs]
        directions = Directions.as_is(robot.dof)
        return cls(robot, motion, rows, np.array(followed), directions, []).taken(directions)

    def taken(self, directions: Directions) -> LogTorques:
        """Return the log with its joints taken to run in some way."""
        turned = [one != other for one, other in zip(directions.drives, self.directions.drives, strict=True)]
        followed = np.where(turned, -self.followed, self.followed)
        return replace(self, followed=followed, directions=directions, left=self.left_of(directions))

    @property
    def moves(self) -> BoolArray:
        """Which joints move, shape (n,)."""
        return np.array([rows is not None for rows in self.rows])

    def left_of(self, directions: Directions) -> list[Array | None]:
        """Return what is left of each torque where the joints run in some way, each (K,)."""
        found = list[Array | None]([None] * self.robot.dof)
        for joint, rows, target, slope in self._torques(directions):
            found[joint] = rows.left(directions.drives[joint], target, slope)
        return found

    def costs(self, directions: Directions, reach: float = 1.0) -> list[float]:
        """Return minus the logarithm of the likelihood of each torque where the joints run in some way.

        Args:
            directions: How they run.
            reach: 0: with the zeros of the encoders as they are taken to be; 1: within 0.3 rad of these.
        """
        found = [0.0] * self.robot.dof
        for joint, rows, target, slope in self._torques(directions):
            found[joint] = rows.cost(directions.drives[joint], target, reach * slope)
        return found

    def _torques(self, directions: Directions) -> list[tuple[int, TorqueRows, Array, Array]]:
        """Return joint, rows, torque and its slope of each joint that moves."""
        moves = np.flatnonzero(self.moves).tolist()
        if not moves:
            return []
        torques = bodies_torques(self.robot, self.motion, directions.sides, directions.zeros, moves)
        parts = zip(moves, *(each.T for each in torques), strict=True)
        return [(joint, rows, *own) for joint, *own in parts if (rows := self.rows[joint])]


def compared(kind: str, joint: int, parts: Sequence[LogTorques], directions: Directions, tried: float = 1.0) -> Turned:
    """Return how much more likely some logs are where the joints run otherwise than they are taken to.

    Args:
        kind: What is turned over.
        joint: Number of its joint.
        parts: Of each log.
        directions: How the joints run then.
        tried: Ways of turning joints over that this one is the best of.
    """
    more, count, squares = list[Array](), 0.0, np.zeros((2, parts[0].robot.dof))
    for part in parts:
        time = part.motion.time - part.motion.time[0]
        pieces = np.zeros(int(time[-1] / _PIECE_S) + 1)
        for k, (rows, as_is, turned) in enumerate(zip(part.rows, part.left, part.left_of(directions), strict=True)):
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
    is_sure = total > max(
        math.log(tried * ODDS), _DEVIATIONS * spread, _LEAST * count * parts[0].directions.others(directions)
    )
    ratios = np.sqrt(squares[1] / np.maximum(squares[0], np.finfo(float).tiny))
    return Turned(kind, joint, total, is_sure, float(ratios[squares[0] > 0].min(initial=1.0)))
