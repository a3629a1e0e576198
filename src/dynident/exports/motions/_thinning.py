"""As few points, evenly spaced in time, as keep an interpolation within a tolerance of the motion."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from dynident.arrays import Array
from dynident.errors import BadOption
from dynident.exports.motions._motion import DrivenMotion

#: Samples between two points at which the deviation is looked at, and the fewest intervals that are tried.
FINER, FEWEST = 10, 8

#: From points (M,), (M, n) and times (N,) to positions (N, n).
Interpolation = Callable[[Array, Array, Array], Array]


def linear(knots: Array, points: Array, time: Array) -> Array:
    """Return straight lines between points, as a controller that moves all joints from point to point."""
    return np.stack([np.interp(time, knots, column) for column in points.T], axis=1)


def clamped_cubic(knots: Array, points: Array, time: Array) -> Array:
    """Return the cubic spline through points that is at rest at both ends."""
    from scipy.interpolate import CubicSpline

    return np.asarray(CubicSpline(knots, points, bc_type="clamped")(time))


def thinned(
    motion: DrivenMotion, tolerance: Array, most: int, interpolation: Interpolation
) -> tuple[Array, Array, Array]:
    """Return times (M,), points (M, n) and the largest deviation of each joint (n,), within ``tolerance`` (n,).

    Raises:
        BadOption: More than ``most`` points would be needed.
    """

    def attempt(intervals: int) -> tuple[Array, Array, Array]:
        knots = np.linspace(0.0, motion.motion.duration, intervals + 1)
        points = motion.motion.evaluate(knots)[0]
        fine = np.linspace(0.0, motion.motion.duration, FINER * intervals + 1)
        away = np.abs(interpolation(knots, points, fine) - motion.motion.evaluate(fine)[0])
        return knots, points, away.max(axis=0)

    failed, intervals = FEWEST // 2, FEWEST
    while np.any(attempt(intervals)[2] > tolerance):
        failed, intervals = intervals, 2 * intervals
        if failed >= most:
            break
    while intervals - failed > 1:
        middle = (failed + intervals) // 2
        if np.any(attempt(middle)[2] > tolerance):
            failed = middle
        else:
            intervals = middle
    found = attempt(intervals)
    if intervals + 1 > most or np.any(found[2] > tolerance):
        step = (
            f"more than {most} points would be needed; give a larger tolerance, fewer repeats, or more with most_points"
        )
        raise BadOption("most_points", most, step)
    return found
