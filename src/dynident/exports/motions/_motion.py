"""A plan as it is driven: at a share of its speed, from a posture, with the slow approach to its first posture."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from dynident.arrays import Array, frozen
from dynident.errors import BadOption
from dynident.excitation.design.plan import MAX_ROWS, Plan, plan_data, sampled
from dynident.excitation.trajectories.base import Trajectory, times
from dynident.excitation.trajectories.quintic import Quintic

#: Share of every limit that an approach uses, and its shortest length in s.
APPROACH_SHARE, APPROACH_SHORTEST = 0.1, 2.0

#: Speed of an approach, in rad/s or m/s, of a joint whose speed has no limit.
APPROACH_SLOW = 0.1

#: Largest v T / d, a T^2 / d and j T^3 / d of a quintic over the distance d from rest to rest in the time T.
_PEAKS = (15 / 8, 10 / np.sqrt(3), 60.0)


@dataclass(frozen=True)
class Slowed(Trajectory):
    """A motion on the same path at a share s of its speed: q(s t), dq scaled by s, ddq by s^2, jerk by s^3.

    Attributes:
        core: The motion.
        speed: The share s, 0.1 to 1.
    """

    core: Trajectory
    speed: float

    @property
    def duration(self) -> float:
        """Length in s."""
        return self.core.duration / self.speed

    @property
    def periodic(self) -> bool:
        """As the motion."""
        return self.core.periodic

    @property
    def joints(self) -> int:
        return self.core.joints

    def evaluate(self, time: npt.ArrayLike) -> tuple[Array, Array, Array]:
        q, dq, ddq = self.core.evaluate(times(time) * self.speed)
        return q, dq * self.speed, ddq * self.speed**2

    def jerk(self, time: npt.ArrayLike) -> Array:
        return self.core.jerk(times(time) * self.speed) * self.speed**3


@dataclass(frozen=True)
class Playback:
    """How a plan is to be driven.

    Attributes:
        rate: Samples a second; None takes that of the target.
        repeats: Number of periods.
        speed: Per cent of the designed speed, 10 to 100; the path stays.
        from_posture: Where the robot stands, n values in rad or m, or ``"start"`` for the first posture of the plan;
            None where it is not known.
    """

    rate: float | None = None
    repeats: int = 1
    speed: float = 100.0
    from_posture: npt.ArrayLike | None = None


@dataclass(frozen=True)
class DrivenMotion:
    """A plan from rest to rest as an exporter writes it.

    Attributes:
        plan: The plan.
        rate: Samples a second; None where the target takes thinned points.
        repeats: Number of periods.
        speed: Share of the designed speed, 0.1 to 1.
        posture: Where the robot stands before, shape (n,) in rad or m; None where it is not known.
        at_start: Whether the robot stands at the first posture already.

    Raises:
        BadOption: A rate, a number of periods or a speed that cannot be, or a posture outside the plan's limits.
    """

    plan: Plan
    rate: float | None = None
    repeats: int = 1
    speed: float = 1.0
    posture: Array | None = None
    at_start: bool = False

    def __post_init__(self) -> None:
        if not 0.1 <= self.speed <= 1.0:
            raise BadOption("speed", 100 * self.speed, "give 10 to 100 per cent; faster than the design is not checked")
        if self.posture is not None:
            object.__setattr__(self, "posture", self._inside(self.posture))
        if self.rate is not None and not (0 < self.rate < np.inf and self.motion.duration * self.rate < MAX_ROWS):
            raise BadOption("rate", self.rate, f"give samples a second, above 0, for less than {MAX_ROWS:,} rows")

    def _inside(self, posture: npt.ArrayLike) -> Array:
        given = np.asarray(posture, dtype=np.float64)
        limits = self.plan.limits
        if given.shape != (len(self.joints),) or not np.all(np.isfinite(given)):
            step = f"give {len(self.joints)} finite positions, one for each joint, or 'start'"
            raise BadOption("from_posture", given.tolist(), step)
        for joint, value, lower, upper in zip(self.joints, given, limits.lower, limits.upper, strict=True):
            if not lower <= value <= upper:
                step = f"{joint} may be {lower:.6g} to {upper:.6g}, the plan's limits; bring the robot there first"
                raise BadOption("from_posture", given.tolist(), step)
        return frozen(given)

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints."""
        return self.plan.joints

    @property
    def revolute(self) -> tuple[bool, ...]:
        """Which joints turn."""
        return self.plan.limits.revolute

    @cached_property
    def motion(self) -> Slowed:
        """The motion from rest to rest."""
        return Slowed(self.plan.motion(self.repeats), self.speed)

    @property
    def first(self) -> Array:
        """The first posture, shape (n,)."""
        return self.motion.evaluate(0.0)[0][0]

    def samples(self) -> tuple[Array, Array]:
        """Return the times (N,) in s from 0 and q, dq, ddq (3, N, n); the first and the last row are at rest."""
        assert self.rate is not None
        time, q, dq, ddq = sampled(self.plan, self.rate / self.speed, self.repeats)
        return np.arange(len(time)) / self.rate, at_rest(np.stack([q, dq * self.speed, ddq * self.speed**2]))

    def approach(self) -> tuple[Array, Array] | None:
        """Return times (N,) and q, dq, ddq (3, N, n) of the way to the first posture; None where none is known."""
        if self.posture is None or self.rate is None:
            return None
        steps = int(np.ceil(self.approach_length(self.first - self.posture) * self.rate - 1e-9))
        rest = np.zeros((2, len(self.joints)))
        way = Quintic(np.vstack([self.posture, rest]), np.vstack([self.first, rest]), steps / self.rate)
        time = np.arange(steps + 1) / self.rate
        return time, at_rest(np.stack(way.evaluate(time)))

    def approach_length(self, distance: Array | None = None) -> float:
        """Return the time in s for a quintic over a distance (n,) at a tenth of every limit; None: the whole range.

        Raises:
            BadOption: No distance, and a joint without ends.
        """
        limits = self.plan.limits
        if distance is None:
            distance = limits.upper - limits.lower
            for joint, free in zip(self.joints, ~np.isfinite(distance), strict=True):
                if free:
                    step = f"state where the robot stands: {joint} has no ends, so the longest way is not known"
                    raise BadOption("from_posture", None, step)
        speed = np.where(np.isfinite(limits.velocity), APPROACH_SHARE * limits.velocity, APPROACH_SLOW)
        bounds = (speed, APPROACH_SHARE * limits.acceleration, APPROACH_SHARE * limits.jerk)
        size = np.abs(distance)
        needed = [
            float(np.max((peak * size / bound) ** (1 / order)))
            for order, (peak, bound) in enumerate(zip(_PEAKS, bounds, strict=True), start=1)
        ]
        return max(APPROACH_SHORTEST, *needed)

    @cached_property
    def plan_sha256(self) -> str:
        """SHA-256 of the plan's file as ``write_plan`` writes it."""
        text = json.dumps(plan_data(self.plan), indent=1, allow_nan=False) + "\n"
        return hashlib.sha256(text.encode()).hexdigest()


def at_rest(signals: Array) -> Array:
    """Return q, dq, ddq (3, N, n) with speed and acceleration of both ends exactly 0 where they are but for rounding.

    What is not at rest stays as it is, and the check of the export refuses it.
    """
    ends = signals[1:, [0, -1]]
    small = 1e-9 * np.maximum(1.0, np.abs(signals[1:]).max(axis=1, keepdims=True))
    signals[1:, [0, -1]] = np.where(np.abs(ends) <= small, 0.0, ends)
    return signals
