"""The plant of a virtual cell: a robot with numbers, payload and tilt as the tables of the compiled loop."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from dynident.arrays import Array
from dynident.errors import BadOption, UnknownChoice
from dynident.model.dynamic_model import DynamicModel
from dynident.model.inertia import Inertia
from dynident.model.joint import rotation_about
from dynident.model.kernels import batched
from dynident.model.kernels.generic import pack
from dynident.model.robot import Robot
from dynident.simulation.cell import Cell
from dynident.simulation.drive_friction import DriveFriction, drive_friction
from dynident.simulation.effects import Payload, Tilt, each
from dynident.simulation.plant import OVERSHOOT, Plant, plain

#: Steps a period of the fastest oscillation: RK4 then loses 1e-6 of its energy in a few thousand periods.
STEPS_A_PERIOD = 30.0


@dataclass(frozen=True)
class CellPlant:
    """A robot in its cell with numbers for everything.

    Attributes:
        model: The model, on a base as tilted as it really is.
        theta: All its parameters, payload included, shape (p,).
        friction: Of the drives.
        waves: Sines of the position of the ripple, shape (w, 4): drive, cycles, factors of sine and cosine.
        bristles: Stiffness and damping of the bristles, shape (2, n); (0, n) for smooth signs.
        stiction: Share and speed.
        springs: Stiffness, damping and rotor inertia, shape (3, n), or (0, n) for stiff joints.
        heat: Rise in the end, its decay in 1/s, and 1 where friction depends on temperature, shape (3, n).
        start: First temperature of the drives, shape (n,), in degrees Celsius.
    """

    model: DynamicModel
    theta: Array
    friction: DriveFriction
    waves: Array
    bristles: Array
    stiction: tuple[float, float]
    springs: Array
    heat: Array
    start: Array

    @property
    def robot(self) -> Robot:
        """The robot."""
        return self.model.robot

    @property
    def joints(self) -> int:
        """Number of joints, n."""
        return self.robot.dof

    @property
    def coupling(self) -> Array:
        """Motor speed = coupling @ joint speed, shape (n, n)."""
        return np.array(self.robot.coupling)

    @property
    def is_elastic(self) -> bool:
        """Whether there are springs between motors and joints."""
        return len(self.springs) > 0

    @property
    def armature(self) -> Array:
        """Inertia of all rotors at the joints, shape (n, n), in kg m^2 or kg."""
        return armature(self.model, self.theta)

    @property
    def inertial(self) -> Array:
        """Inertial parameters, shape (10 l,)."""
        return self.theta[: self.model.inertial_count]

    def masses(self, q: Array) -> Array:
        """Return the mass matrices with the rotors at the positions (N, n), shape (N, n, n).

        Raises:
            NotConsistent: One is not positive definite.
        """
        return Plant(self.robot, self.inertial, self.armature, self.friction).masses(q)

    def loop_tables(self) -> tuple[tuple[Any, ...], tuple[Any, ...]]:
        """Return the bodies and the drives of the compiled loop; see cell_loop.py."""
        carried = np.zeros_like(self.armature) if self.is_elastic else self.armature
        coupling = self.coupling
        bias = self.robot.bias
        beside = np.array([bias, np.linalg.solve(coupling.T, bias)])
        numbers = (self.inertial, carried, beside, coupling, np.linalg.inv(coupling))
        bodies = (*(np.array(one) for one in pack(self.robot.chain)), *map(plain, numbers))
        own = (self.waves, self.bristles, np.array(self.stiction), self.springs, self.heat, self.start)
        return bodies, (self.friction.machine(), self.friction.machine(dry=True), *map(plain, own))

    def greatest_speed(self, dq: Array) -> Array:
        """Return the speeds of the drives, shape (n,), up to which friction is looked at, for commanded dq (N, n)."""
        return OVERSHOOT * np.max(np.abs(dq @ self.coupling.T), axis=0) + 0.1

    def fastest(self, masses: Array, q: Array, dq: Array) -> float:
        """Return the fastest rate in 1/s at which friction, bristles or springs act, in steps as friction needs them.

        Args:
            masses: Mass matrices with the rotors along the motion, shape (N, n, n).
            q: Its commanded positions, shape (N, n).
            dq: Its commanded velocities, shape (N, n).
        """
        speed, at = self.greatest_speed(dq), q @ self.coupling.T
        stiffness, damping = self.bristles if len(self.bristles) else np.zeros((2, self.joints))
        damping, slip = damping + self.friction.steepest(at, speed), 0.0
        if np.any(stiffness > 0):
            level = np.maximum(self.friction.least_dry(at, speed), 1e-12)
            level = np.where(stiffness > 0, level, np.inf)
            slip = float(np.max(speed * stiffness / level))
        if not self.is_elastic:
            found = [_pull(masses, self.coupling, damping), slip]
            return max(*found, _swing(masses, self.coupling, stiffness))
        rotor, stiff, damped = self.springs[2], self.springs[0], self.springs[1]
        light = masses - self.armature
        at_rotor = float(np.max(np.sqrt((stiff + stiffness) / rotor))) * STEPS_A_PERIOD / (2.0 * np.pi)
        turn = float(np.hypot(at_rotor, _swing(light, self.coupling, stiff)))
        return max(slip, float(np.max((damping + damped) / rotor)) + _pull(light, self.coupling, damped), turn)


def cell_plant(model: DynamicModel, theta: npt.ArrayLike, cell: Cell) -> CellPlant:
    """Return the plant of a cell.

    Args:
        model: Robot and friction.
        theta: All its parameters but for the payload, shape (p,).
        cell: The cell.

    Raises:
        BadOption: theta of another length or not finite, an option out of range, a friction part that cannot be
            simulated, or springs beside a motor without rotor inertia.
        UnknownChoice: A payload on a link that is not there.
    """
    values = np.array(theta, dtype=np.float64)
    if values.shape != (len(model.parameters),):
        raise BadOption("theta", f"of shape {values.shape}", f"the model has {len(model.parameters)} parameters")
    if not np.all(np.isfinite(values)):
        bad = model.parameters[int(np.argmin(np.isfinite(values)))]
        raise BadOption("theta", f"{bad.symbol} of {bad.owner} not finite", "give finite numbers")
    model = replace(model, robot=model.robot.with_gravity(_turn(cell.tilt).T @ np.array(model.robot.gravity)))
    values = _loaded(model, values, cell.payload)
    n, warming = model.robot.dof, cell.warming
    start, end = (each(f"warming.{name}", getattr(warming, name), n) for name in ("start", "end"))
    soft = cell.bristles.presliding > 0
    remedy = "give it a width, such as 0.01 rad/s, or the cell bristles"
    friction = drive_friction(model, values, start, warming.per_kelvin, soft, remedy)
    depends = 1.0 if friction.reads & {"temperature", "rise"} else 0.0
    heat = np.array([end - start, np.full(n, 1.0 / warming.time_constant), np.full(n, depends)])
    bent = np.zeros((2 if soft else 0, n))
    own = armature(model, values)
    if soft:
        bent[0] = friction.breakaway() / cell.bristles.presliding
        inertia = np.maximum(np.diagonal(np.linalg.inv(np.array(model.robot.coupling)).T @ own), 0.0)
        bent[1] = 2.0 * cell.bristles.damping * np.sqrt(bent[0] * (inertia + _least_inertia(model, values)))
    stiction = (cell.bristles.stiction, cell.bristles.velocity)
    springs = _springs(cell, model, model.rotors(values))
    return CellPlant(model, values, friction, _ripple(cell, n), bent, stiction, springs, heat, start)


def armature(model: DynamicModel, theta: Array) -> Array:
    """Return the inertia of the rotors at the joints, known and of theta (p,), shape (n, n), in kg m^2 or kg."""
    coupling = np.asarray(model.robot.coupling)
    return coupling.T @ np.diag(model.rotors(theta)) @ coupling + model.robot.reflected_inertia


def _turn(tilt: Tilt) -> Array:
    """Return the orientation of the real base in that of the robot model, shape (3, 3)."""
    return rotation_about([1.0, 0.0, 0.0], tilt.roll) @ rotation_about([0.0, 1.0, 0.0], tilt.pitch)


def _loaded(model: DynamicModel, theta: Array, payload: Payload) -> Array:
    """Return the parameters with the payload on its link."""
    names = [link.name for link in model.robot.links]
    if payload.link and payload.link not in names:
        raise UnknownChoice("link", payload.link, names)
    at = 10 * (names.index(payload.link) if payload.link else len(names) - 1)
    body = Inertia.from_centre_of_mass(payload.mass, payload.centre, np.diag(payload.inertia))
    found = theta.copy()
    found[at : at + 10] += body.vector
    return found


def _least_inertia(model: DynamicModel, theta: Array) -> Array:
    """Return the least inertia of the bodies at each joint over random poses, shape (n,), in kg m^2 or kg."""
    found = batched.mass_matrix(model.robot.chain, theta[: model.inertial_count], model.random_motion(50).q)
    return np.maximum(np.min(np.diagonal(found, axis1=1, axis2=2), axis=0), 0.0)


def _ripple(cell: Cell, joints: int) -> Array:
    """Return the sines of the ripple, shape (w, 4)."""
    ripple = cell.ripple
    size, cycles, phase = (
        each(f"ripple.{name}", getattr(ripple, name), joints) for name in ("amplitude", "cycles", "phase")
    )
    rows: Sequence[Sequence[float]] = [
        (float(j), cycles[j], size[j] * np.cos(phase[j]), size[j] * np.sin(phase[j]))
        for j in range(joints)
        if size[j] > 0
    ]
    return np.array(rows).reshape(-1, 4)


def _springs(cell: Cell, model: DynamicModel, rotors: Array) -> Array:
    """Return stiffness, damping and rotor inertia of elastic joints, shape (3, n) or (0, n)."""
    n = model.robot.dof
    stiffness, damping = (each(f"elasticity.{name}", getattr(cell.elasticity, name), n) for name in _SPRING)
    if not np.any(stiffness > 0):
        return np.zeros((0, n))
    rotor = np.array([joint.drive.reflected_inertia for joint in model.robot.active]) + rotors
    for name, one, inertia in zip(model.robot.joint_names, stiffness, rotor, strict=True):
        if not one > 0:
            step = f"{name} has none beside elastic joints; give it one, such as 1e5"
            raise BadOption("elasticity.stiffness", cell.elasticity.stiffness, step)
        if not inertia > 0:
            step = f"the motor of {name} has no inertia; state rotor_inertia under drives, or the friction part with it"
            raise BadOption("elasticity.stiffness", cell.elasticity.stiffness, step)
    return np.array([stiffness, damping, rotor])


_SPRING = ("stiffness", "damping")


def _pull(masses: Array, coupling: Array, damping: Array) -> float:
    """Return the fastest decay in 1/s of damping at the drives (n,) over mass matrices (N, n, n)."""
    at_joints = coupling.T @ np.diag(damping) @ coupling
    return float(np.max(np.abs(np.linalg.eigvals(np.linalg.solve(masses, at_joints)))))


def _swing(masses: Array, coupling: Array, stiffness: Array) -> float:
    """Return the steps a second that the fastest oscillation of springs at the drives (n,) asks for."""
    return float(np.sqrt(_pull(masses, coupling, stiffness))) * STEPS_A_PERIOD / (2.0 * np.pi)
