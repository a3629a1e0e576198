"""Friction that builds up over a distance after each reversal: a spring that slips."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import accumulate
from typing import ClassVar

import numpy as np

from dynident.arrays import Array, BoolArray
from dynident.model.friction._slipped import Slipped
from dynident.model.friction.base import (
    Friction,
    Inputs,
    Motion,
    Number,
    Range,
    SelectionUse,
    State,
    check_positive,
    larger,
    smaller,
)


@dataclass(frozen=True)
class Presliding(Friction):
    """Presliding friction Fp z / length, z' = dq while |z| < length: a Prandtl-Ishlinskii stop operator.

    One element of the generalised Maxwell slip model (Al-Bender, Lampaert and Swevers 2005): after a reversal friction
    changes from one level to the other over twice the length, however slow the motion is. ``coulomb`` beside it is the
    share of dry friction that changes at once. Over any closed motion it loses work. Where samples have no history, as
    in formats without a memory, the element is taken as slipped the way of the motion: Fp tanh(dq / 0.01).

    Attributes:
        length: Distance in rad (or m) over which the drive moves before the element slips.
    """

    length: float = 3e-3

    coefficients: ClassVar = Slipped.coefficients
    ranges: ClassVar = {"length": Range(3e-4, 0.1, is_distance=True)}
    selection: ClassVar = SelectionUse(7, {"length": 3e-3, "choose": ("part", "length")})

    def __post_init__(self) -> None:
        check_positive(self.length, "length", "a distance in rad, at least the resolution of the encoder,")

    @property
    def states(self) -> tuple[State, ...]:
        return (State("z", "rad", "m", -self.length, self.length),)

    def terms(self, at: Inputs) -> tuple[Number, ...]:
        return (at.state[0] / self.length,)

    def update(self, at: Inputs) -> tuple[Number, ...]:
        return (smaller(larger(at.state[0] + at.moved, -self.length), self.length),)

    @property
    def without_memory(self) -> Friction:
        return Slipped(joints=self.joints)

    def states_along(self, motion: Motion, step: float, first: Array | None = None) -> Array:
        return self._along(motion, np.zeros(motion.q.shape[1]) if first is None else first[:, 0])[..., None]

    def is_unsettled(self, motion: Motion) -> BoolArray:
        moved = np.maximum.accumulate(motion.q) - np.minimum.accumulate(motion.q)  # from either end it slips meanwhile
        apart = 2.0 * self.length - moved > 1e-9 * self.length
        return apart & ~apart[-1]  # a drive that never moves so far tells nothing apart: its rows stay

    def _along(self, motion: Motion, first: Array) -> Array:
        """Return the deflection along a motion from those at the first sample (n,) on, shape (N, n).

        Between two reversals it follows the position to the end of the spring: only these have to be gone through.
        """
        length, found = self.length, np.empty(motion.q.shape)
        bounded = lambda z, way: length if z + way > length else -length if z + way < -length else z + way  # noqa: E731
        for drive, (q, start) in enumerate(zip(motion.q.T, first.tolist(), strict=True)):
            turns = np.flatnonzero(np.diff(np.sign(np.diff(q)))) + 1
            starts = np.concatenate([[0], turns])
            ways = np.diff(q[starts]).tolist()
            bent = list(accumulate(ways, bounded, initial=start))
            samples = np.diff(starts, append=len(q))
            found[:, drive] = np.clip(np.repeat(bent, samples) + (q - np.repeat(q[starts], samples)), -length, length)
        return found
