"""Rotor inertia reflected to the joint, identified with the rest."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from dynident.model.friction.base import Coefficient, Friction, Inputs, Number, SelectionUse


@dataclass(frozen=True)
class RotorInertia(Friction):
    """Torque Ia ddq of the reflected rotor inertia, for geared drives of unknown rotor inertia."""

    coefficients: ClassVar = (Coefficient("Ia", "kg m^2", "kg", nonnegative=True, in_simulators="armature"),)
    selection: ClassVar = SelectionUse(3, {"choose": ("part",)})

    def terms(self, at: Inputs) -> tuple[Number, ...]:
        return (at.ddq,)
