"""The commanded motion of a simulated robot: a trajectory with a run-in from rest before time 0."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dynident.arrays import Array
from dynident.errors import BadOption
from dynident.excitation.trajectories.base import Trajectory
from dynident.excitation.trajectories.quintic import Quintic

#: Length in s of the run-in at most; every step of it is in memory.
LONGEST_LEAD_IN = 1000.0


@dataclass(frozen=True)
class CommandedCourse:
    """A trajectory with its run-in before time 0.

    Attributes:
        trajectory: The motion from time 0 on.
        run_in: From rest to the start of the trajectory; None to begin on it.
        length: Length of the log, in s.
    """

    trajectory: Trajectory
    run_in: Quintic | None
    length: float

    def evaluate(self, time: Array) -> tuple[Array, Array, Array]:
        """Return q, dq and ddq at the times (N,), each (N, n)."""
        early = time < 0
        q, dq, ddq = self.trajectory.evaluate(np.where(early, 0.0, time))
        if self.run_in is not None and np.any(early):
            # The first control can be a fraction of a tick before the run-in starts: at rest.
            run_in = self.run_in.evaluate(np.maximum(time[early] + self.run_in.length, 0.0))
            q[early], dq[early], ddq[early] = run_in
        return q, dq, ddq


def course(trajectory: Trajectory, lead_in: float, duration: float | None, joints: int) -> CommandedCourse:
    """Return the commanded motion of a robot with so many joints.

    Args:
        trajectory: The motion.
        lead_in: Length of the run-in, in s; 0 for none.
        duration: Length of the log, in s; None for the trajectory's. Only periodic motions go on beyond theirs.
        joints: Number of joints.

    Raises:
        BadOption: Other joints, or lengths that cannot be.
    """
    if trajectory.joints != joints:
        raise BadOption("trajectory", f"for {trajectory.joints} joints", f"the robot has {joints}")
    if not 0 <= lead_in < np.inf:
        raise BadOption("lead_in", lead_in, "give seconds, 0 or more")
    if lead_in > LONGEST_LEAD_IN:
        raise BadOption("lead_in", lead_in, f"give {LONGEST_LEAD_IN:g} s or less")
    length = trajectory.duration if duration is None else duration
    if not 0 < length < np.inf:
        raise BadOption("duration", duration, "give seconds, above 0")
    if length > trajectory.duration * (1 + 1e-9) and not trajectory.periodic:
        raise BadOption("duration", duration, f"the trajectory ends after {trajectory.duration:g} s and has no period")
    start = np.array(trajectory.evaluate(0.0))[:, 0]
    return CommandedCourse(trajectory, Quintic.from_rest(start, lead_in) if lead_in else None, length)
