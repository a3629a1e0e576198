"""Motions that are linear in free numbers: what the search moves, and how it becomes a trajectory."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dynident.arrays import Array, frozen
from dynident.errors import BadOption, UnknownChoice
from dynident.excitation.trajectories import TRAJECTORIES
from dynident.excitation.trajectories.base import Designable


@dataclass(frozen=True)
class Parametrisation:
    """q_i(t) = sum_m Phi_m(t) x_im: a designable trajectory through a linear map of its free numbers; Phi_1 is 1.

    The first free number of a joint is thus its posture; the rest are amplitudes about it.

    Attributes:
        kind: Name of the trajectory.
        period: Period in s.
        harmonics: Fineness, H: sine and cosine pairs, or what is comparable (see the trajectory's ``free_map``).
        map: Free numbers of a joint to its row of the trajectory's table, shape (C, m).
    """

    kind: str
    period: float
    harmonics: int
    map: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "map", frozen(self.map, (None, None), "map"))

    @property
    def part(self) -> type[Designable]:
        """The class of the trajectory."""
        return designable(self.kind)

    @property
    def count(self) -> int:
        """Free numbers of one joint, m."""
        return self.map.shape[1]

    def basis(self, time: Array) -> Array:
        """Return Phi and its three derivatives at the times (N,) of 0..period, shape (4, N, m)."""
        return self.part.basis(time, self.period, len(self.map)) @ self.map

    def trajectory(self, free: Array) -> Designable:
        """Return the trajectory of the free numbers (n, m)."""
        return self.part.from_table(list(free @ self.map.T), self.period)

    def extremes(self, free: Array, samples: int) -> Array:
        """Return bounds on q, dq, ddq and jerk of the free numbers (n, m) at every time, shape (2, 4, n)."""
        return self.part.extremes(free @ self.map.T, self.period, samples)


def kinds() -> tuple[str, ...]:
    """Return the names of the trajectories that can be designed, sorted."""
    return tuple(name for name in TRAJECTORIES.names() if issubclass(TRAJECTORIES.get(name), Designable))


def designable(kind: str) -> type[Designable]:
    """Return the class of a trajectory that can be designed.

    Raises:
        UnknownChoice: There is none of this name.
    """
    part = TRAJECTORIES.get(kind) if kind in TRAJECTORIES.names() else None
    if part is None or not issubclass(part, Designable):
        raise UnknownChoice("trajectory to design", kind, kinds())
    return part


def parametrise(kind: str, period: float, harmonics: int) -> Parametrisation:
    """Return the parametrisation of a kind of trajectory.

    Args:
        kind: ``rest_fourier`` or ``bspline`` (start and end at rest), ``fourier`` (14), or one of your own.
        period: Period in s.
        harmonics: Number of sine and cosine pairs, H; a ``bspline`` gets as many free numbers as a ``rest_fourier``,
            2 H - 1 a joint: 2 H - 1 pieces of equal length.

    Raises:
        UnknownChoice: Another kind.
        BadOption: A period or a number of harmonics that cannot be.
    """
    if not 0 < period < np.inf:
        raise BadOption("period", period, "give the period in s, above 0")
    return Parametrisation(kind, float(period), harmonics, designable(kind).free_map(harmonics))


def kind_of(trajectory: Designable) -> str:
    """Return the name of a trajectory's kind."""
    return TRAJECTORIES.name_of(trajectory)
