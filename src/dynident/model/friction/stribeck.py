"""The Stribeck effect: friction that falls from standstill to slow motion."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from dynident.arrays import Array
from dynident.model.friction.base import Coefficient, Friction, Motion, Range, check_positive, no_slopes, smooth_sign


@dataclass(frozen=True)
class Stribeck(Friction):
    """Friction Fs exp(-(|dq| / velocity)^exponent) tanh(dq / width) that fades with speed (Armstrong-Helouvry 1991).

    Fs is what friction at the least speed has above the Coulomb level, so ``coulomb`` stands beside it.

    Attributes:
        velocity: Stribeck velocity in rad/s (or m/s): the speed at which the effect has faded to 1 / e.
        exponent: How sharply it fades: 1 (Tustin) to 2 (Gauss).
        width: Speed in rad/s (or m/s) over which the sign turns.
    """

    velocity: float = 0.1
    exponent: float = 1.0
    width: float = 0.02

    coefficients: ClassVar = (Coefficient("Fs", "N m", "N", nonnegative=True),)
    ranges: ClassVar = {
        "velocity": Range(0.01, 2.0, is_speed=True),
        "exponent": Range(0.5, 2.0),
        "width": Range(1e-3, 0.3, is_speed=True),
    }

    def __post_init__(self) -> None:
        check_positive(self.velocity, "velocity", "a speed in rad/s")
        check_positive(self.exponent, "exponent", "a number such as 1 or 2,")
        check_positive(self.width, "width", "a speed in rad/s")

    def columns(self, motion: Motion) -> Array:
        sign, _ = smooth_sign(motion.dq, self.width)
        return (sign * self._fading(motion.dq))[..., None]

    def derivatives(self, motion: Motion) -> tuple[Array, Array, Array]:
        sign, slope = smooth_sign(motion.dq, self.width)
        share = np.abs(motion.dq) / self.velocity
        # |dq|^(exponent - 1) sign(dq) times a smooth sign is 0 at standstill for every exponent above 0.
        power = np.divide(share**self.exponent, motion.dq, out=np.zeros_like(share), where=motion.dq != 0)
        found = self._fading(motion.dq) * (slope - sign * self.exponent * power)
        return no_slopes(motion), found[..., None], no_slopes(motion)

    def _fading(self, dq: Array) -> Array:
        return np.exp(-((np.abs(dq) / self.velocity) ** self.exponent))
