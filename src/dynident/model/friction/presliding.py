"""Friction that builds up over a distance after each reversal: a spring that slips, at once or more and more."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from dynident.arrays import Array, BoolArray
from dynident.model.friction.base import (
    Coefficient,
    Friction,
    Inputs,
    Motion,
    Number,
    Range,
    SelectionUse,
    State,
    larger,
    power,
    smaller,
    smooth_sign,
)
from dynident.plugins import bounded

#: Share of the length by which states of any start have to agree, and width of its sign without a history, in rad/s.
SETTLED, WIDTH = 0.01, 0.01


@dataclass(frozen=True)
class Presliding(Friction):
    """Presliding friction Fp z / length, dz = (1 - z / length)^(1 - shape) dq for dq > 0, and mirrored (Dahl 1968).

    Of shape 1 it is a Prandtl-Ishlinskii stop operator, an element of the generalised Maxwell slip model (Al-Bender,
    Lampaert and Swevers 2005): after a reversal friction changes from one level to the other over twice the length,
    however slow the motion is. Towards shape 0 the change becomes exponential, as that of bristles (LuGre) in slow
    motion; the work that is lost after a reversal is the same. ``coulomb`` beside it is the share of dry friction that
    changes at once, further elements are parts of their own. With ``damping`` Dp (dq - |dq| z / length) is
    added, Dp dz/dt of bristles (Canudas de Wit, Olsson, Astrom and Lischinsky 1995): before it slips friction grows
    with the speed. Over any closed motion it loses work.
    Without a history, as in formats without a memory, it has slipped the way of the motion: Fp tanh(dq / 0.01).

    Attributes:
        length: Distance in rad (or m) over which the drive moves before the element slips, of shape 1.
        shape: 1 for a spring that slips at the length, towards 0 for one that slips more and more (exponential).
        element: Number of the element of a drive that has several, each with a length of its own.
        damping: Whether the bristles are damped, by a coefficient of its own.
    """

    length: float = 3e-3
    shape: float = bounded(1.0, least=0.01, most=1.0)
    element: int = bounded(1, least=1, most=4)
    damping: bool = False

    ranges: ClassVar = {"length": Range(3e-4, 0.1, is_distance=True), "shape": Range(0.01, 1.0)}
    selection: ClassVar = SelectionUse(9, {"length": 3e-3, "damping": True, "choose": ("part", "length", "shape")})

    @property
    def coefficients(self) -> tuple[Coefficient, ...]:  # type: ignore[override]
        """Its level and its damping, named by the element."""
        number = "" if self.element == 1 else f"{self.element}"
        level = Coefficient(f"Fp{number}", "N m", "N", nonnegative=True, in_simulators="friction")
        return level, *[Coefficient(f"Dp{number}", "N m s/rad", "N s/m", nonnegative=True)] * self.damping

    @property
    def states(self) -> tuple[State, ...]:
        return (State("z", "rad", "m", -self.length, self.length),)

    def terms(self, at: Inputs) -> tuple[Number, ...]:
        z = at.state[0] / self.length
        return z, *[at.dq - abs(at.dq) * z] * self.damping

    def update(self, at: Inputs) -> tuple[Number, ...]:
        z, way, length, shape = at.state[0], at.moved, self.length, self.shape
        if shape == 1.0:
            return (smaller(larger(z + way, -length), length),)
        left = 1.0 - z / length  # to where it slips; then the same the other way, and one of the two ways is none
        for moved in (larger(way, 0.0), -smaller(way, 0.0)):
            rest = power(larger(left, 0.0), shape) - shape / length * moved
            left = 2.0 - power(larger(rest, 0.0), 1.0 / shape)
        return (length * (1.0 - left),)

    def terms_without_memory(self, at: Inputs) -> tuple[Number, ...]:
        return smooth_sign(at.dq, WIDTH), *[0.0] * self.damping

    def states_along(self, motion: Motion, step: float, first: Array | None = None) -> Array:
        return self._along(motion, np.zeros(motion.q.shape[1]) if first is None else first[:, 0])[..., None]

    def is_unsettled(self, motion: Motion) -> BoolArray:
        ends = np.full(motion.q.shape[1], self.length)
        apart = self._along(motion, ends) - self._along(motion, -ends) > SETTLED * self.length
        return apart & ~apart[-1]  # a drive that never moves so far tells nothing apart: its rows stay

    def _along(self, motion: Motion, first: Array) -> Array:
        """Return the deflection along a motion from those at the first sample (n,) on, shape (N, n).

        Between two reversals it is known in closed form: only these have to be gone through.
        """
        found = np.empty(motion.q.shape)
        for z, (moves, samples, side, way), start in zip(found.T, motion.runs, first.tolist(), strict=True):
            bent = side * self._turns(moves, start)
            if self.shape == 1.0:
                moved = np.minimum(np.repeat(bent, samples) + way, self.length)
            else:  # to where it slips
                left = np.maximum(1.0 - bent / self.length, 0.0) ** self.shape
                rest = np.repeat(left, samples) - self.shape / self.length * way
                moved, holds = np.full(len(way), self.length), np.flatnonzero(rest > 0.0)
                moved[holds] = self.length * (1.0 - rest[holds] ** (1.0 / self.shape))
            z[:] = np.repeat(side, samples) * moved
        return found

    def _turns(self, moves: list[float], start: float) -> Array:
        """Return the deflections at the ends of ways without a reversal between them, and before the first."""
        shape, inverse, step = self.shape, 1.0 / self.shape, self.shape / self.length
        found = [at := min(max(start / self.length, -1.0), 1.0)]
        if shape == 1.0:  # without powers: a log has thousands of reversals
            for way in moves:
                at += step * way
                found.append(at := 1.0 if at > 1.0 else -1.0 if at < -1.0 else at)
            return self.length * np.array(found)
        for way in moves:
            side = 1.0 if way >= 0.0 else -1.0
            rest = max(1.0 - side * at, 0.0) ** shape - step * side * way
            found.append(at := side * (1.0 - rest**inverse) if rest > 0.0 else side)
        return self.length * np.array(found)
