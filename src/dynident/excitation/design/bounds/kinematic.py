"""Position, speed, acceleration and jerk of every joint within their ranges."""

from __future__ import annotations

import numpy as np

from dynident.arrays import Array, IntArray
from dynident.excitation.design.bounds.base import Bound, BoundLabel, ByMotion, Grid
from dynident.excitation.design.limits import QUANTITIES, MotionLimits


class KinematicBound(Bound):
    """Distance from the middle of the range, speed, acceleration and jerk as shares of their finite bounds.

    Attributes:
        finite: The bounds that are finite: derivative (0 position .. 3 jerk) and joint; each has a row for the highest
            value, then each has one for the lowest.
    """

    def __init__(self, limits: MotionLimits) -> None:
        bounds = limits.bounds()
        self._orders, self._joints = np.nonzero(np.isfinite(bounds))
        self._bounds = bounds[self._orders, self._joints]
        self._middle = np.where(self._orders == 0, limits.centre[self._joints], 0.0)
        self._names = limits.joints
        self.finite = tuple((int(k), int(i)) for k, i in zip(self._orders, self._joints, strict=True))

    @property
    def labels(self) -> tuple[BoundLabel, ...]:
        return 2 * tuple(BoundLabel(self._names[i], QUANTITIES[k]) for k, i in self.finite)

    def shares(self, grid: Grid) -> Array:
        values = grid.signals[self._orders, :, self._joints] - self._middle[:, None]
        found = values / self._bounds[:, None]
        return np.concatenate([found, -found])

    def slopes(self, grid: Grid, worst: IntArray) -> ByMotion:
        half = len(self._orders)
        found = np.zeros((1, 2 * half, 4, grid.signals.shape[2]))
        rows = np.arange(half)
        found[0, rows, self._orders, self._joints] = 1.0 / self._bounds
        found[0, half + rows, self._orders, self._joints] = -1.0 / self._bounds
        return ByMotion(worst[None], found)
