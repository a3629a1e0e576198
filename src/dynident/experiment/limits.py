"""What a motion must keep: position, velocity, acceleration, jerk and torque of every joint, and the check of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dynident.arrays import Array, frozen
from dynident.errors import BadOption
from dynident.experiment.trajectories.base import Trajectory
from dynident.model.friction import Motion
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
}


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

    def __post_init__(self) -> None:
        count = len(self.joints)
        if len(self.revolute) != count:
            raise ValueError(f"{len(self.revolute)} kinds for {count} joints")
        for name in ("lower", "upper", "velocity", "acceleration", "jerk", "torque"):
            object.__setattr__(self, name, frozen(getattr(self, name), (count,), name))
        for i, joint in enumerate(self.joints):
            if np.isfinite(self.lower[i]) != np.isfinite(self.upper[i]) or not self.lower[i] < self.upper[i]:
                text = [float(self.lower[i]), float(self.upper[i])]
                step = "give two finite ends, the lower one first, or none (-inf, inf)"
                raise BadOption(f"position of {joint}", text, step)
            for name in ("velocity", "acceleration", "jerk", "torque"):
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
class LimitRow:
    """The worst of one quantity of one joint.

    Attributes:
        joint: Name of the joint.
        quantity: position, velocity, acceleration, jerk or torque.
        unit: Unit of value and limit.
        value: The value that uses its bound most; of the largest size where there is no bound.
        limit: Its bound, margins taken off; infinite where there is none.
        time: When, in s from the start of the check.
        used: Share of the bound that is used, 1 at the bound; a position counts from the middle of its range.
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

    Args:
        robot: The robot.
        margin: Share of each range (about its middle), speed, acceleration and jerk that is left unused.
        torque_margin: Share of each effort limit that is left unused: the nominal model is not the true one.

    Raises:
        BadOption: A margin outside 0..1, a joint with no range or speed of its own, or a sliding joint with no ends.
    """
    for name, value in (("margin", margin), ("torque_margin", torque_margin)):
        if not 0 <= value < 1:
            raise BadOption(name, value, "give a share from 0 to less than 1")
    limits = [joint.limits for joint in robot.active]
    for joint, limit in zip(robot.active, limits, strict=True):
        if not np.isfinite(limit.velocity):
            step = "state its speed limit in the robot description; without one the best motion is the fastest"
            raise BadOption(f"velocity of {joint.name}", limit.velocity, step)
        if joint.kind == "prismatic" and not (np.isfinite(limit.lower) and np.isfinite(limit.upper)):
            step = "state both ends in the robot description; a slide has some"
            raise BadOption(f"position of {joint.name}", [limit.lower, limit.upper], step)
    lower, upper = (np.array([getattr(limit, name) for limit in limits]) for name in ("lower", "upper"))
    spare = np.where(np.isfinite(upper - lower), 0.5 * margin * (upper - lower), 0.0)
    rest = {
        name: (1.0 - margin) * np.array([getattr(limit, name) for limit in limits])
        for name in ("velocity", "acceleration", "jerk")
    }
    torque = (1.0 - torque_margin) * np.array([limit.effort for limit in limits])
    kinds = tuple(joint.kind == "revolute" for joint in robot.active)
    return MotionLimits(robot.joint_names, kinds, lower + spare, upper - spare, torque=torque, **rest)


def check_limits(
    trajectory: Trajectory,
    limits: MotionLimits,
    samples: int,
    torque: Callable[[Motion], Array] | None = None,
) -> tuple[LimitRow, ...]:
    """Return the worst of every quantity of every joint over a whole motion.

    Args:
        trajectory: The motion.
        limits: What it must keep.
        samples: Number of samples, both ends included.
        torque: Torque (N, n) of a motion; None leaves torques out.

    Raises:
        BadOption: Another number of joints.
    """
    if trajectory.joints != len(limits.joints):
        raise BadOption("trajectory", f"for {trajectory.joints} joints", f"the limits are of {len(limits.joints)}")
    time = np.linspace(0.0, trajectory.duration, samples)
    q, dq, ddq = trajectory.evaluate(time)
    signals = {"position": q, "velocity": dq, "acceleration": ddq, "jerk": trajectory.jerk(time)}
    bounds = dict(zip(UNITS, limits.bounds(), strict=False))
    if torque is not None:
        signals["torque"], bounds["torque"] = torque(Motion(q, dq, ddq)), limits.torque
    rows = []
    for i, joint in enumerate(limits.joints):
        for name, signal in signals.items():
            distance = np.abs(signal[:, i] - (limits.centre[i] if name == "position" else 0.0))
            worst = int(np.argmax(distance))
            value, bound = float(signal[worst, i]), float(bounds[name][i])
            if name == "position" and np.isfinite(bound):
                shown = float(limits.upper[i] if value > limits.centre[i] else limits.lower[i])
            else:
                shown = bound
            used = float(distance[worst]) / bound if np.isfinite(bound) else 0.0
            rows.append(LimitRow(joint, name, limits.unit(name, i), value, shown, float(time[worst]), used))
    return tuple(rows)


def worst_row(rows: tuple[LimitRow, ...]) -> LimitRow:
    """Return the row that uses its bound most."""
    return max(rows, key=lambda row: row.used)
