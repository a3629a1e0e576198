"""Joint, JointLimits, Drive, Mimic: how a link moves against its parent, and what moves it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
import numpy.typing as npt

from dynident.arrays import Array, frozen
from dynident.model.inertia import skew

#: Travel in m of a slide whose limits are not known, and the longest that counts.
TRAVEL, LONGEST_TRAVEL = 0.25, 1.0


@dataclass(frozen=True)
class JointLimits:
    """Limits of a joint; a bound that is not known is infinite.

    Attributes:
        lower: Lowest position, in rad or m.
        upper: Highest position, in rad or m.
        velocity: Largest speed, in rad/s or m/s.
        acceleration: Largest acceleration, in rad/s^2 or m/s^2.
        jerk: Largest jerk, in rad/s^3 or m/s^3.
        effort: Largest joint torque or force, in N m or N.
        effort_rate: Largest rate of the torque or force, in N m/s or N/s.
    """

    lower: float = -np.inf
    upper: float = np.inf
    velocity: float = np.inf
    acceleration: float = np.inf
    jerk: float = np.inf
    effort: float = np.inf
    effort_rate: float = np.inf

    def __post_init__(self) -> None:
        if not self.lower <= self.upper or self.lower == np.inf or self.upper == -np.inf:
            raise ValueError(f"the lower limit {self.lower:g} is above the upper limit {self.upper:g}")
        for name in ("velocity", "acceleration", "jerk", "effort", "effort_rate"):
            if not getattr(self, name) >= 0:
                raise ValueError(f"the {name} limit is {getattr(self, name):g}")


@dataclass(frozen=True)
class Drive:
    """What moves a joint.

    Attributes:
        gear_ratio: Turns of the motor per turn of the joint; negative for a reversing gear.
        rotor_inertia: Known inertia of the rotor at the motor, in kg m^2; its torque is compensated, not identified.
        gain: Joint torque per unit of motor current (16), in N m/A; None where no current is logged.
        bias: Known constant torque that something else than the drive gives (a spring, a counterweight, a controller
            that leaves weight out of its log), in N m or N: torque of the log + bias = torque of the bodies.
        gain_deviation: Relative standard deviation of the gain; 0 where none is stated.
    """

    gear_ratio: float = 1.0
    rotor_inertia: float = 0.0
    gain: float | None = None
    bias: float = 0.0
    gain_deviation: float = 0.0

    def __post_init__(self) -> None:
        if not (np.isfinite(self.gear_ratio) and self.gear_ratio != 0):
            raise ValueError(f"the gear ratio is {self.gear_ratio:g}")
        if not 0 <= self.rotor_inertia < np.inf:
            raise ValueError(f"the rotor inertia is {self.rotor_inertia:g}")
        if self.gain is not None and not (np.isfinite(self.gain) and self.gain != 0):
            raise ValueError(f"the gain is {self.gain:g}")
        if not np.isfinite(self.bias):
            raise ValueError(f"the bias is {self.bias:g}")
        if not 0 <= self.gain_deviation < 1:
            raise ValueError(f"the gain deviation is {self.gain_deviation:g}, a share of the gain from 0 to 1")

    @property
    def reflected_inertia(self) -> float:
        """Rotor inertia seen at the joint, gear_ratio^2 times the rotor's, in kg m^2."""
        return self.gear_ratio**2 * self.rotor_inertia


@dataclass(frozen=True)
class Mimic:
    """A joint that follows another one: q = multiplier * q[joint] + offset."""

    joint: str
    multiplier: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True)
class Joint:
    """A moving joint: places its link in the parent link, then turns or slides about ``axis`` of its own link frame.

    The link's pose in its parent is (rotation, translation) followed by the motion of the joint.

    Attributes:
        name: Name of the joint.
        kind: ``"revolute"`` (also continuous) or ``"prismatic"``.
        parent: Index of the parent link in ``Robot.links``; -1 is the base.
        rotation: Orientation of the link in its parent at q = 0, shape (3, 3).
        translation: Position of the link in its parent at q = 0, shape (3,), in m.
        axis: Unit axis in the link's own frame, shape (3,).
        limits: Limits of the joint.
        drive: What moves it.
        mimic: The joint that it follows, or None.
        damping: Viscous friction that the robot model states, in N m s/rad or N s/m; None where it states none.
        friction: Coulomb friction that the robot model states, in N m or N; None where it states none.
    """

    name: str
    kind: Literal["revolute", "prismatic"]
    parent: int
    rotation: Array
    translation: Array
    axis: Array
    limits: JointLimits = field(default_factory=JointLimits)
    drive: Drive = field(default_factory=Drive)
    mimic: Mimic | None = None
    damping: float | None = None
    friction: float | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "rotation", frozen(self.rotation, (3, 3), "rotation"))
        object.__setattr__(self, "translation", frozen(self.translation, (3,), "translation"))
        axis = np.array(self.axis, dtype=float)
        length = float(np.linalg.norm(axis))
        if not (np.isfinite(length) and length > 1e-9):
            raise ValueError(f"joint '{self.name}' has the axis {axis.tolist()}")
        unit = axis if abs(length - 1.0) < 1e-15 else axis / length  # a unit axis stays as it is, to the last bit
        object.__setattr__(self, "axis", frozen(unit, (3,), "axis"))

    @property
    def unit(self) -> str:
        """Unit of the joint's effort: ``"N m"`` or ``"N"``."""
        return "N m" if self.kind == "revolute" else "N"

    @property
    def speed_scale(self) -> float:
        """Speed that counts as 1 rad/s: 1 of a hinge, of a slide its travel a second, in m/s.

        A slide is built to cross its travel as a hinge turns a radian or so: a lift of 0.35 m, a finger of 0.03 m.
        """
        if self.kind == "revolute":
            return 1.0
        span = self.limits.upper - self.limits.lower
        return min(span, LONGEST_TRAVEL) if 0.0 < span < np.inf else TRAVEL


def rotation_about(axis: npt.ArrayLike, angle: float) -> Array:
    """Return the rotation by ``angle`` (rad) about a unit axis (Rodrigues' formula), shape (3, 3)."""
    cross = skew(axis)
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def joint_pose(joint: Joint, position: float) -> tuple[Array, Array]:
    """Return the pose (rotation, translation) of the joint's link in its parent at a position in rad or m."""
    if joint.kind == "prismatic":
        return joint.rotation, joint.translation + position * joint.rotation @ joint.axis
    return joint.rotation @ rotation_about(joint.axis, position), joint.translation
