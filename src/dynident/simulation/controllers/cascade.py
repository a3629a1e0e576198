"""Cascaded control as in drives: position around velocity around current."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from dynident.arrays import Array
from dynident.model.kernels.jit import compiled
from dynident.plugins import bounded
from dynident.simulation.controllers.base import Controller, Loop


@dataclass(frozen=True)
class Cascade(Controller):
    """A position loop (P) around a speed loop (PI) around a current loop of first order, as in servo drives.

    The speed loop runs at ``rate``, the position loop every ``position_ticks`` ticks;
    the speed integral rests while the torque is at its limit.

    Attributes:
        speed_hz: Bandwidth of the speed loops in Hz: gain M_ii 2 pi speed_hz with the mass matrix at the start; none
            for 20 Hz, or what the rate allows along the motion.
        speed_integral_hz: Corner frequency of the speed integrals in Hz; none for a fifth of the bandwidth.
        position_hz: Bandwidth of the position loops in Hz; none for a quarter of that of the speed loops.
        position_ticks: Ticks of the controller from one position control to the next.
        speed_feedforward: Share of the commanded speed that is fed forward.
        current_hz: Corner frequency of the closed current loops.
        rate: Ticks of the speed loops a second, in Hz.
    """

    speed_hz: float | None = None
    speed_integral_hz: float | None = None
    position_hz: float | None = None
    position_ticks: int = bounded(4, most=1_000_000)
    speed_feedforward: float = 1.0

    current_hz: float | None = field(default=300.0, kw_only=True)
    rate: float = field(default=4000.0, kw_only=True)

    memory = 3
    may_be_zero = ("speed_integral_hz", "speed_feedforward")

    def law(self) -> Callable[..., Any]:
        return _law

    def settings(self, loop: Loop) -> Array:
        speed = loop.pulsation(self.speed_hz, 20.0)
        integral = 0.2 * speed if self.speed_integral_hz is None else 2.0 * np.pi * self.speed_integral_hz
        position = 0.25 * speed if self.position_hz is None else 2.0 * np.pi * self.position_hz
        ones = np.ones(loop.joints)
        gain = speed * loop.inertia
        share, ticks = self.speed_feedforward * ones, self.position_ticks * ones
        return np.array([gain, integral * gain, position * ones, share, ticks])


@compiled
def _law(settings: Array, goal: Array, seen: Array, robot: Any, memory: Array, work: Array, tau: Array) -> None:
    limits, period = robot[0], robot[1]
    for i in range(len(tau)):
        if memory[0, i] % settings[4, i] == 0.0:
            memory[2, i] = settings[2, i] * (goal[0, i] - seen[0, i]) + settings[3, i] * goal[1, i]
        error = memory[2, i] - seen[1, i]
        direct = goal[3, i] + settings[0, i] * error
        grown = memory[1, i] + settings[1, i] * error * period
        if abs(direct + grown) <= limits[i] or abs(grown) < abs(memory[1, i]):
            memory[1, i] = grown
        tau[i] = direct + memory[1, i]
