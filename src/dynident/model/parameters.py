"""Parameters by name, and the conversions of the ten to the orders of other libraries."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from dynident.arrays import Array
from dynident.model.inertia import TEN
from dynident.model.robot import Robot

#: Unit of each of the ten parameters of a link.
TEN_UNITS = ("kg m^2",) * 6 + ("kg m",) * 3 + ("kg",)

# Positions in TEN of Pinocchio's `toDynamicParameters`: m, mx, my, mz, Ixx, Ixy, Iyy, Ixz, Iyz, Izz.
_PINOCCHIO = np.array([9, 6, 7, 8, 0, 1, 3, 2, 4, 5])
# Positions in TEN of the six of MuJoCo's `fullinertia`: xx, yy, zz, xy, xz, yz.
_MUJOCO = np.array([0, 3, 5, 1, 2, 4])

#: What a standard parameter describes: a link, the inertia of a rotor, or friction (offsets and couplings with it).
Kind = Literal["body", "rotor", "friction"]


@dataclass(frozen=True)
class Parameter:
    """One standard parameter.

    Attributes:
        symbol: Such as ``"Izz"`` or ``"Fc"``.
        owner: Link or joint that it belongs to.
        unit: Such as ``"kg m^2"``.
        kind: What it describes.
        nonnegative: Whether physics asks for a value >= ``least`` by itself (friction, rotor inertia).
        least: Less than 0 for a rotor of which the robot model states an inertia: the value is beside that one.
    """

    symbol: str
    owner: str
    unit: str
    kind: Kind = "body"
    nonnegative: bool = False
    least: float = 0.0

    @property
    def name(self) -> str:
        """Name as printed everywhere: ``Izz[link1]``."""
        return f"{self.symbol}[{self.owner}]"


def inertial_parameters(robot: Robot) -> tuple[Parameter, ...]:
    """Return the 10 l inertial parameters of a robot, link by link in the order of TEN."""
    return tuple(
        Parameter(symbol, link.name, unit) for link in robot.links for symbol, unit in zip(TEN, TEN_UNITS, strict=True)
    )


def to_pinocchio(theta: Array) -> Array:
    """Reorder ten parameters, shape (..., 10), to Pinocchio's m, mc, Ixx, Ixy, Iyy, Ixz, Iyz, Izz."""
    return np.asarray(theta)[..., _PINOCCHIO]


def from_pinocchio(theta: Array) -> Array:
    """Reorder ten parameters, shape (..., 10), from Pinocchio's order; the inverse of :func:`to_pinocchio`."""
    return np.asarray(theta)[..., np.argsort(_PINOCCHIO)]


def to_mujoco_fullinertia(theta: Array) -> Array:
    """Return the six rotational inertias, shape (..., 6), in MuJoCo's order xx, yy, zz, xy, xz, yz.

    The point and the axes are not changed; MuJoCo wants the inertia about the centre of mass.
    """
    return np.asarray(theta)[..., _MUJOCO]
