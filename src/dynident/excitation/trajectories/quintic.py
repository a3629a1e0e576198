"""A quintic between two states: runs from rest into a motion, and out of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from dynident.arrays import Array, frozen
from dynident.errors import BadOption
from dynident.excitation.trajectories.base import Trajectory, times

#: Coefficients of the powers of s = t / duration by the end conditions q, q', q'' at s = 0 and at s = 1.
_HERMITE = np.linalg.inv(
    np.array(
        [
            [1, 0, 0, 0, 0, 0],
            [0, 1, 0, 0, 0, 0],
            [0, 0, 2, 0, 0, 0],
            [1, 1, 1, 1, 1, 1],
            [0, 1, 2, 3, 4, 5],
            [0, 0, 2, 6, 12, 20],
        ],
        dtype=float,
    )
)


@dataclass(frozen=True)
class Quintic(Trajectory):
    """The quintic with given position, velocity and acceleration at both ends; outside it stays on the polynomial.

    Attributes:
        start: q, dq, ddq at time 0, shape (3, n), in rad or m and derivatives.
        end: q, dq, ddq at the end, shape (3, n).
        length: Time from start to end, in s.

    Raises:
        BadOption: A length that is not positive.
        ValueError: Shapes that do not fit each other.
    """

    start: Array
    end: Array
    length: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "start", frozen(self.start, (3, None), "start"))
        object.__setattr__(self, "end", frozen(self.end, self.start.shape, "end"))
        object.__setattr__(self, "length", float(self.length))
        if not 0 < self.length < np.inf:
            raise BadOption("length", self.length, "give seconds, above 0")

    @classmethod
    def from_rest(cls, end: npt.ArrayLike, length: float) -> Quintic:
        """Return the run-in from rest to the state q, dq, ddq (3, n) that starts where the way is shortest.

        The velocity is then the cubic from (0, 0) to (dq, ddq), so that a joint never swings back to gain speed.
        """
        q, dq, ddq = np.asarray(end, dtype=np.float64)
        start = np.zeros((3, q.size))
        start[0] = q - dq * length / 2 + ddq * length**2 / 12
        return cls(start, np.stack([q, dq, ddq]), length)

    @property
    def periodic(self) -> bool:
        """A quintic does not repeat itself."""
        return False

    @property
    def joints(self) -> int:
        return self.start.shape[1]

    @property
    def duration(self) -> float:
        """Time from start to end, in s."""
        return self.length

    def evaluate(self, time: npt.ArrayLike) -> tuple[Array, Array, Array]:
        q, dq, ddq = (self._power(time, order) for order in range(3))
        return q, dq, ddq

    def jerk(self, time: npt.ArrayLike) -> Array:
        return self._power(time, 3)

    def _power(self, time: npt.ArrayLike, order: int) -> Array:
        scale = self.length ** np.arange(3)[:, None]
        coefficients = _HERMITE @ np.vstack([self.start * scale, self.end * scale])
        for _ in range(order):
            coefficients = coefficients[1:] * np.arange(1, len(coefficients))[:, None] / self.length
        return np.vander(times(time) / self.length, len(coefficients), increasing=True) @ coefficients
