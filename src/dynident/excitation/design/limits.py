"""What a motion must keep: position to jerk, torque and its rate of every joint, clearances, and the check of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from dynident.arrays import Array, frozen
from dynident.errors import BadOption, check_kind
from dynident.excitation.collision.tool_speed import ToolPoint
from dynident.excitation.design.distances import Distances, least_distances
from dynident.excitation.trajectories.base import Trajectory
from dynident.model.friction import Motion
from dynident.model.joint import Joint, JointLimits
from dynident.model.robot import Robot

#: By how much a bound may be passed in the check: rounding only.
TOLERANCE = 1e-9

#: What is checked, in this order, with the unit on a revolute and on a prismatic joint.
UNITS = {
    "position": ("rad", "m"),
    "velocity": ("rad/s", "m/s"),
    "acceleration": ("rad/s^2", "m/s^2"),
    "jerk": ("rad/s^3", "m/s^3"),
    "torque": ("N m", "N"),
    "torque rate": ("N m/s", "N/s"),
    "clearance": ("m", "m"),
    "tool speed": ("m/s", "m/s"),
}

#: Those that belong to no joint.
JOINTLESS = ("clearance", "tool speed")

#: The first four, in the order of the derivatives.
QUANTITIES: tuple[str, ...] = ("position", "velocity", "acceleration", "jerk")

#: A distance uses 1 + (required - distance) / this share of its bound, in m: 0 where there is this much to spare.
DISTANCE_SCALE = 0.1

#: Time in s over which the check takes the difference of the torque for its rate.
RATE_STEP = 1e-5


_LARGEST = ("velocity", "acceleration", "jerk", "torque", "torque_rate")


@dataclass(frozen=True)
class MotionLimits:
    """Bounds that a motion must keep, margins taken off already; infinite where there is none.

    Attributes:
        joints: Names of the n joints.
        revolute: Which joints turn, n of them; the others slide.
        lower: Lowest positions, shape (n,), in rad or m.
        upper: Highest positions, shape (n,), in rad or m; finite where ``lower`` is.
        velocity: Largest speeds, shape (n,).
        acceleration: Largest accelerations, shape (n,).
        jerk: Largest jerks, shape (n,).
        torque: Largest torques or forces, shape (n,), in N m or N.
        torque_rate: Largest rates of the torque without dry friction, shape (n,), in N m/s or N/s; one number for all.

    Raises:
        BadOption: Bounds that no motion keeps, or a range with one end.
        ValueError: Shapes that do not fit each other.
    """

    joints: tuple[str, ...]
    revolute: tuple[bool, ...]
    lower: Array
    upper: Array
    velocity: Array
    acceleration: Array
    jerk: Array
    torque: Array
    torque_rate: Array = field(default_factory=lambda: np.array(np.inf))

    def __post_init__(self) -> None:
        count = len(self.joints)
        if len(self.revolute) != count:
            raise ValueError(f"{len(self.revolute)} kinds for {count} joints")
        if np.ndim(self.torque_rate) == 0:
            object.__setattr__(self, "torque_rate", np.full(count, self.torque_rate))
        for name in ("lower", "upper", *_LARGEST):
            object.__setattr__(self, name, frozen(getattr(self, name), (count,), name))
        for i, joint in enumerate(self.joints):
            if np.isfinite(self.lower[i]) != np.isfinite(self.upper[i]) or not self.lower[i] < self.upper[i]:
                text = [float(self.lower[i]), float(self.upper[i])]
                step = "give two finite ends, the lower one first, or none (-inf, inf)"
                raise BadOption(f"position of {joint}", text, step)
            for name in _LARGEST:
                value = float(getattr(self, name)[i])
                if not value > 0:
                    raise BadOption(f"{name} of {joint}", value, "give a bound above 0")

    @property
    def centre(self) -> Array:
        """Middle of each position range, shape (n,); 0 where there is none."""
        finite = np.isfinite(self.lower)
        return np.where(finite, 0.5 * (np.where(finite, self.lower, 0.0) + np.where(finite, self.upper, 0.0)), 0.0)

    @property
    def reach(self) -> Array:
        """Half of each position range, shape (n,); infinite where there is none."""
        return np.where(np.isfinite(self.lower), 0.5 * (self.upper - self.lower), np.inf)

    def bounds(self) -> Array:
        """Return the largest distance from the centre, speed, acceleration and jerk, shape (4, n)."""
        return np.stack([self.reach, self.velocity, self.acceleration, self.jerk])

    def unit(self, quantity: str, joint: int) -> str:
        """Return the unit of a quantity of a joint."""
        return UNITS[quantity][0 if self.revolute[joint] else 1]


@dataclass(frozen=True)
class ToolLimit:
    """Largest speed of a tool point.

    Attributes:
        point: The point.
        speed: Its largest speed, in m/s.

    Raises:
        BadOption: A speed that is not positive.
    """

    point: ToolPoint
    speed: float

    def __post_init__(self) -> None:
        if not self.speed > 0:
            raise BadOption("tool speed", self.speed, "give a speed in m/s above 0")


@dataclass(frozen=True)
class LimitRow:
    """The worst of one quantity of one joint.

    Attributes:
        joint: Name of the joint, or of the pair of shapes, or ``tool``.
        quantity: One of the keys of :data:`UNITS`.
        unit: Unit of value and limit.
        value: The value that uses its bound most; of the largest size where there is no bound. A torque has its chance
            margin added, a clearance is what is certain between the samples too.
        limit: Its bound, margins taken off; infinite where there is none.
        time: When, in s from the start of the check.
        used: Share of the bound that is used, 1 at the bound; a position counts from the middle of its range, a
            clearance is 1 at the required distance and 0 from :data:`DISTANCE_SCALE` beyond it.
    """

    joint: str
    quantity: str
    unit: str
    value: float
    limit: float
    time: float
    used: float

    @property
    def kept(self) -> bool:
        """Whether the bound is kept."""
        return self.used <= 1.0 + TOLERANCE


def limits_of(robot: Robot, margin: float = 0.05, torque_margin: float = 0.2) -> MotionLimits:
    """Return the limits that a robot's description states, less a margin.

    A joint that follows another one (mimic) hands its range, speed, acceleration and jerk to its leader: with
    q_f = m q + o the leader's position stays within (lower_f - o) / m .. (upper_f - o) / m, its speed within v_f / |m|.
    The effort of a follower is no bound of its own: the leader's torque drives both.

    Args:
        robot: The robot.
        margin: Share of each range (about its middle), speed, acceleration and jerk that is left unused.
        torque_margin: Share of each effort limit that is left unused: the nominal model is not the true one. The rate
            of the torque is left as it is stated.

    Raises:
        BadOption: A margin outside 0..1, a joint without a speed limit or with a limit of 0, a sliding joint with no
            ends, or a follower that leaves its leader no range.
    """
    check_kind("robot", robot, Robot, 'di.limits_of(di.robot_of("arm.urdf"))')
    for name, value in (("margin", margin), ("torque_margin", torque_margin)):
        if not 0 <= value < 1:
            raise BadOption(name, value, "give a share from 0 to less than 1")
    limits = [_with_followers(robot, joint) for joint in robot.active]
    for joint, limit in zip(robot.active, limits, strict=True):
        _check_stated(joint, limit)
    lower, upper = (np.array([getattr(limit, name) for limit in limits]) for name in ("lower", "upper"))
    width = np.where(np.isfinite(lower) & np.isfinite(upper), upper - lower, 0.0)
    spare = 0.5 * margin * width
    rest = {
        name: (1.0 - margin) * np.array([getattr(limit, name) for limit in limits])
        for name in ("velocity", "acceleration", "jerk")
    }
    torque = (1.0 - torque_margin) * np.array([limit.effort for limit in limits])
    rate = np.array([limit.effort_rate for limit in limits])
    kinds = tuple(joint.kind == "revolute" for joint in robot.active)
    ends = (lower + spare, upper - spare)
    return MotionLimits(robot.joint_names, kinds, *ends, torque=torque, torque_rate=rate, **rest)


def _check_stated(joint: Joint, limit: JointLimits) -> None:
    """Refuse limits of a description that leave no motion, or no slowest one."""
    still = f"or lock the joint in the case file (locked: {{{joint.name}: VALUE}})"
    if not np.isfinite(limit.velocity):
        case = "in a case file (robot: FILE, limits: {velocity: [...]}, one a joint)"
        step = f"state its speed limit {case}, or in a URDF or SDF (MJCF has no place for it)"
        raise BadOption(f"velocity of {joint.name}", limit.velocity, step)
    if joint.kind == "prismatic" and not (np.isfinite(limit.lower) and np.isfinite(limit.upper)):
        step = "state both ends in the robot model; a slide has some"
        raise BadOption(f"position of {joint.name}", [limit.lower, limit.upper], step)
    if limit.lower == limit.upper:
        step = f"the robot model leaves it no range: state one, {still}"
        raise BadOption(f"position of {joint.name}", [limit.lower, limit.upper], step)
    if limit.velocity == 0.0:
        step = f"the robot model allows no speed: state its speed limit there, {still}"
        raise BadOption(f"velocity of {joint.name}", limit.velocity, step)
    for name in ("acceleration", "jerk", "effort", "effort_rate"):
        if getattr(limit, name) == 0.0:
            step = (
                f"state it above 0, in the robot model or in a case file (limits: {{{name}: ...}}), or leave it out of "
                "the robot model: then it is not checked"
            )
            raise BadOption(f"{name} of {joint.name}", 0.0, step)


def _with_followers(robot: Robot, leader: Joint) -> JointLimits:
    """Return the limits of a joint, narrowed by those of the joints that follow it."""
    found = leader.limits
    for joint in robot.joints:
        rule, own = joint.mimic, joint.limits
        if rule is None or rule.joint != leader.name or rule.multiplier == 0.0:
            continue
        size = abs(rule.multiplier)
        ends = sorted((end - rule.offset) / rule.multiplier for end in (own.lower, own.upper))
        lower, upper = max(found.lower, ends[0]), min(found.upper, ends[1])
        if not lower < upper:
            step = f"'{joint.name}' follows with {rule.multiplier:g} and {rule.offset:g} and leaves it no range"
            raise BadOption(f"position of {leader.name}", [found.lower, found.upper], f"{step}; correct the limits")
        narrowed = {
            name: min(getattr(found, name), getattr(own, name) / size) for name in ("velocity", "acceleration", "jerk")
        }
        found = replace(found, lower=lower, upper=upper, **narrowed)
    return found


def check_limits(
    trajectory: Trajectory,
    limits: MotionLimits,
    samples: int,
    torque: Callable[[Motion], Array] | None = None,
    *,
    spread: Callable[[Motion], Array] | None = None,
    smooth_torque: Callable[[Motion], Array] | None = None,
    distances: Distances | None = None,
    tool: ToolLimit | None = None,
) -> tuple[LimitRow, ...]:
    """Return the worst of every quantity of every joint, and of every clearance, over a whole motion.

    Args:
        trajectory: The motion.
        limits: What it must keep.
        samples: Number of even samples, both ends included; the seams of the motion are looked at besides.
        torque: Torque (N, n) of a motion; None leaves torques out.
        spread: Chance margin (N, n) that is added to the size of the torque; None for none.
        smooth_torque: Torque (N, n) whose rate is checked, by differences over 0.01 ms; None leaves it out.
        distances: Pairs of shapes to be kept apart, between the samples too; None leaves them out.
        tool: Largest speed of the tool point; None leaves it out.

    Raises:
        BadOption: Another number of joints.
    """
    if trajectory.joints != len(limits.joints):
        raise BadOption("trajectory", f"for {trajectory.joints} joints", f"the limits are of {len(limits.joints)}")
    time = np.unique(np.r_[np.linspace(0.0, trajectory.duration, samples), trajectory.seams])
    q, dq, ddq = trajectory.evaluate(time)
    jerk = trajectory.jerk(time)
    signals: dict[str, Array] = dict(zip(QUANTITIES, (q, dq, ddq, jerk), strict=True))
    bounds: dict[str, Array] = dict(zip(QUANTITIES, limits.bounds(), strict=True))
    if torque is not None:
        motion = Motion(q, dq, ddq)
        found = torque(motion)
        signals["torque"] = found if spread is None else found + np.where(found < 0, -1.0, 1.0) * spread(motion)
        bounds["torque"] = limits.torque
    if smooth_torque is not None:
        signals["torque rate"], bounds["torque rate"] = _rate(trajectory, time, smooth_torque), limits.torque_rate
    rows = [
        _row(limits, i, name, signal[:, i], float(bounds[name][i]), time)
        for i in range(len(limits.joints))
        for name, signal in signals.items()
    ]
    if distances is not None:
        # The largest of the samples, and what the jerk adds until the next one.
        most = np.abs(ddq).max(axis=0) + 0.5 * np.diff(time).max() * np.abs(jerk).max(axis=0)
        rows += _clearances(distances, *least_distances(distances, lambda t: trajectory.evaluate(t)[:2], time, most))
    if tool is not None:
        speed = tool.point.speed(q, dq)
        worst = int(np.argmax(speed))
        value = float(speed[worst])
        used = value / tool.speed
        rows.append(LimitRow("tool", "tool speed", "m/s", value, float(tool.speed), float(time[worst]), used))
    return tuple(rows)


def _row(limits: MotionLimits, joint: int, name: str, signal: Array, bound: float, time: Array) -> LimitRow:
    """Return the worst of one quantity of one joint from its samples (N,)."""
    centre = float(limits.centre[joint]) if name == "position" else 0.0
    distance = np.abs(signal - centre)
    worst = int(np.argmax(distance))
    value, shown = float(signal[worst]), bound
    if name == "position" and np.isfinite(bound):
        shown = float(limits.upper[joint] if value > centre else limits.lower[joint])
    used = float(distance[worst]) / bound if np.isfinite(bound) else 0.0
    return LimitRow(limits.joints[joint], name, limits.unit(name, joint), value, shown, float(time[worst]), used)


def _rate(trajectory: Trajectory, time: Array, torque: Callable[[Motion], Array]) -> Array:
    """Return the rate of a torque, shape (N, n): the larger of those before and after each sample, for it may jump."""
    moments = (np.maximum(time - RATE_STEP, 0.0), time, np.minimum(time + RATE_STEP, trajectory.duration))
    early, now, late = (torque(Motion(*trajectory.evaluate(moment))) for moment in moments)
    before, after = (now - early) / RATE_STEP, (late - now) / RATE_STEP
    return np.where(np.abs(before) > np.abs(after), before, after)


def _clearances(distances: Distances, certain: Array, when: Array) -> list[LimitRow]:
    used = np.maximum(0.0, 1.0 + (distances.required - certain) / DISTANCE_SCALE)
    return [
        LimitRow(name, "clearance", "m", float(value), float(required), float(moment), float(share))
        for name, value, required, moment, share in zip(
            distances.names, certain, distances.required, when, used, strict=True
        )
    ]


def worst_row(rows: tuple[LimitRow, ...]) -> LimitRow:
    """Return the row that uses its bound most."""
    return max(rows, key=lambda row: row.used)
