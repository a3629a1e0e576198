"""Torque of every joint within its limit, with a chance margin where the model's uncertainty is known."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from dynident.arrays import Array, IntArray
from dynident.excitation.design.bounds.base import Bound, BoundLabel, ByTorque, Grid
from dynident.excitation.design.limits import MotionLimits


class TorqueBound(Bound):
    """(+-tau_i + sigmas sqrt(y_i' S y_i)) / limit_i: the highest torque of each joint, then the lowest.

    Attributes:
        driven: Joints whose torque is bounded.
    """

    of_posture: ClassVar = True

    def __init__(
        self, limits: MotionLimits, beta: Array, rotors: Array, factors: Sequence[Array] | None = None
    ) -> None:
        """Choose the joints with a finite torque limit.

        Args:
            limits: What must be kept.
            beta: Base parameters of the nominal torque, shape (b,).
            rotors: Known reflected inertia, shape (n, n).
            factors: Per joint F_i with F_i F_i' = sigmas^2 S on its columns, (K_i, b); None for no chance margin.
        """
        self._beta, self._rotors, self._factors, self._names = beta, rotors, factors, limits.joints
        self.driven = tuple(int(i) for i in np.flatnonzero(np.isfinite(limits.torque)))
        self._limits = limits.torque[list(self.driven)]

    @property
    def labels(self) -> tuple[BoundLabel, ...]:
        return 2 * tuple(BoundLabel(self._names[i], "torque") for i in self.driven)

    def shares(self, grid: Grid) -> Array:
        found = grid.torque(self._beta, self._rotors)[list(self.driven)] / self._limits[:, None]
        if self._factors is None:
            return np.concatenate([found, -found])
        moved = [np.linalg.norm(self._factors[i].T @ grid.rows[i], axis=0) for i in self.driven]
        spread = np.stack(moved) / self._limits[:, None]
        return np.concatenate([found + spread, spread - found])

    def slopes(self, grid: Grid, worst: IntArray) -> ByTorque:
        joints = np.array(self.driven * 2, dtype=np.int64)
        known = np.r_[1.0 / self._limits, -1.0 / self._limits]
        columns = grid.observation.columns
        entries = [weight * self._beta[columns[i]] for i, weight in zip(joints, known, strict=True)]
        if self._factors is not None:
            for sample, i, limit, slope in zip(worst, joints, np.tile(self._limits, 2), entries, strict=True):
                moved = self._factors[i].T @ grid.rows[i][:, sample]
                length = float(np.linalg.norm(moved))
                if length > 0:
                    np.add(slope, self._factors[i] @ moved / (length * limit), out=slope)
        return ByTorque(worst[None], joints, [entries], known[None])
