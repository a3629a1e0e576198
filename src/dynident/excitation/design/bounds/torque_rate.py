"""Rate of the torque of every joint within its limit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from dynident.arrays import Array, BoolArray, IntArray
from dynident.excitation.design.bounds.base import Bound, BoundLabel, ByTorque, Grid
from dynident.excitation.design.limits import MotionLimits
from dynident.model.dynamic_model import DynamicModel

#: Speed in rad/s (or m/s) on either side of standstill, and share of its largest value by which dry friction turns.
SLOW, TURNS = 0.05, 0.2


class TorqueRateBound(Bound):
    """(tau_i(k + 1) - tau_i(k)) / (step limit_i): the fastest rise of each joint's torque, then the fastest fall.

    The difference between neighbouring samples is the mean rate between them; its gradient is exact. It is less than
    the largest rate between the samples by about (w step)^2 / 24 of it, w the pulsation of the torque, so that a motion
    is judged on the finer grid, and its plan by narrow differences. Dry friction is left out (see
    :func:`smooth_parameters`).

    Attributes:
        driven: Joints whose rate is bounded.
    """

    def __init__(self, limits: MotionLimits, beta: Array, rotors: Array) -> None:
        """Choose the joints with a finite rate.

        Args:
            limits: What must be kept.
            beta: Base parameters of the smooth part of the torque, shape (b,).
            rotors: Known reflected inertia, shape (n, n).
        """
        self._beta, self._rotors, self._names = beta, rotors, limits.joints
        self.driven = tuple(int(i) for i in np.flatnonzero(np.isfinite(limits.torque_rate)))
        self._limits = limits.torque_rate[list(self.driven)]

    @property
    def labels(self) -> tuple[BoundLabel, ...]:
        return 2 * tuple(BoundLabel(self._names[i], "torque rate") for i in self.driven)

    def shares(self, grid: Grid) -> Array:
        torque = grid.torque(self._beta, self._rotors)[list(self.driven)]
        found = (np.roll(torque, -1, axis=1) - torque) / (grid.step * self._limits[:, None])
        return np.concatenate([found, -found])

    def slopes(self, grid: Grid, worst: IntArray) -> ByTorque:
        once = 1.0 / (grid.step * self._limits)
        columns = grid.observation.columns
        up = [weight * self._beta[columns[i]] for i, weight in zip(self.driven, once, strict=True)]
        down = [-slope for slope in up]
        known = np.r_[once, -once]
        after = (worst + 1) % grid.signals.shape[1]
        joints = np.array(self.driven * 2, dtype=np.int64)
        return ByTorque(np.stack([after, worst]), joints, [up + down, down + up], np.stack([known, -known]))


def smooth_parameters(model: DynamicModel) -> BoolArray:
    """Return which standard parameters make a torque whose rate means something, shape (p,).

    All inertial ones, and friction that does not turn over with the joint. Dry friction does: the smoothed sign of a
    model turns over in milliseconds, at a rate that is that of the smoothing, not of the drive. A column counts as dry
    where it changes from -0.05 to 0.05 rad/s (or m/s) by more than a fifth of its largest value.
    """
    motion = model.random_motion(40, seed=1)
    slow = SLOW * np.sign(motion.dq)
    forwards, backwards = (model.friction_values(replace(motion, dq=speed)) for speed in (slow, -slow))
    most = np.abs([model.friction_values(motion), forwards, backwards]).max(axis=(0, 1), initial=0.0)
    dry = np.abs(forwards - backwards).max(axis=0, initial=0.0) > TURNS * most
    return np.r_[np.ones(model.inertial_count, dtype=bool), ~dry[model.terms]]
