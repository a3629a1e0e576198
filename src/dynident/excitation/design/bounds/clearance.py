"""Distance between pairs of shapes of the robot and its surroundings."""

from __future__ import annotations

from collections.abc import Callable
from typing import ClassVar

import numpy as np

from dynident.arrays import Array, IntArray
from dynident.excitation.design.bounds.base import Bound, BoundLabel, ByMotion, Grid
from dynident.excitation.design.distances import Distances, least_distances
from dynident.excitation.design.limits import DISTANCE_SCALE


class ClearanceBound(Bound):
    """1 + (required - distance) / 0.1 m of every pair at its nearest sample; what holds between samples is checked.

    On the grid of a search the samples alone count; :meth:`certain_shares` judges between them before a motion is kept.

    Attributes:
        distances: The pairs.
    """

    of_posture: ClassVar = True
    between_samples: ClassVar = True

    def __init__(self, distances: Distances) -> None:
        self.distances = distances

    @property
    def labels(self) -> tuple[BoundLabel, ...]:
        return tuple(BoundLabel(name, "clearance") for name in self.distances.names)

    def shares(self, grid: Grid) -> Array:
        found = self.distances.distances(grid.signals[0])
        return np.ascontiguousarray(1.0 + (self.distances.required - found).T / DISTANCE_SCALE)

    def slopes(self, grid: Grid, worst: IntArray) -> ByMotion:
        slope = np.zeros((1, len(worst), 4, grid.signals.shape[2]))
        slope[0, :, 0] = -self.distances.gradient(grid.signals[0][worst], np.arange(len(worst))) / DISTANCE_SCALE
        return ByMotion(worst[None], slope)

    def certain_shares(
        self, positions: Callable[[Array], tuple[Array, Array]], time: Array, most: Array, fine: float
    ) -> Array:
        certain, _ = least_distances(self.distances, positions, time, most, fine * DISTANCE_SCALE)
        return 1.0 + (self.distances.required - certain) / DISTANCE_SCALE
