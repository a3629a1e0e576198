"""A periodic motion as it is driven: run-in from rest, whole periods, run-out to rest."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from dynident.arrays import Array
from dynident.errors import BadOption
from dynident.excitation.trajectories.base import Trajectory, times
from dynident.excitation.trajectories.quintic import Quintic


@dataclass(frozen=True)
class RestToRest(Trajectory):
    """Quintic run-in, whole periods, the run-in's mirror image as run-out; position to acceleration are continuous.

    Attributes:
        core: The periodic motion.
        run_in: Length of the run-in and of the run-out, in s; 0 for a motion that starts at rest.
        repeats: Number of periods.

    Raises:
        BadOption: A motion that is not periodic, a negative length, or fewer than one period.
    """

    core: Trajectory
    run_in: float
    repeats: int = 1

    def __post_init__(self) -> None:
        if not self.core.periodic:
            raise BadOption("core", type(self.core).__name__, "give a periodic motion")
        if not 0 <= self.run_in < np.inf:
            raise BadOption("run_in", self.run_in, "give seconds, 0 or more")
        if self.repeats < 1:
            raise BadOption("repeats", self.repeats, "give 1 or more")

    @property
    def duration(self) -> float:
        """Length from rest to rest, in s."""
        return self.repeats * self.core.duration + 2 * self.run_in

    @property
    def periodic(self) -> bool:
        """It ends elsewhere than it starts."""
        return False

    @property
    def joints(self) -> int:
        return self.core.joints

    def evaluate(self, time: npt.ArrayLike) -> tuple[Array, Array, Array]:
        """Return q, dq and ddq at the times (N,) in s, each (N, n); at rest before the start and after the end."""
        q, dq, ddq, _ = self._signals(time)
        return q, dq, ddq

    def jerk(self, time: npt.ArrayLike) -> Array:
        return self._signals(time)[3]

    @property
    def seams(self) -> tuple[float, ...]:
        """Times just before and just after the run-in joins the motion and the run-out leaves it."""
        if not self.run_in:
            return ()
        instant = 1e-9 * self.run_in
        joins = (self.run_in, self.duration - self.run_in)
        return tuple(moment + side for moment in joins for side in (-instant, instant))

    @cached_property
    def enter(self) -> Quintic:
        """The run-in; it takes time only where ``run_in`` is above 0."""
        return Quintic.from_rest(np.stack([signal[0] for signal in self.core.evaluate(0.0)]), self.run_in)

    @cached_property
    def leave(self) -> Quintic:
        """The run-out backwards in time."""
        q, dq, ddq = (signal[0] for signal in self.core.evaluate(self.core.duration))
        return Quintic.from_rest(np.stack([q, -dq, ddq]), self.run_in)

    def _signals(self, time: npt.ArrayLike) -> Array:
        """Return q, dq, ddq and jerk, shape (4, N, n)."""
        inside = np.clip(times(time), 0.0, self.duration)
        end = self.run_in + self.repeats * self.core.duration
        core = np.clip(inside, self.run_in, end) - self.run_in
        found = np.stack([*self.core.evaluate(core), self.core.jerk(core)])
        if self.run_in:
            early, late = inside < self.run_in, inside > end
            found[:, early] = [*self.enter.evaluate(inside[early]), self.enter.jerk(inside[early])]
            back = self.duration - inside[late]
            mirrored = np.stack([*self.leave.evaluate(back), self.leave.jerk(back)])
            found[:, late] = mirrored * np.array([1.0, -1.0, 1.0, -1.0])[:, None, None]
        return found
