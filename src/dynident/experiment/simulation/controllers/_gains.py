"""Stiffness and damping of joint loops, from a bandwidth or as they are given."""

from __future__ import annotations

from typing import Any

from dynident.arrays import Array
from dynident.experiment.simulation.controllers.base import Loop
from dynident.experiment.simulation.effects import each


def gains(part: Any, loop: Loop) -> tuple[Array, Array]:
    """Return stiffness and damping, each (n,), of a part with the options of :class:`Pd`."""
    pulsation = loop.pulsation(part.bandwidth_hz, 8.0)
    stiffness, damping = pulsation**2 * loop.inertia, 2.0 * part.damping_ratio * pulsation * loop.inertia
    if part.stiffness is not None:
        stiffness = each("controller.stiffness", part.stiffness, loop.joints)
    if part.damping is not None:
        damping = each("controller.damping", part.damping, loop.joints)
    return stiffness, damping
