"""What a trajectory is: positions of all joints with their derivatives as functions of time."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np
import numpy.typing as npt

from dynident.arrays import Array


class Trajectory(ABC):
    """A motion of n joints that can be evaluated at any time; time 0 is its start."""

    @property
    @abstractmethod
    def duration(self) -> float:
        """Length of one run (one period of a periodic motion), in s."""

    @property
    @abstractmethod
    def periodic(self) -> bool:
        """Whether the motion repeats itself after its duration."""

    @property
    @abstractmethod
    def joints(self) -> int:
        """Number of joints, n."""

    @abstractmethod
    def evaluate(self, time: npt.ArrayLike) -> tuple[Array, Array, Array]:
        """Return q, dq and ddq at the times (N,) in s, each (N, n), in rad or m and their derivatives."""

    @abstractmethod
    def jerk(self, time: npt.ArrayLike) -> Array:
        """Return the third derivative at the times (N,) in s, shape (N, n), in rad/s^3 or m/s^3."""


def times(time: npt.ArrayLike) -> Array:
    """Return times as an array (N,); a single number counts as one time.

    Raises:
        ValueError: More than one dimension.
    """
    array = np.atleast_1d(np.asarray(time, dtype=np.float64))
    if array.ndim != 1:
        raise ValueError(f"time has shape {array.shape}, expected (N,)")
    return array
