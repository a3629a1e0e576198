"""What a friction part is: columns of the regressor that belong to one drive each."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any, ClassVar

import numpy as np

from dynident.arrays import Array, IntArray
from dynident.errors import BadOption


@dataclass(frozen=True)
class Motion:
    """What a friction column may see, at the drives (motor side where motors are coupled).

    Attributes:
        q: Positions, shape (N, n), in rad or m.
        dq: Velocities, shape (N, n), in rad/s or m/s.
        ddq: Accelerations, shape (N, n), in rad/s^2 or m/s^2.
        torque: Torque of the model without friction (rigid bodies and rotors), shape (N, n), in N m or N; None where
            not known.
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

    def of_drives(self, drives: Sequence[int] | IntArray) -> Motion:
        """Return the motion of some of the drives, in the order given."""
        chosen = np.asarray(drives, dtype=np.int64)
        torque = None if self.torque is None else self.torque[:, chosen]
        temperature = None if self.temperature is None else self.temperature[:, chosen]
        return Motion(self.q[:, chosen], self.dq[:, chosen], self.ddq[:, chosen], torque, temperature)

    def rows(self, part: slice | IntArray) -> Motion:
        """Return the motion of some of the samples."""
        torque = None if self.torque is None else self.torque[part]
        temperature = None if self.temperature is None else self.temperature[part]
        return Motion(self.q[part], self.dq[part], self.ddq[part], torque, temperature)


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


@dataclass(frozen=True)
class Range:
    """Where a field that enters the columns non-linearly is looked for, on a logarithmic scale.

    Attributes:
        low: Least value, above 0.
        high: Greatest value.
        is_speed: Whether it is a speed: then nothing beyond the fastest motion is tried.
    """

    low: float
    high: float
    is_speed: bool = False


#: What ``choose`` names where the logs decide whether a part is there at all.
WHOLE = "part"


@dataclass(frozen=True)
class Friction(ABC):
    """Torque of each drive that is linear in a few coefficients of its own: tau_j = sum_c x_jc f_c(motion)_j.

    A part is a frozen dataclass whose fields are its options.

    Attributes:
        joints: Joints that the part acts on; None for all.
        vary: Names of its non-linear fields whose values are to be found from the log; the stated ones are the start.
        choose: Names of such fields whose stated values stand unless held-out rows of the log ask for others; with
            ``part`` the part itself is only there if they ask for it.
    """

    coefficients: ClassVar[tuple[Coefficient, ...]]

    #: Fields that enter the columns non-linearly, and where a good value may be.
    ranges: ClassVar[dict[str, Range]] = {}

    #: Signals beyond the motion itself that the columns need: ``torque``, ``temperature``.
    needs: ClassVar[tuple[str, ...]] = ()

    joints: tuple[str, ...] | None = field(default=None, kw_only=True)
    vary: tuple[str, ...] | None = field(default=None, kw_only=True)
    choose: tuple[str, ...] | None = field(default=None, kw_only=True)

    @property
    def is_optional(self) -> bool:
        """Whether it is only there if held-out rows of the log ask for it."""
        return WHOLE in (self.choose or ())

    @property
    def options(self) -> dict[str, Any]:
        """Its own options by name: what its columns depend on, not for which joints it is or what the logs decide."""
        shared = {each.name for each in fields(Friction)}
        return {each.name: getattr(self, each.name) for each in fields(self) if each.name not in shared}

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


def check_positive(value: float, name: str, what: str) -> None:
    """Refuse an option that is not a finite number above 0; ``what`` says what is to be given instead.

    Raises:
        BadOption: It is not.
    """
    if not 0 < value < np.inf:
        raise BadOption(name, value, f"give {what} above 0")


def smooth_sign(dq: Array, width: float) -> tuple[Array, Array]:
    """Return tanh(dq / width) and its derivative by dq, both of the shape of dq; the sharp sign for a width of 0."""
    if width == 0:
        return np.sign(dq), np.zeros_like(dq)
    sign = np.tanh(dq / width)
    return sign, (1.0 - sign**2) / width


def signal(motion: Motion, name: str, part: str) -> Array:
    """Return the torque or temperature that a part needs, shape (N, n).

    Raises:
        BadOption: The motion has no such signal.
    """
    values = motion.torque if name == "torque" else motion.temperature
    if values is None:
        step = "the torque of the rigid bodies is not known here; leave the part out"
        if name == "temperature":
            step = "there are no temperatures here; map them (log: columns: temperature), or leave the part out"
        raise BadOption("friction", part, step)
    return values
