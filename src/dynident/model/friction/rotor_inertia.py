"""Rotor inertia reflected to the joint, identified with the rest."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from dynident.arrays import Array
from dynident.model.friction.base import Coefficient, Friction, Motion, no_slopes


@dataclass(frozen=True)
class RotorInertia(Friction):
    """Torque Ia ddq of the reflected rotor inertia, for geared drives whose rotors are not known."""

    coefficients: ClassVar = (Coefficient("Ia", "kg m^2", "kg", nonnegative=True),)

    def columns(self, motion: Motion) -> Array:
        return motion.ddq[..., None]

    def derivatives(self, motion: Motion) -> tuple[Array, Array, Array]:
        return no_slopes(motion), no_slopes(motion), np.ones((*motion.dq.shape, 1))
