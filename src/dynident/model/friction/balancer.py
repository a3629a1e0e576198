"""A spring or gas cylinder between two points beside a joint's axis, which balances the weight of an arm."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from dynident.model.friction.base import Coefficient, Friction, Inputs, Number, Range, cosine, power, sine
from dynident.plugins import bounded


@dataclass(frozen=True)
class Balancer(Friction):
    """Balancer (Kb + Fb / s) sin(q - dead_center), s^2 = 1 + ratio^2 - 2 ratio cos(q - dead_center): a spring.

    A spring or gas cylinder, fixed at distances a and b from the axis, has the length a s and pulls with k a s + f, so
    that it asks Kb = k a b and Fb = f b of the drive (Klimchik, Wu, Dumas, Caro, Furet and Pashkevich 2013). A cylinder
    of constant force has Kb = 0; what pushes has Fb < 0. Kb acts as weight of the link does: bodies near the robot
    model tell the two apart.

    Attributes:
        dead_center: Position in rad at which it points at the axis, at its shortest: it gives no torque there.
        ratio: b / a, the longer distance over the shorter one.
    """

    dead_center: float = bounded(0.0, least=-100.0, most=100.0)
    ratio: float = bounded(3.0, least=1.01, most=1000.0)

    coefficients: ClassVar = (
        Coefficient("Kb", "N m", "N", nonnegative=True),
        Coefficient("Fb", "N m", "N", nonnegative=False),
    )
    ranges: ClassVar = {"ratio": Range(1.01, 100.0)}

    def terms(self, at: Inputs) -> tuple[Number, ...]:
        angle = at.q - self.dead_center
        across = sine(angle)
        return across, across * power(1.0 + self.ratio**2 - 2.0 * self.ratio * cosine(angle), -0.5)
