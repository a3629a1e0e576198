"""What simulators hold of the drives, one number each: armature, damping, Coulomb friction; and what is left over.

Where friction has parts of another shape over speed or load, damping and Coulomb friction are those nearest to the
whole of it among states like those of the logs of the fit: a part that is merely left out takes its torque with it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from dynident.arrays import Array, BoolArray
from dynident.exports.models.subject.identified import Identified
from dynident.exports.models.subject.states import motion_of_fit
from dynident.model.friction import FRICTION, Friction, Motion, auto_friction
from dynident.model.kernels import batched

#: Share of the friction of a drive above which a part of another shape is one.
SAME = 1e-9

#: Parts that are springs, which a simulator may hold as such.
SPRINGS = ("spring", "balancer")


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
        held_as: What simulators hold it as, of drives that turn one joint: ``Coefficient.in_simulators``,
            ``spring``, or empty.
    """

    joint: str
    part: str
    symbol: str
    value: float
    unit: str
    options: Mapping[str, Any]
    held_as: str = ""

    def data(self) -> dict[str, Any]:
        """Return what stands in files and JSON."""
        return {each.name: getattr(self, each.name) for each in fields(self) if each.name != "held_as"}


@dataclass(frozen=True)
class Drives:
    """The drives of a robot as simulators have them, all at motor speed, C dq of the joints.

    Attributes:
        joints: Names of the n joints.
        coupling: C, shape (n, n).
        armature: Reflected rotor inertia, known and identified, shape (n,), in kg m^2 or kg.
        damping: Viscous friction, shape (n,), in N m s/rad or N s/m.
        dry: Coulomb friction, shape (n,), in N m or N.
        nearest: Which drives have damping and Coulomb friction nearest to a curve of another shape, shape (n,).
        has_friction: Whether the model of the estimate has friction on the drive, shape (n,).
        rest: What is left over.
        units: Of the torque of each joint, N m or N.
    """

    joints: tuple[str, ...]
    coupling: Array
    armature: Array
    damping: Array
    dry: Array
    nearest: BoolArray
    has_friction: BoolArray
    rest: tuple[Term, ...]
    units: tuple[str, ...]

    def term(self, j: int | np.intp, word: str, value: float) -> Term:
        """Return what a joint of simulators holds as ``armature`` or ``friction``."""
        unit = self.units[j] if word == "friction" else "kg m^2" if self.units[j] == "N m" else "kg"
        return simulated_term(self.joints[j], word, value, unit)

    @property
    def alone(self) -> BoolArray:
        """Whether a drive turns one joint only, shape (n,)."""
        return np.count_nonzero(self.coupling, axis=1) == 1

    def at_joints(self) -> tuple[Array, Array, Array]:
        """Return armature, damping and Coulomb friction of each joint from the drives that turn one joint only."""
        rows = self.coupling * self.alone[:, None]
        square = rows**2
        return self.armature @ square, self.damping @ square, self.dry @ np.abs(rows)

    def coupled_rest(self) -> tuple[Term, ...]:
        """Return what a format loses that has no drive for several joints."""
        lost = []
        for j in np.flatnonzero(~self.alone):
            for word, values in (("armature", self.armature), ("damping", self.damping), ("friction", self.dry)):
                if values[j]:
                    lost.append(simulated_term(self.joints[j], word, float(values[j]), "at the motor"))
        return tuple(lost)

    @property
    def springs(self) -> tuple[Term, ...]:
        """What is left over and is a spring with a length at rest, of drives that turn their own joint alone.

        A cylinder of constant force is none.
        """
        same = np.all(self.coupling == np.eye(len(self.joints)), axis=1)
        there = [term for term in self.rest if term.held_as == "spring" and same[self.joints.index(term.joint)]]
        stiff = {term.joint for term in there if term.symbol == "Kb" and term.unit == "N m" and term.value > 0.0}
        weak = {term.joint for term in there if term.symbol == "Fb" and term.value > 0.0}
        return tuple(term for term in there if term.part == "spring" or term.joint in stiff - weak)

    def spring_torque(self, motion: Motion) -> Array:
        """Return the torque of the springs at the joints, shape (N, n)."""
        found = np.zeros_like(motion.q)
        for term in self.springs:
            part, j = FRICTION.make(term.part, term.options), self.joints.index(term.joint)
            place = [one.symbol for one in part.coefficients].index(term.symbol)
            found[:, j] += term.value * part.columns(motion.of_drives([j]))[:, 0, place]
        return found

    def torque(self, motion: Motion, *, armature: bool, coupled: bool, dry: bool = True) -> Array:
        """Return the torque of armature, damping and Coulomb friction (sharp sign) at the joints, shape (N, n).

        Args:
            motion: The joints' motion.
            armature: Whether the rotors are in it.
            coupled: Whether drives that turn several joints are in it.
            dry: Whether Coulomb friction is in it.
        """
        rows = np.asarray(self.coupling) * (np.ones(len(self.joints)) if coupled else self.alone)[:, None]
        speed = motion.dq @ rows.T
        force = speed * self.damping + (np.sign(speed) * self.dry if dry else 0.0)
        return (force + (motion.ddq @ rows.T * self.armature if armature else 0.0)) @ rows


def simulated_term(joint: str, word: str, value: float, unit: str) -> Term:
    """Return what a joint of simulators holds as ``word``, called as the usual part of that meaning calls it."""
    coefficients = ((FRICTION.name_of(part), c) for part in auto_friction() for c in part.coefficients)
    part, symbol = next((name, c.symbol) for name, c in coefficients if c.in_simulators == word)
    return Term(joint, part, symbol, value, unit, {}, word)


def drives_of(subject: Identified) -> Drives:
    """Return the drives of an identified model."""
    model = subject.model
    robot = model.robot
    table = model.coefficient_table(subject.theta)
    size = robot.dof
    held = {word: np.zeros(size) for word in ("armature", "damping", "friction")}
    has_friction = np.zeros(size, dtype=bool)
    rest: list[Term] = []
    column = 0
    for part in model.friction:
        name, drives = FRICTION.name_of(part), model.drives_of(part)
        spring = "spring" if name in SPRINGS else ""
        has_friction[list(drives)] |= not all(part.is_inertia)
        own = table[:, column : column + len(part.coefficients)]
        column += len(part.coefficients)
        for j in drives:
            kept, left = part.in_simulators(own[j])
            for word, value in kept.items():
                held[word][j] += value
            units = {c.symbol: c.unit_of(robot.active[j].kind) for c in part.coefficients}
            rest += [
                Term(
                    robot.joint_names[j],
                    name,
                    symbol,
                    value,
                    units.get(symbol, robot.active[j].unit),
                    part.options,
                    spring,
                )
                for symbol, value in left.items()
                if value
            ]
    nearest, damping, dry = _nearest(subject, table)
    held["damping"] = np.where(nearest, damping, held["damping"])
    held["friction"] = np.where(nearest, dry, held["friction"])
    known = np.array([joint.drive.reflected_inertia for joint in robot.active])
    bias = [
        Term(joint.name, "drive", "bias", joint.drive.bias, joint.unit, {})
        for joint in robot.active
        if joint.drive.bias
    ]
    return Drives(
        robot.joint_names,
        np.asarray(robot.coupling),
        known + held["armature"],
        held["damping"],
        held["friction"],
        nearest,
        has_friction,
        (*rest, *bias),
        robot.units,
    )


def _nearest(subject: Identified, table: Array) -> tuple[BoolArray, Array, Array]:
    """Return which drives have friction of another shape, and the nearest damping and Coulomb friction, each (n,).

    Least squares, at least zero, of the part that turns its sign with the speed: constants and torques of the position
    alone are not in it. Friction that depends on a temperature, which no simulator has, is left aside.
    """
    from scipy.optimize import nnls  # slow to load

    model = subject.model
    counts, curved = [], []
    for part in model.friction:
        at_all = "temperature" not in part.needs
        split = type(part).in_simulators is not Friction.in_simulators  # it says itself what comes nearest
        for coefficient, *others in zip(part.coefficients, part.is_inertia, part.is_constant, strict=True):
            counts.append(at_all and not any(others))
            curved.append(counts[-1] and not split and not coefficient.in_simulators)
    if not table[:, curved].any():
        none = np.zeros(model.robot.dof)
        return none > 0, none, none
    motion = motion_of_fit(subject.estimate)
    both = (motion, replace(motion, dq=-motion.dq))
    forth, back = (model.friction_values(model.loaded(at, subject.theta)) * table for at in both)
    turning = 0.5 * (forth - back)
    size = np.sqrt(np.mean(turning**2, axis=0))
    nearest = np.any(size[:, curved] > SAME * size[:, counts].max(axis=1, keepdims=True), axis=1)
    speed, torque = motion.dq @ np.asarray(model.robot.coupling).T, turning[..., counts].sum(axis=2)
    two = [nnls(np.column_stack([v, np.sign(v)]), own)[0] for v, own in zip(speed.T, torque.T, strict=True)]
    damping, dry = np.array(two).T
    return nearest, damping, dry


def rigid_torque(subject: Identified, motion: Motion) -> Array:
    """Return the torque of the bodies alone, shape (N, n), in N m or N."""
    model = subject.model
    theta = subject.theta[: model.inertial_count]
    return batched.inverse_dynamics(model.robot.chain, theta, motion.q, motion.dq, motion.ddq)
