"""What a trajectory is: positions of all joints with their derivatives as functions of time."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any, Self

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

    @property
    def seams(self) -> tuple[float, ...]:
        """Times in s, just before and just after, at which the jerk jumps inside the motion."""
        return ()


class Designable(Trajectory):
    """A trajectory that excitation design can move: linear in a table of coefficients, one row a joint.

    q_i(t) = sum_c basis_c(t) table_ic. Constructed from its table, a part needs nothing else to be designed, written
    into a plan and read again. ``period`` is its length in s.
    """

    period: float

    @property
    @abstractmethod
    def table(self) -> Array:
        """Coefficients, shape (n, C), in rad or m."""

    @classmethod
    @abstractmethod
    def from_table(cls, rows: Sequence[npt.ArrayLike], period: float) -> Self:
        """Build from one row of C coefficients per joint.

        Raises:
            BadOption: Rows that are none of this kind, or a period that is not positive.
        """

    @staticmethod
    @abstractmethod
    def basis(time: Array, period: float, count: int) -> Array:
        """Return the basis of a table of ``count`` columns and its three derivatives, shape (4, N, C)."""

    @staticmethod
    @abstractmethod
    def free_map(harmonics: int) -> Array:
        """Return the map of the free numbers of a joint onto its row, shape (C, m); the first is the constant 1.

        Args:
            harmonics: Fineness: the number of waves in a period that the motion can follow, about.

        Raises:
            BadOption: A fineness that cannot be.
        """

    @staticmethod
    @abstractmethod
    def extremes(table: Array, period: float, samples: int) -> Array:
        """Return bounds that q, dq, ddq and jerk keep at every time, between samples too, shape (2, 4, n).

        Args:
            table: Coefficients of a motion that repeats, shape (n, C).
            period: Period in s.
            samples: Number of samples of a period to look at, for kinds that have no closed form.

        Returns:
            The lowest values, then the highest: the true ones, or no more than a little outside them.
        """

    @property
    @abstractmethod
    def at_rest(self) -> bool:
        """Whether it starts and ends at rest with zero acceleration, so that it needs no run-in."""

    def shifted(self, phase: float) -> Self:
        """Return a periodic motion that begins ``phase`` seconds later in its period; one that starts at rest stays."""
        return self

    @property
    @abstractmethod
    def detail(self) -> str:
        """How fine it is, in words, such as ``5 harmonics``."""

    @abstractmethod
    def data(self) -> dict[str, Any]:
        """Return its numbers as plain data for the plan file."""

    @classmethod
    @abstractmethod
    def from_data(cls, data: Mapping[str, Any]) -> Self:
        """Build from what :meth:`data` returned.

        Raises:
            BadOption: Numbers that are none of this kind.
            KeyError: A number is missing.
            ValueError: Shapes that do not fit each other.
        """

    @property
    def joints(self) -> int:
        return len(self.table)

    @property
    def duration(self) -> float:
        """One period, in s."""
        return self.period

    def evaluate(self, time: npt.ArrayLike) -> tuple[Array, Array, Array]:
        basis, table = self.basis(self._inside(times(time)), self.period, self.table.shape[1]), self.table.T
        return basis[0] @ table, basis[1] @ table, basis[2] @ table

    def jerk(self, time: npt.ArrayLike) -> Array:
        return self.basis(self._inside(times(time)), self.period, self.table.shape[1])[3] @ self.table.T

    def _inside(self, time: Array) -> Array:
        """Return the times at which the basis has the value of the motion at ``time``."""
        return time


def times(time: npt.ArrayLike) -> Array:
    """Return times as an array (N,); a single number counts as one time.

    Raises:
        ValueError: More than one dimension.
    """
    array = np.atleast_1d(np.asarray(time, dtype=np.float64))
    if array.ndim != 1:
        raise ValueError(f"time has shape {array.shape}, expected (N,)")
    return array
