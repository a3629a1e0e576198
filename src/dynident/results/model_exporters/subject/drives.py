"""What simulators hold of the drives, one number each: armature, damping, dry friction; and what is left over."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from dynident.arrays import Array, BoolArray
from dynident.model.friction import FRICTION, Friction, Motion
from dynident.model.kernels import batched
from dynident.results.model_exporters.subject.identified import Identified

#: Coefficients that a simulator's joint holds, by friction part and symbol.
DAMPING, DRY, ARMATURE = ("viscous", "Fv"), ("coulomb", "Fc"), ("rotor_inertia", "Ia")

#: Of friction with two levels the mean is dry friction; half their difference is left over.
TWO_LEVELS = ("asymmetric", "Fc+", "Fc-")


@dataclass(frozen=True)
class Term:
    """One coefficient of a drive that a joint of a simulator cannot hold.

    Attributes:
        joint: The drive's joint.
        part: Friction part, or ``drive`` for a known bias.
        symbol: Such as ``F0``.
        value: Its value.
        unit: Its unit.
        options: Options of the part.
    """

    joint: str
    part: str
    symbol: str
    value: float
    unit: str
    options: Mapping[str, Any]


@dataclass(frozen=True)
class Drives:
    """The drives of a robot as simulators have them, all at motor speed, C dq of the joints.

    Attributes:
        joints: Names of the n joints.
        coupling: C, shape (n, n).
        armature: Reflected rotor inertia, known and identified, shape (n,), in kg m^2 or kg.
        damping: Viscous friction, shape (n,), in N m s/rad or N s/m.
        dry: Coulomb friction, shape (n,), in N m or N.
        has_friction: Whether the model of the estimate has friction on the drive, shape (n,).
        rest: What is left over.
    """

    joints: tuple[str, ...]
    coupling: Array
    armature: Array
    damping: Array
    dry: Array
    has_friction: BoolArray
    rest: tuple[Term, ...]

    @property
    def alone(self) -> BoolArray:
        """Whether a drive turns one joint only, shape (n,)."""
        return np.count_nonzero(self.coupling, axis=1) == 1

    def at_joints(self) -> tuple[Array, Array, Array]:
        """Return armature, damping and dry friction of each joint from the drives that turn one joint only."""
        rows = self.coupling * self.alone[:, None]
        square = rows**2
        return self.armature @ square, self.damping @ square, self.dry @ np.abs(rows)

    def coupled_rest(self) -> tuple[Term, ...]:
        """Return what a format loses that has no drive for several joints."""
        lost = []
        for j in np.flatnonzero(~self.alone):
            values = (("Ia", self.armature[j], "rotor_inertia"), ("Fv", self.damping[j], "viscous"))
            for symbol, value, part in (*values, ("Fc", self.dry[j], "coulomb")):
                if value:
                    lost.append(Term(self.joints[j], part, symbol, float(value), "at the motor", {}))
        return tuple(lost)

    def torque(self, motion: Motion, *, armature: bool, coupled: bool, dry: bool = True) -> Array:
        """Return the torque of armature, damping and dry friction (sharp sign) at the joints, shape (N, n).

        Args:
            motion: The joints' motion.
            armature: Whether the rotors are in it.
            coupled: Whether drives that turn several joints are in it.
            dry: Whether dry friction is in it.
        """
        rows = np.asarray(self.coupling) * (np.ones(len(self.joints)) if coupled else self.alone)[:, None]
        speed = motion.dq @ rows.T
        force = speed * self.damping + (np.sign(speed) * self.dry if dry else 0.0)
        return (force + (motion.ddq @ rows.T * self.armature if armature else 0.0)) @ rows


def drives_of(subject: Identified) -> Drives:
    """Return the drives of an identified model."""
    model = subject.model
    robot = model.robot
    table = model.coefficient_table(subject.theta)
    size = robot.dof
    held = {key: np.zeros(size) for key in (DAMPING, DRY, ARMATURE)}
    has_friction = np.zeros(size, dtype=bool)
    rest: list[Term] = []
    column = 0
    for part in model.friction:
        name, drives = FRICTION.name_of(part), model.drives_of(part)
        has_friction[list(drives)] |= name != "rotor_inertia"
        for coefficient in part.coefficients:
            values = table[:, column]
            column += 1
            if (name, coefficient.symbol) in held:
                held[name, coefficient.symbol] += values
            elif name == TWO_LEVELS[0]:
                held[DRY] += 0.5 * values
        for j in drives:
            rest += _left(part, name, table[j, column - len(part.coefficients) : column], robot.active[j])
    known = np.array([joint.drive.reflected_inertia for joint in robot.active])
    bias = [
        Term(joint.name, "drive", "bias", joint.drive.bias, joint.unit, {})
        for joint in robot.active
        if joint.drive.bias
    ]
    return Drives(
        robot.joint_names,
        np.asarray(robot.coupling),
        known + held[ARMATURE],
        held[DAMPING],
        held[DRY],
        has_friction,
        (*rest, *bias),
    )


def _left(part: Friction, name: str, values: Array, joint: Any) -> list[Term]:
    """Return the terms of one part at one drive that a simulator cannot hold."""
    revolute = joint.kind == "revolute"
    options = part.options
    if name == TWO_LEVELS[0]:
        half = 0.5 * float(values[0] - values[1])
        return [Term(joint.name, name, "(Fc+ - Fc-)/2", half, joint.unit, options)] if half else []
    return [
        Term(joint.name, name, c.symbol, float(value), c.unit if revolute else c.linear_unit, options)
        for c, value in zip(part.coefficients, values, strict=True)
        if (name, c.symbol) not in (DAMPING, DRY, ARMATURE) and value
    ]


def rigid_torque(subject: Identified, motion: Motion) -> Array:
    """Return the torque of the bodies alone, shape (N, n), in N m or N."""
    model = subject.model
    theta = subject.theta[: model.inertial_count]
    return batched.inverse_dynamics(model.robot.chain, theta, motion.q, motion.dq, motion.ddq)
