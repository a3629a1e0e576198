"""Stiffness and damping of joint loops, from a bandwidth or as they are given."""

from __future__ import annotations

from typing import Any

import numpy as np

from dynident.arrays import Array
from dynident.experiment.simulation.controllers.base import SAFE, Loop
from dynident.experiment.simulation.effects import each

#: Natural frequency of joint loops, in Hz, where the motion asks for no higher one.
USUAL_HZ = 8.0

#: Halvings of the share of the damping that the rate of the controller allows.
_HALVINGS = 12


def following(loop: Loop, damping_ratio: float) -> tuple[Array, Array]:
    """Return stiffness and damping, each (n,), at which each joint follows its motion, as far as the rate allows it.

    They are the usual ones, and higher where friction or inertia would hold a joint back. Friction damps as well: what
    it gives at any speed of the motion is left out of the feedback, which would be too fast for the ticks on a light
    joint. Where the ticks allow less damping than that, the joint is less stiff: its damping ratio is 0.5 or more.
    """
    usual = loop.pulsation(None, USUAL_HZ)
    wanted = np.maximum(usual, np.minimum(loop.wanted, 0.5 / loop.dead))
    least = 2.0 * damping_ratio * usual * loop.inertia
    room = np.maximum(2.0 * damping_ratio * wanted * loop.inertia - loop.friction, least) - least
    low, high = 0.0, 1.0
    if loop.decay(least + room) <= SAFE:
        low = 1.0
    else:
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if loop.decay(least + middle * room) <= SAFE else (low, middle)
    damping = least + low * room
    pulsation = np.maximum(usual, np.minimum(wanted, (damping + loop.friction) / loop.inertia))
    return pulsation**2 * loop.inertia, damping


def gains(part: Any, loop: Loop) -> tuple[Array, Array]:
    """Return stiffness and damping, each (n,), of a part with the options of :class:`Pd`."""
    if part.bandwidth_hz is None:
        stiffness, damping = following(loop, part.damping_ratio)
    else:
        pulsation = loop.pulsation(part.bandwidth_hz, USUAL_HZ)
        stiffness, damping = pulsation**2 * loop.inertia, 2.0 * part.damping_ratio * pulsation * loop.inertia
    if part.stiffness is not None:
        stiffness = each("controller.stiffness", part.stiffness, loop.joints)
    if part.damping is not None:
        damping = each("controller.damping", part.damping, loop.joints)
    return stiffness, damping
