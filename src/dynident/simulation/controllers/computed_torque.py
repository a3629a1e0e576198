"""Computed-torque control: the believed model turns accelerations into torques."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from dynident.arrays import Array
from dynident.model.kernels.generic import motion, torque_of_motion
from dynident.model.kernels.jit import compiled
from dynident.simulation.controllers.base import Controller, Loop


@dataclass(frozen=True)
class ComputedTorque(Controller):
    """Inverse dynamics of the controller's model at the measured state, for ddq = ddq_ref + w^2 e + 2 d w de.

    Linearises and decouples the joints where the model is right (Luh, Walker and Paul 1980). ``feedforward: model``
    adds the believed friction at the commanded speed; gravity is in the law itself.

    Attributes:
        bandwidth_hz: Natural frequency w of the error in Hz; none for 8 Hz, or what the rate allows.
        damping_ratio: Damping ratio d of the error.
    """

    bandwidth_hz: float | None = None
    damping_ratio: float = 1.0

    memory = 2

    def law(self) -> Callable[..., Any]:
        return _law

    def settings(self, loop: Loop) -> Array:
        pulsation = loop.pulsation(self.bandwidth_hz, 8.0)
        return np.outer([pulsation**2, 2.0 * self.damping_ratio * pulsation], np.ones(loop.joints))


@compiled
def _law(settings: Array, goal: Array, seen: Array, robot: Any, memory: Array, work: Array, tau: Array) -> None:
    links, reals, gravity, theta, armature = robot[2]
    wanted = memory[1]
    for i in range(len(tau)):
        error, lag = goal[0, i] - seen[0, i], goal[1, i] - seen[1, i]
        wanted[i] = goal[2, i] + settings[0, i] * error + settings[1, i] * lag
    motion(links, reals, gravity, seen[0], seen[1], wanted, 1.0, work)
    torque_of_motion(links, reals, theta, tau, work)
    for i in range(len(tau)):
        for k in range(len(tau)):
            tau[i] += armature[i, k] * wanted[k]
        tau[i] += goal[4, i]
