"""Proportional-derivative control of each joint."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from dynident.arrays import Array
from dynident.model.kernels.jit import compiled
from dynident.simulation.controllers.base import Controller, Loop, gains


@dataclass(frozen=True)
class Pd(Controller):
    """Stiffness times the position error and damping times the velocity error of each joint.

    Attributes:
        bandwidth_hz: Natural frequency w of the loops in Hz: stiffness M_ii w^2, damping 2 damping_ratio M_ii w, with
            the mass matrix at the start; none for 8 Hz, or what the rate allows along the motion, or what a joint
            needs to follow its motion to 5 % in spite of friction and inertia, as far as the rate allows it; damping is
            then less by what friction gives.
        damping_ratio: Damping ratio of the loops.
        stiffness: In N m/rad or N/m, one number or one per joint; none for that of the bandwidth.
        damping: In N m s/rad or N s/m, one number or one per joint; none for that of the bandwidth.
    """

    bandwidth_hz: float | None = None
    damping_ratio: float = 1.0
    stiffness: tuple[float, ...] | None = None
    damping: tuple[float, ...] | None = None

    may_be_zero = ("stiffness", "damping")

    def plain_gains(self) -> tuple[tuple[float, ...], tuple[float, ...]] | None:
        if self.delay_s or self.current_hz or not (self.stiffness and self.damping):
            return None
        return self.stiffness, self.damping

    def law(self) -> Callable[..., Any]:
        return _law

    def settings(self, loop: Loop) -> Array:
        return np.array(gains(self, loop))


@compiled
def _law(settings: Array, goal: Array, seen: Array, robot: Any, memory: Array, work: Array, tau: Array) -> None:
    for i in range(len(tau)):
        tau[i] = goal[3, i] + settings[0, i] * (goal[0, i] - seen[0, i]) + settings[1, i] * (goal[1, i] - seen[1, i])
