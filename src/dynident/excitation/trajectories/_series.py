"""What the Fourier trajectories share: fields, the basis of equation (14), its range between samples, plain data."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from dynident.arrays import Array, frozen
from dynident.data.preprocessing.fourier_fit import fourier_basis
from dynident.errors import BadOption
from dynident.excitation.trajectories.base import Designable


@dataclass(frozen=True)
class HarmonicSeries(Designable):
    """A finite Fourier series of H harmonics per joint, equation (14); a kind says which coefficients it allows.

    Attributes:
        offset: q_io, shape (n,), in rad or m.
        sine: a_ik, shape (n, H), in rad or m.
        cosine: b_ik, shape (n, H), in rad or m.
        period: Period in s.

    Raises:
        BadOption: A number that is not finite, a period that is not positive, coefficients that are none of this kind.
        ValueError: Shapes that do not fit each other.
    """

    offset: Array
    sine: Array
    cosine: Array
    period: float

    def __post_init__(self) -> None:
        fields: dict[str, Any] = {"offset": frozen(self.offset, (None,), "offset")}
        fields["sine"] = frozen(self.sine, (len(fields["offset"]), None), "sine")
        fields["cosine"] = frozen(self.cosine, fields["sine"].shape, "cosine")
        for name, values in fields.items():
            if not np.all(np.isfinite(values)):
                raise BadOption(name, float(values[~np.isfinite(values)][0]), "give finite numbers")
        for name, value in {**fields, "period": checked_period(self.period)}.items():
            object.__setattr__(self, name, value)
        self.check()

    @abstractmethod
    def check(self) -> None:
        """Refuse coefficients that are none of this kind.

        Raises:
            BadOption: They are not.
        """

    @classmethod
    def from_table(cls, rows: Sequence[npt.ArrayLike], period: float) -> Self:
        """Build from one row per joint: offset, a_1..a_H, b_1..b_H, the reading of (A.1) and (A.2) used here.

        Args:
            rows: n rows of 2 H + 1 numbers, in rad or m.
            period: Period in s.

        Raises:
            BadOption: No rows, rows of different lengths, an even number of numbers in a row, or coefficients that are
                none of this kind.
        """
        return cls(*_split(rows), period)

    @staticmethod
    def basis(time: Array, period: float, count: int) -> Array:
        """Return 1, sin(k w t).., cos(k w t).. and their three derivatives, shape (4, N, C), C = 2 H + 1."""
        harmonics = count // 2
        q, dq, ddq = fourier_basis(time, period, harmonics)
        pulsation = 2 * np.pi / period * np.r_[0.0, np.tile(np.arange(1, harmonics + 1), 2)]
        return np.stack([q, dq, ddq, -(pulsation**2) * dq])

    @staticmethod
    def extremes(table: Array, period: float, samples: int) -> Array:
        """Return bounds on q, dq, ddq and jerk at every time, shape (2, 4, n): lowest, highest.

        A trigonometric polynomial of degree H is at most 1 / cos(pi H / N) times the largest of N even samples of a
        period (Ehlich and Zeller 1964); this is used about the middle between its highest and its lowest sample.

        Raises:
            BadOption: So few samples that they bound nothing.
        """
        harmonics = table.shape[1] // 2
        if samples <= 2 * harmonics:
            raise BadOption("samples", samples, f"give more than {2 * harmonics}")
        signals = HarmonicSeries.basis(np.arange(samples) * period / samples, period, table.shape[1]) @ table.T
        low, high = signals.min(axis=1), signals.max(axis=1)
        middle, half = 0.5 * (high + low), 0.5 * (high - low) / np.cos(np.pi * harmonics / samples)
        return np.stack([middle - half, middle + half])

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
    def detail(self) -> str:
        """Its number of harmonics."""
        return f"{self.harmonics} harmonics"

    def data(self) -> dict[str, Any]:
        """Return period, offset, sine and cosine."""
        numbers = {name: getattr(self, name).tolist() for name in ("offset", "sine", "cosine")}
        return {"period": self.period, **numbers}

    @classmethod
    def from_data(cls, data: Mapping[str, Any]) -> Self:
        """Build from period, offset, sine and cosine.

        Raises:
            BadOption: Numbers that are none of this kind.
            KeyError: One is missing.
            ValueError: Shapes that do not fit each other.
        """
        offset, sine, cosine = (np.array(data[name], float) for name in ("offset", "sine", "cosine"))
        return cls(offset, sine, cosine, data["period"])


def checked_period(period: float) -> float:
    """Return a period as a number.

    Raises:
        BadOption: It is not positive and finite.
    """
    if not 0 < float(period) < np.inf:
        raise BadOption("period", float(period), "give the period in s, above 0")
    return float(period)


def _split(rows: Sequence[npt.ArrayLike]) -> tuple[Array, Array, Array]:
    """Return offset (n,), sine (n, H) and cosine (n, H) from one row per joint: offset, a_1..a_H, b_1..b_H.

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
    return values[:, 0], values[:, 1 : 1 + harmonics], values[:, 1 + harmonics :]
