"""Motions that are linear in free numbers: what the search moves, and how it becomes a trajectory."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from dynident.arrays import Array, frozen
from dynident.errors import BadOption, UnknownChoice
from dynident.experiment.preprocessing.fourier_fit import fourier_basis
from dynident.experiment.trajectories.fourier import FourierSeries
from dynident.experiment.trajectories.rest_fourier import RestFourier, rest_map

Kind = Literal["fourier", "rest_fourier"]

_KINDS = {"fourier": FourierSeries, "rest_fourier": RestFourier}


@dataclass(frozen=True)
class Parametrisation:
    """q_i(t) = sum_m Phi_m(t) x_im: a Fourier series through a linear map of its free numbers; Phi_1 is the constant 1.

    Attributes:
        kind: Name of the trajectory.
        period: Period in s.
        harmonics: Number of sine and cosine pairs, H.
        map: Free numbers of a joint to offset, a_1..a_H, b_1..b_H, shape (2 H + 1, m).
    """

    kind: Kind
    period: float
    harmonics: int
    map: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "map", frozen(self.map, (2 * self.harmonics + 1, None), "map"))

    @property
    def count(self) -> int:
        """Free numbers of one joint, m."""
        return self.map.shape[1]

    def basis(self, time: Array) -> Array:
        """Return Phi and its three derivatives at the times (N,), shape (4, N, m)."""
        q, dq, ddq = fourier_basis(time, self.period, self.harmonics)
        pulsation = 2 * np.pi / self.period * np.r_[0.0, np.tile(np.arange(1, self.harmonics + 1), 2)]
        return np.stack([q, dq, ddq, -(pulsation**2) * dq]) @ self.map

    def trajectory(self, free: Array) -> FourierSeries | RestFourier:
        """Return the trajectory of the free numbers (n, m)."""
        table = free @ self.map.T
        count = 1 + self.harmonics
        return _KINDS[self.kind](table[:, 0], table[:, 1:count], table[:, count:], self.period)


def parametrise(kind: str, period: float, harmonics: int) -> Parametrisation:
    """Return the parametrisation of a kind of trajectory.

    Args:
        kind: ``rest_fourier`` (starts and ends at rest) or ``fourier`` (14).
        period: Period in s.
        harmonics: Number of sine and cosine pairs.

    Raises:
        UnknownChoice: Another kind.
        BadOption: A period or a number of harmonics that cannot be.
    """
    if not 0 < period < np.inf:
        raise BadOption("period", period, "give the period in s, above 0")
    if kind == "rest_fourier":
        return Parametrisation(kind, float(period), harmonics, rest_map(harmonics))
    if kind == "fourier":
        if harmonics < 1:
            raise BadOption("harmonics", harmonics, "give 1 or more")
        return Parametrisation(kind, float(period), harmonics, np.eye(2 * harmonics + 1))
    raise UnknownChoice("trajectory to design", kind, tuple(_KINDS))


def of_table(kind: str, table: Array, period: float) -> FourierSeries | RestFourier:
    """Return a trajectory from its rows: offset, a_1..a_H, b_1..b_H per joint, shape (n, 2 H + 1).

    Raises:
        UnknownChoice: Another kind.
        BadOption: Rows of an even length, or coefficients the kind does not have.
    """
    if kind not in _KINDS:
        raise UnknownChoice("trajectory", kind, tuple(_KINDS))
    plain = FourierSeries.from_table(list(table), period)
    return _KINDS[kind](plain.offset, plain.sine, plain.cosine, period)


def kind_of(trajectory: FourierSeries | RestFourier) -> Kind:
    """Return the name of a trajectory's kind."""
    return "rest_fourier" if isinstance(trajectory, RestFourier) else "fourier"
