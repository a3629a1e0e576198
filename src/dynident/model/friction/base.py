"""What a friction part is: columns of the regressor that belong to one drive each."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from dynident.arrays import Array


@dataclass(frozen=True)
class Motion:
    """What a friction column may see, at the drives (motor side where motors are coupled).

    Attributes:
        q: Positions, shape (N, n), in rad or m.
        dq: Velocities, shape (N, n), in rad/s or m/s.
        ddq: Accelerations, shape (N, n), in rad/s^2 or m/s^2.
        torque: Torque of the rigid body model without friction, shape (N, n), in N m or N; None where not known.
        temperature: Temperature of each drive, shape (N, n), in degrees Celsius; None where the log has none.
    """

    q: Array
    dq: Array
    ddq: Array
    torque: Array | None = None
    temperature: Array | None = None

    def at_motors(self, coupling: Array) -> Motion:
        """Return the motion of the motors: positions, velocities and accelerations times C', torques times C^-1."""
        torque = None if self.torque is None else np.linalg.solve(coupling.T, self.torque.T).T
        return Motion(self.q @ coupling.T, self.dq @ coupling.T, self.ddq @ coupling.T, torque, self.temperature)


@dataclass(frozen=True)
class Coefficient:
    """One coefficient per drive.

    Attributes:
        symbol: Such as ``"Fc"``.
        unit: Unit on a revolute joint.
        linear_unit: Unit on a prismatic joint.
        nonnegative: Whether physics asks for a value >= 0.
    """

    symbol: str
    unit: str
    linear_unit: str
    nonnegative: bool


class Friction(ABC):
    """Torque of each drive that is linear in a few coefficients of its own: tau_j = sum_c x_jc f_c(motion)_j.

    A part is a frozen dataclass whose fields are its options.
    """

    coefficients: ClassVar[tuple[Coefficient, ...]]

    @abstractmethod
    def columns(self, motion: Motion) -> Array:
        """Return f_c at every drive, shape (N, n, k) for the k coefficients.

        A value may depend only on its own sample and its own drive.
        """

    def derivatives(self, motion: Motion) -> tuple[Array, Array, Array]:
        """Return the derivatives of every value of :meth:`columns` by its q, dq and ddq, each (N, n, k).

        What the gradient of an excitation criterion asks for; torque and temperature are held. This default takes
        central differences, good to about 1e-9 where the columns are smooth; a part with a formula overrides it. A jump
        (a sharp sign) has the derivative 0.
        """
        return (self._difference(motion, "q"), self._difference(motion, "dq"), self._difference(motion, "ddq"))

    def _difference(self, motion: Motion, name: str) -> Array:
        value = getattr(motion, name)
        step = 1e-6 * np.maximum(1.0, np.abs(value))
        above, below = value + step, value - step
        rise = self.columns(replace(motion, **{name: above})) - self.columns(replace(motion, **{name: below}))
        return rise / (above - below)[..., None]


def no_slopes(motion: Motion, coefficients: int = 1) -> Array:
    """Return zeros for the derivatives of ``coefficients`` columns, shape (N, n, k)."""
    return np.zeros((*motion.dq.shape, coefficients))
