"""The article's excitation: a finite Fourier series per joint."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from dynident.arrays import Array
from dynident.errors import BadOption
from dynident.experiment.trajectories import _series
from dynident.experiment.trajectories.base import Designable


@dataclass(frozen=True)
class FourierSeries(Designable):
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

    basis = staticmethod(_series.series_basis)
    extremes = staticmethod(_series.series_extremes)

    def __post_init__(self) -> None:
        for name, value in _series.series_fields(self.offset, self.sine, self.cosine, self.period).items():
            object.__setattr__(self, name, value)

    @classmethod
    def from_table(cls, rows: Sequence[npt.ArrayLike], period: float) -> FourierSeries:
        """Build from one row per joint: offset, a_1..a_H, b_1..b_H, the reading of (A.1) and (A.2) used here.

        Args:
            rows: n rows of 2 H + 1 numbers, in rad or m.
            period: Period in s.

        Raises:
            BadOption: No rows, rows of different lengths, or an even number of numbers in a row.
        """
        return cls(*_series.split_table(rows), period)

    @staticmethod
    def free_map(harmonics: int) -> Array:
        """Return the map of the free numbers: they are the coefficients themselves, shape (2 H + 1, 2 H + 1).

        Raises:
            BadOption: No harmonic.
        """
        if harmonics < 1:
            raise BadOption("harmonics", harmonics, "give 1 or more")
        return np.eye(2 * harmonics + 1)

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
    def at_rest(self) -> bool:
        """It starts with the speed that its coefficients give it."""
        return False

    @property
    def detail(self) -> str:
        """Its number of harmonics."""
        return f"{self.harmonics} harmonics"

    def data(self) -> dict[str, Any]:
        """Return period, offset, sine and cosine."""
        return _series.series_data(self.offset, self.sine, self.cosine, self.period)

    @classmethod
    def from_data(cls, data: Mapping[str, Any]) -> FourierSeries:
        """Build from period, offset, sine and cosine."""
        return cls(**_series.series_arguments(data))

    def shifted(self, phase: float) -> FourierSeries:
        """Return the series that begins ``phase`` seconds later in its period: q(t + phase)."""
        angle = 2 * np.pi / self.period * phase * np.arange(1, self.harmonics + 1)
        cosine, sine = np.cos(angle), np.sin(angle)
        a, b = self.sine, self.cosine
        return FourierSeries(self.offset, a * cosine - b * sine, a * sine + b * cosine, self.period)

    def derivative(self) -> FourierSeries:
        """Return the series of the velocity: k w b_ik changes places with k w a_ik, and its sign."""
        pulsation = 2 * np.pi / self.period * np.arange(1, self.harmonics + 1)
        return FourierSeries(np.zeros(self.joints), -pulsation * self.cosine, pulsation * self.sine, self.period)
