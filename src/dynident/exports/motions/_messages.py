"""What trajectory_msgs/JointTrajectory holds: names, points, times; the same for YAML and for bags."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dynident.arrays import Array
from dynident.errors import BadOption
from dynident.exports.motions._motion import DrivenMotion

#: Nanoseconds in a second.
NANO = 1_000_000_000


@dataclass(frozen=True)
class Points:
    """The points of one trajectory.

    Attributes:
        nanoseconds: Times from its start, whole numbers that rise.
        signals: q, dq, ddq, shape (3, M, n).
    """

    nanoseconds: tuple[int, ...]
    signals: Array

    @property
    def time(self) -> Array:
        """Times in s, shape (M,)."""
        return np.array(self.nanoseconds) / NANO


def points_of(time: Array, signals: Array, most: int) -> Points:
    """Return points of samples.

    Raises:
        BadOption: More than ``most``.
    """
    if len(time) > most:
        step = f"the motion has {len(time)} points; lower --rate, fewer --repeats, or raise most_points"
        raise BadOption("most_points", most, step)
    return Points(tuple(round(t * NANO) for t in time.tolist()), signals)


def approach_points(motion: DrivenMotion, most: int) -> Points | None:
    """Return the approach: samples from a stated posture, or one point that is reached late enough from anywhere.

    The controller goes from where it is to that one point by its own interpolation; the time is that of the longest way
    within the limits at a tenth of the speed limits. None where the robot stands at the first posture.

    Raises:
        BadOption: Too many points, or no posture stated and a joint without ends.
    """
    way = motion.approach()
    if way is not None:
        return points_of(*way, most)
    if motion.at_start:
        return None
    signals = np.zeros((3, 1, len(motion.joints)))
    signals[0, 0] = motion.first
    return Points((int(np.ceil(motion.approach_length())) * NANO,), signals)
