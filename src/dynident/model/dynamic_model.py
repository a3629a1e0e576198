"""The dynamic model: robot, drives and friction, linear in the standard parameters theta."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from dynident.arrays import Array
from dynident.errors import BadOption
from dynident.model.friction import FRICTION, Friction, Motion
from dynident.model.kernels import batched
from dynident.model.parameters import Parameter, inertial_parameters
from dynident.model.robot import Robot


@dataclass(frozen=True)
class DynamicModel:
    """tau = Y(q, dq, ddq) theta, equations (4) and (6): inertial columns, then the friction of each drive.

    Motor friction and rotor inertia act at motor speed: with motor speed C dq they give C' f(C dq) at the joints.
    The known rotor inertia of the drives is not a column; :meth:`known_torque` gives its torque.

    Attributes:
        robot: The robot.
        friction: Its friction parts; a name or a part each.

    Raises:
        UnknownChoice: No such friction part.
        BadOption: Two parts with the same coefficient.
    """

    robot: Robot
    friction: tuple[Friction, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "friction", tuple(FRICTION.make(part) for part in self.friction))
        symbols = [c.symbol for part in self.friction for c in part.coefficients]
        if len(set(symbols)) != len(symbols):
            twice = next(symbol for symbol in symbols if symbols.count(symbol) > 1)
            names = [FRICTION.name_of(part) for part in self.friction]
            raise BadOption("friction", names, f"the coefficient {twice} is there twice; keep one of its parts")

    @property
    def inertial_count(self) -> int:
        """Number of inertial standard parameters, 10 per link."""
        return 10 * len(self.robot.links)

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """The p standard parameters: ten per link, then all friction coefficients joint by joint."""
        friction = tuple(
            Parameter(c.symbol, joint.name, c.unit if joint.kind == "revolute" else c.linear_unit, c.nonnegative)
            for joint in self.robot.active
            for part in self.friction
            for c in part.coefficients
        )
        return inertial_parameters(self.robot) + friction

    @property
    def coefficients_per_joint(self) -> int:
        """Number of friction coefficients of one joint, k."""
        return sum(len(part.coefficients) for part in self.friction)

    def friction_values(self, motion: Motion) -> Array:
        """Return the value of every friction column at its own drive, shape (N, n, k)."""
        at_motors = motion.at_motors(np.asarray(self.robot.coupling)) if self.robot.is_coupled else motion
        blocks = [part.columns(at_motors) for part in self.friction]
        samples, joints = motion.dq.shape
        return np.concatenate(blocks, axis=-1) if blocks else np.zeros((samples, joints, 0))

    def regressor(self, motion: Motion) -> Array:
        """Return Y, shape (N, n, p)."""
        inertial = batched.torque_regressor(self.robot.chain, motion.q, motion.dq, motion.ddq)
        values = self.friction_values(motion)
        # Row i of the friction block of drive j is C[j, i] times the column's value at the drive.
        block = np.einsum("ji,sjk->sijk", np.asarray(self.robot.coupling), values)
        return np.concatenate([inertial, block.reshape(*inertial.shape[:2], -1)], axis=-1)

    def torque(self, motion: Motion, theta: Array) -> Array:
        """Return Y theta and the known rotor torque, shape (N, n), in N m or N."""
        inertial, friction = np.split(np.asarray(theta, dtype=float), [self.inertial_count])
        rigid = batched.inverse_dynamics(self.robot.chain, inertial, motion.q, motion.dq, motion.ddq)
        coefficients = friction.reshape(self.robot.dof, self.coefficients_per_joint)
        at_drives = np.einsum("sjk,jk->sj", self.friction_values(motion), coefficients)
        return rigid + at_drives @ np.asarray(self.robot.coupling) + self.known_torque(motion)

    def known_torque(self, motion: Motion) -> Array:
        """Return the torque of the known rotor inertias, which is compensated and not identified, shape (N, n)."""
        return motion.ddq @ self.robot.reflected_inertia

    def nominal(self) -> Array | None:
        """Return theta of the description, shape (p,), with its damping and friction; None where links lack inertias.

        Coefficients that the description does not state are zero.
        """
        inertial = self.robot.nominal
        if inertial is None:
            return None
        stated = {"Fv": "damping", "Fc": "friction"}
        joints = {joint.name: joint for joint in self.robot.active}
        tail = [
            getattr(joints[p.owner], stated[p.symbol]) or 0.0 if p.symbol in stated else 0.0
            for p in self.parameters[self.inertial_count :]
        ]
        return np.concatenate([inertial, tail])

    def random_motion(self, samples: int, seed: int = 0) -> Motion:
        """Return random states, limits left aside: any turn, +-1 m, 3 rad/s, 10 rad/s^2 (the rank is the same)."""
        generator = np.random.default_rng(seed)
        reach = np.array([np.pi if joint.kind == "revolute" else 1.0 for joint in self.robot.active])
        shape = (samples, self.robot.dof)
        q = reach * generator.uniform(-1, 1, shape)
        return Motion(q, generator.uniform(-3, 3, shape), generator.uniform(-10, 10, shape))
