"""A quintic B-spline that starts and ends at rest, by construction."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from dynident.arrays import Array, frozen
from dynident.errors import BadOption
from dynident.excitation.trajectories._series import checked_period
from dynident.excitation.trajectories.base import Designable

#: Degree of the pieces; jerk and snap are continuous inside the motion.
DEGREE = 5

#: How many control points are equal at an end that is at rest: position, zero speed, zero acceleration.
_END = 3


@dataclass(frozen=True)
class BSpline(Designable):
    """Quintic B-spline on even clamped knots with three equal control points at each end: dq = ddq = 0 there.

    q_i(t) = sum_c B_c(t) P_ic, with B_c the B-splines of degree 5 (de Boor 1978). It repeats where it ends in the
    posture in which it starts, as all that are designed; else it stays at its ends outside 0..period.

    Attributes:
        control: P_ic, shape (n, C), C >= 6, in rad or m; C - 5 pieces of equal length.
        period: Time from start to end, in s.

    Raises:
        BadOption: Ends that are not at rest, a number that is not finite, a period that is not positive.
        ValueError: Another shape.
    """

    control: Array
    period: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "control", frozen(self.control, (None, None), "control"))
        object.__setattr__(self, "period", checked_period(self.period))
        if self.control.shape[1] < 2 * _END:
            raise BadOption("control", f"of shape {self.control.shape}", f"give {2 * _END} or more points a joint")
        if not np.all(np.isfinite(self.control)):
            raise BadOption("control", float(self.control[~np.isfinite(self.control)][0]), "give finite numbers")
        for joint, row in enumerate(self.control, 1):
            if np.any(row[:_END] != row[0]) or np.any(row[-_END:] != row[-1]):
                step = "the first three must be equal, and the last three, to start and end at rest"
                raise BadOption(f"control of joint {joint}", row.tolist(), step)

    @classmethod
    def from_table(cls, rows: Sequence[npt.ArrayLike], period: float) -> BSpline:
        """Build from one row of control points per joint, in rad or m; ends that differ by rounding become equal.

        Raises:
            BadOption: Rows of different lengths, or ends that are not at rest.
        """
        table = [np.asarray(row, dtype=np.float64) for row in rows]
        for joint, row in enumerate(table, 1):
            if row.shape != table[0].shape or row.ndim != 1:
                raise BadOption(f"row {joint}", f"{row.size} values", f"give {table[0].size} as in row 1")
        return cls(_with_equal_ends(np.array(table)), period)

    @staticmethod
    def knots(period: float, count: int) -> Array:
        """Return the knots of ``count`` control points in s, shape (C + 6,): even, six times at each end."""
        inner = np.linspace(0.0, period, count - DEGREE + 1)
        return np.r_[np.zeros(DEGREE), inner, np.full(DEGREE, period)]

    @staticmethod
    def basis(time: Array, period: float, count: int) -> Array:
        """Return the B-splines of degree 5 and their three derivatives at times in 0..period, shape (4, N, C)."""
        from scipy.interpolate import BSpline as Spline  # loads slowly

        spline = Spline(BSpline.knots(period, count), np.eye(count), DEGREE)
        return np.stack([spline(time, nu=order) for order in range(4)])

    @staticmethod
    def free_map(harmonics: int) -> Array:
        """Return the map of 2 H - 1 free numbers onto 2 H + 4 control points, shape (2 H + 4, 2 H - 1).

        As many as a Fourier series at rest with H harmonics has. The first moves all points; each other one moves a
        point of its own, and all of them so that the mean over time stays: the first is the mean posture. Both ends
        are the same, so that the motion can be repeated.

        Raises:
            BadOption: Fewer than 2: nothing but the posture would be free.
        """
        if harmonics < 2:
            raise BadOption("harmonics", harmonics, "give 2 or more to start and end at rest")
        free = 2 * harmonics - 2
        found = np.zeros((free + 2 * _END, free + 1))
        found[:, 0] = 1.0
        found[_END : _END + free, 1:] = np.eye(free)
        knots, inner = BSpline.knots(1.0, len(found)), np.arange(_END, _END + free)
        # The mean of a B-spline over time is the length of its support over degree + 1 (de Boor 1978).
        found[:, 1:] -= (knots[inner + DEGREE + 1] - knots[inner]) / (DEGREE + 1)
        return found

    @staticmethod
    def extremes(table: Array, period: float, samples: int) -> Array:
        """Return the lowest and the highest q, dq, ddq and jerk, shape (2, 4, n): exact, from the pieces' extrema."""
        from scipy.interpolate import BSpline as Spline
        from scipy.interpolate import PPoly

        spline = Spline(BSpline.knots(period, table.shape[1]), np.ascontiguousarray(table.T), DEGREE)
        ends = np.linspace(0.0, period, table.shape[1] - DEGREE + 1)
        powers = [spline(ends[:-1], nu=k) / math.factorial(k) for k in range(DEGREE, -1, -1)]
        curve = PPoly(np.stack(powers), ends)
        found = np.empty((2, 4, len(table)))
        for order in range(4):
            slope = curve.derivative()
            for joint in range(len(table)):
                roots = PPoly(slope.c[:, :, joint], slope.x).roots(discontinuity=False, extrapolate=False)
                values = curve(np.r_[ends, roots[np.isfinite(roots)]])[:, joint]
                found[:, order, joint] = values.min(), values.max()
            curve = slope
        return found

    @property
    def table(self) -> Array:
        """The control points, shape (n, C)."""
        return self.control

    @property
    def periodic(self) -> bool:
        """Whether it ends in the posture in which it starts."""
        return bool(np.array_equal(self.control[:, 0], self.control[:, -1]))

    @property
    def at_rest(self) -> bool:
        """It starts at rest."""
        return True

    @property
    def detail(self) -> str:
        """Its number of pieces."""
        return f"{self.control.shape[1] - DEGREE} quintic pieces"

    def data(self) -> dict[str, Any]:
        """Return period, degree, knots and control points."""
        return {
            "period": self.period,
            "degree": DEGREE,
            "knots": self.knots(self.period, self.control.shape[1]).tolist(),
            "control": self.control.tolist(),
        }

    @classmethod
    def from_data(cls, data: Mapping[str, Any]) -> BSpline:
        """Build from period, degree, knots and control points.

        Raises:
            BadOption: Another degree, or knots that are not the even ones.
        """
        if data["degree"] != DEGREE:
            raise BadOption("degree", data["degree"], f"give {DEGREE}")
        found = cls(np.array(data["control"], float), data["period"])
        knots, even = np.array(data["knots"], float), cls.knots(found.period, found.control.shape[1])
        if knots.shape != even.shape or not np.allclose(knots, even, rtol=1e-9, atol=1e-12):
            raise BadOption("knots", knots.tolist(), "give even knots from 0 to the period, six at each end")
        return found

    def _inside(self, time: Array) -> Array:
        if not self.periodic:
            return np.clip(time, 0.0, self.period)
        inside = np.mod(time, self.period)
        return np.where((inside == 0.0) & (time > 0.0), self.period, inside)


def _with_equal_ends(table: Array) -> Array:
    """Return control points whose ends are equal to the last bit where they were so but for rounding."""
    found = np.array(table, dtype=np.float64)
    if found.ndim != 2 or found.shape[1] < 2 * _END:
        return found
    near = 1e-12 * np.abs(found).max(axis=1, keepdims=True, initial=0.0)
    for own in (slice(0, _END), slice(-_END, None)):
        close = np.abs(found[:, own] - found[:, :1]) <= near
        alone = np.abs(found[:, own] - found[:, own][:, :1]) <= near
        found[:, own] = np.where(close, found[:, :1], np.where(alone, found[:, own][:, :1], found[:, own]))
    return found
