"""A linear spring about a joint, or a hose or cable pack that pulls it to a position."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from dynident.model.friction.base import Coefficient, Friction, Inputs, Number
from dynident.plugins import bounded


@dataclass(frozen=True)
class Spring(Friction):
    """Torque Ks (q - rest) that a spring asks of the drive; it stores energy and loses none.

    With ``offset`` beside it, which takes the torque at ``rest``, the position of no torque need not be known.

    Attributes:
        rest: Position in rad (or m) at which the spring is slack.
    """

    rest: float = bounded(0.0, least=-1e4, most=1e4)

    coefficients: ClassVar = (Coefficient("Ks", "N m/rad", "N/m", nonnegative=True),)

    def terms(self, at: Inputs) -> tuple[Number, ...]:
        return (at.q - self.rest,)
