"""Proportional-integral-derivative control of each joint."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from dynident.arrays import Array
from dynident.model.kernels.jit import compiled
from dynident.simulation.controllers.base import USUAL_HZ, Controller, Loop, gains


@dataclass(frozen=True)
class Pid(Controller):
    """A ``pd`` with the integral of the position error; anti-windup: no integration while the torque is at its limit.

    Attributes:
        bandwidth_hz: As that of ``pd``.
        damping_ratio: Damping ratio of the loops.
        integral_hz: Corner frequency of the integral: its gain is stiffness times 2 pi integral_hz; none for a tenth
            of the bandwidth.
        stiffness: In N m/rad or N/m, one number or one per joint; none for that of the bandwidth.
        damping: In N m s/rad or N s/m, one number or one per joint; none for that of the bandwidth.
    """

    bandwidth_hz: float | None = None
    damping_ratio: float = 1.0
    integral_hz: float | None = None
    stiffness: tuple[float, ...] | None = None
    damping: tuple[float, ...] | None = None

    memory = 2
    may_be_zero = ("stiffness", "damping", "integral_hz")

    def law(self) -> Callable[..., Any]:
        return _law

    def settings(self, loop: Loop) -> Array:
        stiffness, damping = gains(self, loop)
        corner = 0.1 * loop.pulsation(self.bandwidth_hz, USUAL_HZ)
        if self.integral_hz is not None:
            corner = 2.0 * np.pi * self.integral_hz
        return np.array([stiffness, damping, corner * stiffness])


@compiled
def _law(settings: Array, goal: Array, seen: Array, robot: Any, memory: Array, work: Array, tau: Array) -> None:
    limits, period = robot[0], robot[1]
    for i in range(len(tau)):
        error = goal[0, i] - seen[0, i]
        direct = goal[3, i] + settings[0, i] * error + settings[1, i] * (goal[1, i] - seen[1, i])
        grown = memory[1, i] + settings[2, i] * error * period
        if abs(direct + grown) <= limits[i] or abs(grown) < abs(memory[1, i]):
            memory[1, i] = grown
        tau[i] = direct + memory[1, i]
