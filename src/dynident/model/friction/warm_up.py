"""Friction that changes while a drive warms up by its own losses, where no temperature is logged."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from dynident.arrays import Array
from dynident.model.friction.base import (
    Coefficient,
    Friction,
    Inputs,
    Motion,
    Number,
    Range,
    SelectionUse,
    State,
    exponential,
    larger,
    smooth_sign,
)
from dynident.plugins import bounded

#: Time in s that a step counts as at least (exports are asked twice at one time); time constants in a piece of a sum.
SHORTEST, PIECE = 1e-9, 200.0


@dataclass(frozen=True)
class WarmUp(Friction):
    """Change of Coulomb and viscous friction by the drive's own heat: (FcW tanh(dq / width) + FvW dq) w.

    One thermal mass a drive, heated by what friction loses: time_constant w' = |dq| + dq^2 / crossover - w, losses
    over the level of Coulomb friction (first order in temperature: Simoni, Beschi, Legnani and Visioli 2015). Stands
    beside ``coulomb`` and ``viscous``, which then hold at the start of each log, where w = 0. Warm grease is thin, so
    both are negative as a rule. Where samples have no history the drive is as at the start of a log.

    Attributes:
        time_constant: Time in s in which the drive comes to 63 % of its final temperature.
        crossover: Speed in rad/s (or m/s) at which viscous friction loses as much as Coulomb friction; what it does
            to the course of w is mostly a factor.
        width: Smoothing width of the Coulomb term (tanh), in rad/s (or m/s).
    """

    time_constant: float = 300.0
    crossover: float = bounded(1.0, least=1e-6, most=1e6)
    width: float = bounded(0.02, least=1e-9, most=1e3)

    coefficients: ClassVar = (
        Coefficient("FcW", "N m s/rad", "N s/m", nonnegative=False),
        Coefficient("FvW", "N m s^2/rad^2", "N s^2/m^2", nonnegative=False),
    )
    ranges: ClassVar = {"time_constant": Range(60.0, 3600.0, is_duration=True)}
    selection: ClassVar = SelectionUse(10, {"time_constant": 300.0, "choose": ("part", "time_constant")})

    @property
    def states(self) -> tuple[State, ...]:
        return (State("w", "rad/s", "m/s", 0.0, 1.0),)

    @property
    def lags(self) -> bool:
        return False

    def terms_without_memory(self, at: Inputs) -> tuple[Number, ...]:
        return 0.0, 0.0

    def terms(self, at: Inputs) -> tuple[Number, ...]:
        return at.state[0] * smooth_sign(at.dq, self.width), at.state[0] * at.dq

    def update(self, at: Inputs) -> tuple[Number, ...]:
        # from positions and the time alone, as exports have them: a step's losses come in its middle
        half, way = exponential(at.step * (-0.5 / self.time_constant)), abs(at.moved)
        lost = way + way * way / (larger(at.step, SHORTEST) * self.crossover)
        return (half * (half * at.state[0] + lost * (1.0 / self.time_constant)),)

    def states_along(self, motion: Motion, step: float, first: Array | None = None) -> Array:
        way, half = np.abs(np.diff(motion.q, axis=0, prepend=motion.q[:1])), math.exp(-0.5 * step / self.time_constant)
        risen_by = half / self.time_constant * (way + way**2 / (max(step, SHORTEST) * self.crossover))
        found = np.empty(way.shape)
        found[:1] = 0.0 if first is None else first[:, 0]
        size = max(int(PIECE * self.time_constant / max(step, SHORTEST)), 1)
        for start in range(1, len(found), size):  # the sum in closed form: all of it is positive, so nothing cancels
            piece = risen_by[start : start + size]
            decay = half ** (2.0 * np.arange(1, len(piece) + 1)[:, None])
            risen = np.cumsum(piece / decay, axis=0)
            found[start : start + size] = decay * (found[start - 1] + risen)
        return found[..., None]
