"""The article's excitation: a finite Fourier series per joint."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from dynident.arrays import Array, frozen
from dynident.errors import BadOption
from dynident.experiment.preprocessing.fourier_fit import fourier_basis
from dynident.experiment.trajectories.base import Trajectory, times


@dataclass(frozen=True)
class FourierSeries(Trajectory):
    """Finite Fourier series of H harmonics per joint, equation (14); periodic, so it need not start at rest.

    q_i(t) = q_io + sum_k a_ik sin(k w t) + sum_k b_ik cos(k w t), with w = 2 pi / period and k = 1..H.

    Attributes:
        offset: q_io, shape (n,), in rad or m.
        sine: a_ik, shape (n, H), in rad or m.
        cosine: b_ik, shape (n, H), in rad or m.
        period: Period in s.

    Raises:
        BadOption: A number that is not finite, or a period that is not positive.
        ValueError: Shapes that do not fit each other.
    """

    offset: Array
    sine: Array
    cosine: Array
    period: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "offset", frozen(self.offset, (None,), "offset"))
        object.__setattr__(self, "sine", frozen(self.sine, (len(self.offset), None), "sine"))
        object.__setattr__(self, "cosine", frozen(self.cosine, self.sine.shape, "cosine"))
        object.__setattr__(self, "period", float(self.period))
        for name in ("offset", "sine", "cosine"):
            values = getattr(self, name)
            if not np.all(np.isfinite(values)):
                raise BadOption(name, float(values[~np.isfinite(values)][0]), "give finite numbers")
        if not 0 < self.period < np.inf:
            raise BadOption("period", self.period, "give the period in s, above 0")

    @classmethod
    def from_table(cls, rows: Sequence[npt.ArrayLike], period: float) -> FourierSeries:
        """Build from one row per joint: offset, a_1..a_H, b_1..b_H, the reading of (A.1) and (A.2) used here.

        Args:
            rows: n rows of 2 H + 1 numbers, in rad or m.
            period: Period in s.

        Raises:
            BadOption: No rows, rows of different lengths, or an even number of numbers in a row.
        """
        table = [np.asarray(row, dtype=np.float64) for row in rows]
        lengths = [row.size for row in table]
        if not table or lengths[0] % 2 == 0:
            raise BadOption("row 1", lengths[:1], "give an odd number of values: offset, a_1..a_H, b_1..b_H")
        for joint, length in enumerate(lengths, 1):
            if length != lengths[0]:
                raise BadOption(f"row {joint}", f"{length} values", f"give {lengths[0]} as in row 1")
        values = np.array(table)
        harmonics = lengths[0] // 2
        return cls(values[:, 0], values[:, 1 : 1 + harmonics], values[:, 1 + harmonics :], period)

    @property
    def table(self) -> Array:
        """One row per joint: offset, a_1..a_H, b_1..b_H, shape (n, 2 H + 1)."""
        return np.hstack([self.offset[:, None], self.sine, self.cosine])

    @property
    def harmonics(self) -> int:
        """Number of sine and cosine pairs, H."""
        return self.sine.shape[1]

    @property
    def periodic(self) -> bool:
        """A Fourier series repeats itself."""
        return True

    @property
    def joints(self) -> int:
        """Number of joints, n."""
        return len(self.offset)

    @property
    def duration(self) -> float:
        """One period, in s."""
        return self.period

    def evaluate(self, time: npt.ArrayLike) -> tuple[Array, Array, Array]:
        """Return q, dq and ddq at the times (N,) in s, each (N, n)."""
        columns = self.table.T
        position, velocity, acceleration = fourier_basis(times(time), self.period, self.harmonics)
        return position @ columns, velocity @ columns, acceleration @ columns

    def jerk(self, time: npt.ArrayLike) -> Array:
        """Return the third derivative at the times (N,) in s, shape (N, n)."""
        return self.derivative().evaluate(time)[2]

    def derivative(self) -> FourierSeries:
        """Return the series of the velocity: k w b_ik changes places with k w a_ik, and its sign."""
        pulsation = 2 * np.pi / self.period * np.arange(1, self.harmonics + 1)
        return FourierSeries(np.zeros(self.joints), -pulsation * self.cosine, pulsation * self.sine, self.period)
