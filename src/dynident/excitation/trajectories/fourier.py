"""The article's excitation: a finite Fourier series per joint."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dynident.arrays import Array
from dynident.errors import BadOption
from dynident.excitation.trajectories._series import HarmonicSeries


@dataclass(frozen=True)
class FourierSeries(HarmonicSeries):
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

    def check(self) -> None:
        """Any coefficients are such a series."""

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
    def at_rest(self) -> bool:
        """It starts with the speed that its coefficients give it."""
        return False

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
