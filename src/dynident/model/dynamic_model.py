"""The dynamic model: robot, drives and friction, linear in the standard parameters theta."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, overload

import numpy as np
import numpy.typing as npt

from dynident.arrays import Array, IntArray, frozen
from dynident.errors import BadOption, check_kind
from dynident.methods import ModelMethods
from dynident.model.friction import FRICTION, Friction, Motion
from dynident.model.kernels import batched
from dynident.model.parameters import Parameter, inertial_parameters
from dynident.model.robot import Robot


@dataclass(frozen=True, repr=False)
class DynamicModel(ModelMethods):
    """tau = Y(q, dq, ddq) theta, equations (4) and (6): inertial columns, then the friction of each drive.

    Motor friction and rotor inertia act at motor speed: with motor speed C dq they give C' f(C dq) at the joints.
    The known rotor inertia and bias of the drives are no columns; :meth:`known_torque` gives their torque. Torque
    without friction, on which friction may depend, is that of all inertias: links and rotors, identified and known.

    Attributes:
        robot: The robot.
        friction: Its friction parts; a name or a part each.

    Raises:
        UnknownChoice: No such friction part.
        BadOption: Two parts with the same coefficient.
    """

    robot: Robot
    friction: tuple[Friction, ...] = ()

    if TYPE_CHECKING:

        def __init__(self, robot: Robot, friction: str | Sequence[Friction | str] = ()) -> None: ...

    def __post_init__(self) -> None:
        check_kind("robot", self.robot, Robot, 'di.DynamicModel(di.robot_of("arm.urdf"), ["coulomb", "viscous"])')
        parts = (self.friction,) if isinstance(self.friction, str) else self.friction
        object.__setattr__(self, "friction", tuple(FRICTION.make(part) for part in parts))
        self.robot.check_names(name for part in self.friction for name in part.joints or ())
        self._check_names()

    def _check_names(self) -> None:
        names = self.robot.joint_names
        owned = [
            (names[j], c.symbol) for part in self.friction for j in self.drives_of(part) for c in part.coefficients
        ]
        if len(set(owned)) != len(owned):
            joint, symbol = next(owner for owner in owned if owned.count(owner) > 1)
            parts = [FRICTION.name_of(part) for part in self.friction]
            on = "" if all(part.joints is None for part in self.friction) else f" on {joint}"
            raise BadOption("friction", parts, f"the coefficient {symbol} is there twice{on}; keep one of its parts")

    @property
    def inertial_count(self) -> int:
        """Number of inertial standard parameters, 10 per link."""
        return 10 * len(self.robot.links)

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """The p standard parameters: ten per link, then all friction coefficients joint by joint."""
        each = [pair for part in self.friction for pair in zip(part.coefficients, part.is_inertia, strict=True)]
        joints = self.robot.active
        friction = tuple(
            Parameter(
                c.symbol, joint.name, c.unit_of(joint.kind), "rotor", c.nonnegative, 0.0 - joint.drive.reflected_inertia
            )
            if inertia
            else Parameter(c.symbol, joint.name, c.unit_of(joint.kind), "friction", c.nonnegative)
            for joint, (c, inertia) in ((joints[j], each[k]) for j, k in zip(*self.terms, strict=True))
        )
        return inertial_parameters(self.robot) + friction

    @property
    def coefficients_per_joint(self) -> int:
        """Number of friction columns that a drive has at most, k: those of all parts."""
        return sum(len(part.coefficients) for part in self.friction)

    def drives_of(self, part: Friction) -> tuple[int, ...]:
        """Return the drives that a friction part acts on."""
        names = self.robot.joint_names
        return tuple(range(len(names))) if part.joints is None else tuple(names.index(name) for name in part.joints)

    @cached_property
    def terms(self) -> tuple[IntArray, IntArray]:
        """Drive, and column among the k of :meth:`friction_values`, of each friction coefficient in theta, (p - 10 l,).

        All k on every joint, joint by joint, where no part is for some joints only.
        """
        acts = [np.isin(np.arange(self.robot.dof), self.drives_of(part)) for part in self.friction]
        table = [row for row, part in zip(acts, self.friction, strict=True) for _ in part.coefficients]
        drive, column = np.nonzero(np.array(table, dtype=bool).reshape(-1, self.robot.dof).T)
        return drive.astype(np.int64), column.astype(np.int64)

    def coefficient_table(self, theta: Array) -> Array:
        """Return the friction coefficients in standard parameters (p,) by drive and column, (n, k); 0 where none is."""
        table = np.zeros((self.robot.dof, self.coefficients_per_joint))
        drive, column = self.terms
        table[drive, column] = frozen(theta, (self.inertial_count + len(drive),), "theta")[self.inertial_count :]
        return table

    @property
    def needs(self) -> frozenset[str]:
        """Signals beyond the motion that friction depends on: ``torque``, ``temperature``, ``state``."""
        return frozenset(name for part in self.friction for name in part.needs)

    @property
    def lags(self) -> bool:
        """Whether a part of the friction follows a reversal late, as a torque with a delay does."""
        return any(part.lags for part in self.friction)

    def friction_values(self, motion: Motion) -> Array:
        """Return the value of every friction column at its own drive, shape (N, n, k); 0 where a part does not act.

        Raises:
            BadOption: A part needs a torque, a temperature or a state that the motion has not.
        """
        return self._at_motors(motion, lambda part, at: (part.columns(at),))[0]

    def friction_slopes(self, motion: Motion) -> tuple[Array, Array, Array]:
        """Return the derivatives of :meth:`friction_values` by q, dq and ddq of the drive, each (N, n, k)."""
        by_q, by_dq, by_ddq = self._at_motors(motion, lambda part, at: part.derivatives(at), 3)
        return by_q, by_dq, by_ddq

    def _at_motors(
        self, motion: Motion, values: Callable[[Friction, Motion], tuple[Array, ...]], count: int = 1
    ) -> Sequence[Array]:
        """Return ``count`` arrays (N, n, k) of what each part has at the drives that it acts on."""
        at = motion.at_motors(np.asarray(self.robot.coupling)) if self.robot.is_coupled else motion
        shape = (self.coefficients_per_joint, motion.dq.shape[1], len(motion.dq))
        found = [np.zeros(shape).T for _ in range(count)]  # the samples of a column stand side by side
        start, first = 0, 0
        for part in self.friction:
            own = slice(start, start + len(part.coefficients))
            start = own.stop
            seen = at
            if part.states and at.state is not None:
                seen = replace(at, state=at.state[..., first : first + len(part.states)])
                first += len(part.states)
            if part.joints is None:  # all: no copy of the motion, and no list of names
                drives = slice(None)
            else:
                drives = list(self.drives_of(part))
                seen = seen.of_drives(drives)
            for block, value in zip(found, values(part, seen), strict=True):
                block[:, drives, own] = value
        return found

    def regressor(
        self,
        motion: Motion | npt.ArrayLike,
        dq: npt.ArrayLike | None = None,
        ddq: npt.ArrayLike | None = None,
        *,
        once: bool = False,
    ) -> Array:
        """Return Y, shape (N, n, p), or (n, p) of one state.

        Args:
            motion: A motion, or positions, shape (n,) or (N, n), in rad or m.
            dq: Velocities beside positions, of the same shape; None for zero.
            ddq: Accelerations beside positions, of the same shape; None for zero.
            once: See :func:`batched.torque_regressor`.

        Raises:
            BadArgument: A shape that does not fit, a value that is not finite, or positions in degrees.
            BadOption: A part needs a torque, a temperature or a state that the motion has not.
        """
        if not isinstance(motion, Motion):
            return self.at_states(self.regressor, motion, dq, ddq)
        inertial = batched.torque_regressor(self.robot.chain, motion.q, motion.dq, motion.ddq, once=once)
        drive, column = self.terms
        # Row i of the friction block of drive j is C[j, i] times the column's value at the drive.
        block = self.friction_values(motion)[:, None, drive, column] * np.asarray(self.robot.coupling)[drive].T
        return np.concatenate([inertial, block], axis=-1)

    @overload
    def torque(self, motion: Motion, theta: npt.ArrayLike, /) -> Array: ...
    @overload
    def torque(
        self,
        motion: npt.ArrayLike,
        dq: npt.ArrayLike | None = None,
        ddq: npt.ArrayLike | None = None,
        theta: npt.ArrayLike | None = None,
    ) -> Array: ...
    def torque(self, motion: Any, dq: Any = None, ddq: Any = None, theta: Any = None) -> Array:
        """Return Y theta and the known rotor torque, shape (N, n), in N m or N.

        Called as ``torque(motion, theta)``, or as ``torque(q, dq, ddq, theta)`` with arrays of one state (n,) or many
        (N, n); theta is then that of the robot model where it is not given. Where friction depends on the load and the
        motion does not state its torque, it is that of theta itself.

        Raises:
            BadArgument: A shape that does not fit, a value that is not finite, or a robot model without inertias.
        """
        if not isinstance(motion, Motion):
            return self.at_states(lambda states: self.torque(states, self.theta_or_nominal(theta)), motion, dq, ddq)
        theta = dq if theta is None else theta
        table = self.coefficient_table(theta)
        own, rigid = self._loaded(motion, theta)
        is_inertia = np.array([own for part in self.friction for own in part.is_inertia], dtype=bool)
        if not table[:, ~is_inertia].any():  # of bodies and rotors alone: no column of friction is made
            return rigid + self.rotor_torque(motion, table @ is_inertia) - self.robot.bias
        at_drives = np.einsum("sjk,jk->sj", self.friction_values(own), table)
        return rigid + at_drives @ np.asarray(self.robot.coupling) + self.known_torque(motion)

    def loaded(self, motion: Motion, theta: Array) -> Motion:
        """Return the motion with the torque of theta without friction, where friction asks for it and it has none."""
        return self._loaded(motion, theta)[0]

    def _loaded(self, motion: Motion, theta: Array) -> tuple[Motion, Array]:
        """Return also the torque of the rigid bodies, shape (N, n)."""
        inertial = np.asarray(theta, dtype=float)[: self.inertial_count]
        rigid = batched.inverse_dynamics(self.robot.chain, inertial, motion.q, motion.dq, motion.ddq)
        if "torque" not in self.needs or motion.torque is not None:
            return motion, rigid
        return replace(motion, torque=rigid + self.rotor_torque(motion, self.rotors(theta))), rigid

    def with_states(self, motion: Motion, step: float, first: Array | None = None) -> Motion:
        """Return samples that follow each other with the states of the friction parts, where any has some.

        Args:
            motion: The motion at the samples.
            step: Time from one sample to the next, in s.
            first: States at the first sample, shape (n, s); None for their start.
        """
        parts = [part for part in self.friction if part.states]
        if not parts:
            return motion
        at = motion.at_motors(np.asarray(self.robot.coupling)) if self.robot.is_coupled else motion
        ends = np.cumsum([len(part.states) for part in parts])[:-1]
        known = [None] * len(parts) if first is None else np.split(first, ends, axis=-1)
        found = [part.states_along(at, step, own) for part, own in zip(parts, known, strict=True)]
        return replace(motion, state=np.concatenate([own.transpose(2, 0, 1) for own in found]).transpose(1, 2, 0))

    def rotor_torque(self, motion: Motion, identified: Array) -> Array:
        """Return the torque of the rotors at the joints: known inertias and identified ones (n,), shape (N, n)."""
        coupling = np.asarray(self.robot.coupling)
        inertia = self.robot.reflected_inertia + (coupling.T * identified) @ coupling
        return motion.ddq @ inertia if inertia.any() else np.zeros(motion.ddq.shape)

    def rotors(self, theta: Array) -> Array:
        """Return the identified rotor inertia of each drive, shape (n,), in kg m^2 or kg; 0 where none is."""
        is_inertia = [own for part in self.friction for own in part.is_inertia]
        return self.coefficient_table(theta) @ np.array(is_inertia, dtype=float)

    def known_torque(self, motion: Motion) -> Array:
        """Return the torque of the known rotor inertias less the drives' bias, shape (N, n): not identified."""
        return motion.ddq @ self.robot.reflected_inertia - self.robot.bias

    def nominal(self) -> Array | None:
        """Return theta of the robot model, shape (p,), with its damping and friction; None where links lack inertias.

        Coefficients that the robot model does not state are zero.
        """
        inertial = self.robot.nominal
        if inertial is None:
            return None
        each = [c.in_simulators for part in self.friction for c in part.coefficients]
        tables = [{"damping": joint.damping, "friction": joint.friction} for joint in self.robot.active]
        tail = [tables[drive].get(each[column]) or 0.0 for drive, column in zip(*self.terms, strict=True)]
        return np.concatenate([inertial, tail])

    def random_motion(self, samples: int, seed: int = 0) -> Motion:
        """Return random states, limits left aside: any turn, +-1 m, 3 rad/s, 10 rad/s^2 (the rank is the same).

        Torques, temperatures and states are random as well where friction depends on them: no column follows from
        another.
        """
        generator = np.random.default_rng(seed)
        reach = np.array([np.pi if joint.kind == "revolute" else 1.0 for joint in self.robot.active])
        shape = (samples, self.robot.dof)
        q = reach * generator.uniform(-1, 1, shape)
        motion = Motion(q, generator.uniform(-3, 3, shape), generator.uniform(-10, 10, shape))
        torque = generator.normal(0.0, 10.0, shape) if "torque" in self.needs else None
        temperature = generator.uniform(10.0, 60.0, shape) if "temperature" in self.needs else None
        each = [state for part in self.friction for state in part.states]
        state = np.stack([generator.uniform(own.low, own.high, shape) for own in each], axis=-1) if each else None
        return replace(motion, torque=torque, temperature=temperature, state=state)
