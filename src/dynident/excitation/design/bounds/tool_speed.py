"""Speed of the tool point within its limit."""

from __future__ import annotations

import numpy as np

from dynident.arrays import Array, IntArray
from dynident.excitation.design.bounds.base import Bound, BoundLabel, ByMotion, Grid
from dynident.excitation.design.limits import ToolLimit


class ToolSpeedBound(Bound):
    """|v| / limit of the tool point, one row.

    Attributes:
        tool: The point and its largest speed.
    """

    def __init__(self, tool: ToolLimit) -> None:
        self.tool = tool

    @property
    def labels(self) -> tuple[BoundLabel, ...]:
        return (BoundLabel("tool", "tool speed"),) if np.isfinite(self.tool.speed) else ()

    def shares(self, grid: Grid) -> Array:
        return self.tool.point.speed(grid.signals[0], grid.signals[1])[None] / self.tool.speed

    def slopes(self, grid: Grid, worst: IntArray) -> ByMotion:
        by_q, by_dq = self.tool.point.gradient(grid.signals[0][worst], grid.signals[1][worst])
        slope = np.zeros((1, 1, 4, grid.signals.shape[2]))
        slope[0, :, 0], slope[0, :, 1] = by_q / self.tool.speed, by_dq / self.tool.speed
        return ByMotion(worst[None], slope)
