"""The robot as a simulation sees it: tables for the compiled loop, the clock, and what cannot be simulated."""

from __future__ import annotations

import importlib
import math
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any

import numpy as np
import numpy.typing as npt

from dynident.arrays import Array
from dynident.errors import BadOption, NotConsistent
from dynident.model.dynamic_model import DynamicModel
from dynident.model.kernels import batched
from dynident.model.robot import Robot
from dynident.simulation.drive_friction import DriveFriction, drive_friction

#: The step of the integration times the fastest decay of the friction stays below this; RK4 is stable up to 2.78.
FRICTION_STEP = 1.0

#: Steps a second: at least chosen, and at most chosen or accepted.
MIN_RATE, MAX_RATE = 1e3, 1e6

#: Speeds that friction is looked at are up to this many times those of the commanded motion.
OVERSHOOT = 1.5

#: Rows that one simulation gives at most.
MAX_ROWS = 1e8


@dataclass(frozen=True)
class Clock:
    """Ticks of one simulation.

    Attributes:
        rate: Steps of the integration a second.
        per_control: Ticks from one control to the next.
        per_row: Ticks from one sample of the log to the next.
        first: Tick of the first row; time 0.
        rows: Samples of the log, N.
    """

    rate: float
    per_control: int
    per_row: int
    first: int
    rows: int

    @property
    def per_noise(self) -> int:
        """Ticks from one measurement to the next, of the controller or the log."""
        return math.gcd(self.per_control, self.per_row)

    @property
    def last(self) -> int:
        """Tick of the last row."""
        return self.first + (self.rows - 1) * self.per_row

    @property
    def control_times(self) -> Array:
        """Times of the controls in s; 0 is the first row."""
        return (np.arange(0, self.last + 1, self.per_control) - self.first) / self.rate

    @property
    def row_times(self) -> Array:
        """Times of the rows in s, shape (N,)."""
        return np.arange(self.rows) / (self.rate / self.per_row)

    @property
    def measurements(self) -> int:
        """Number of measurements of the controller and the log together."""
        return self.last // self.per_noise + 1


def clock(
    row_rate: float, control_rate: float, rate: float | None, decay: float, lead_in: float, length: float
) -> Clock:
    """Return the ticks for the rates in Hz; an integration rate that is not given is chosen.

    Args:
        row_rate: Samples of the log a second.
        control_rate: Controls a second.
        rate: Steps of the integration a second; None for the lowest of at least 1 kHz that fits.
        decay: Fastest decay of the friction, in 1/s.
        lead_in: Time before the first row, in s; rounded up to whole controls.
        length: Length of the log, in s; its end is not a row.

    Raises:
        BadOption: A rate that is not positive, that does not divide the integration's, or that is too low or high.
    """
    if not (0 < length < np.inf and 2 <= length * row_rate < MAX_ROWS):
        raise BadOption("duration", length, f"give seconds for 2 to {MAX_ROWS:g} rows at {row_rate:g} Hz")
    for name, value in (("rate", row_rate), ("controller.rate", control_rate), ("integration_rate", rate or 1.0)):
        if not 0 < value <= MAX_RATE:
            raise BadOption(name, value, f"give a rate in Hz, above 0, at most {MAX_RATE:g}")
    ours, theirs = (Fraction(value).limit_denominator(10_000) for value in (row_rate, control_rate))
    common = Fraction(math.lcm(ours.numerator, theirs.numerator), math.gcd(ours.denominator, theirs.denominator))
    needed = decay / FRICTION_STEP
    if rate is None:
        rate = float(common) * max(1, math.ceil(max(MIN_RATE, needed) / float(common)))
        if rate > MAX_RATE:
            if needed <= MAX_RATE:
                step = f"the log's and the controller's {control_rate:g} Hz fit no common step; choose another rate"
                raise BadOption("rate", row_rate, step)
            step = f"friction turns within {1 / needed:.2g} s there; give the Coulomb part a greater width"
            raise BadOption("width", "of Coulomb friction", step)
    elif rate < needed:
        step = f"the friction needs {needed:.4g} Hz or more; give that, or a greater Coulomb width"
        raise BadOption("integration_rate", rate, step)
    per_row, per_control = rate / row_rate, rate / control_rate
    if max(abs(per - round(per)) / per for per in (per_row, per_control)) > 1e-9:
        step = f"give a multiple of {float(common):g} Hz, which {row_rate:g} and {control_rate:g} Hz divide"
        raise BadOption("integration_rate", rate, step)
    per_control = round(per_control)
    first = math.ceil(lead_in * rate / per_control - 1e-9) * per_control
    return Clock(rate, per_control, round(per_row), first, round(length * row_rate))


def plain(values: npt.ArrayLike) -> Array:
    """Return a writable, contiguous copy: the one kind of array that the loops are compiled for."""
    return np.array(values, dtype=np.float64, order="C")


@dataclass(frozen=True)
class Plant:
    """A robot with numbers for all its parameters.

    Attributes:
        robot: The robot.
        inertial: Its inertial parameters, shape (10 l,).
        armature: Rotor inertia at the joints, known and identified, shape (n, n), in kg m^2 or kg.
        friction: Of the drives.
    """

    robot: Robot
    inertial: Array
    armature: Array
    friction: DriveFriction

    @property
    def coupling(self) -> Array:
        """Motor speed = coupling @ joint speed, shape (n, n)."""
        return np.array(self.robot.coupling)

    def tables(self, slopes: bool = False) -> tuple[Any, ...]:
        """Return the arrays of the compiled loops; see ``Plant`` in tracking_loop.py.

        Args:
            slopes: Whether the slope of the friction over speed is asked for.
        """
        chain = importlib.import_module("dynident.model.kernels.generic").pack(self.robot.chain)
        numbers = (self.inertial, self.armature, self.coupling, np.linalg.inv(self.coupling), self.robot.bias)
        return (*map(np.array, chain), *map(plain, numbers), self.friction.machine(slopes))

    @property
    def joints(self) -> int:
        """Number of joints, n."""
        return self.robot.dof

    def masses(self, q: Array) -> Array:
        """Return the mass matrices with the rotors at the positions (N, n), shape (N, n, n).

        Raises:
            NotConsistent: One is not positive definite.
        """
        found = batched.mass_matrix(self.robot.chain, self.inertial, q) + self.armature
        lowest = np.linalg.eigvalsh(found)[:, 0]
        if not np.all(lowest > 0):
            worst = int(np.argmin(lowest))
            evidence = f"its mass matrix has the eigenvalue {lowest[worst]:.4g} at q = {np.round(q[worst], 3).tolist()}"
            step = "simulate physically consistent parameters"
            raise NotConsistent(f"robot '{self.robot.name}'", evidence, step)
        return found

    def gravity(self, q: Array) -> Array:
        """Return the gravity torques at the positions (N, n), shape (N, n), in N m or N."""
        rest = np.zeros_like(q)
        return batched.inverse_dynamics(self.robot.chain, self.inertial, q, rest, rest)

    def fastest_decay(self, masses: Array, q: Array, dq: Array) -> float:
        """Return the fastest rate in 1/s at which friction stops a motion.

        Args:
            masses: Mass matrices along the motion, shape (K, n, n).
            q: Its commanded positions, shape (N, n).
            dq: Its commanded velocities, shape (N, n).
        """
        fastest = OVERSHOOT * np.max(np.abs(dq @ self.coupling.T), axis=0) + 0.1
        slope = self.friction.steepest(q @ self.coupling.T, fastest)
        at_joints = self.coupling.T @ np.diag(slope) @ self.coupling
        return float(np.max(np.abs(np.linalg.eigvals(np.linalg.solve(masses, at_joints)))))


def plant(model: DynamicModel, theta: npt.ArrayLike, is_moved: bool = True) -> Plant:
    """Return the plant of a model.

    Args:
        model: Robot and friction.
        theta: All its parameters, shape (p,).
        is_moved: Whether it is to be integrated. For masses and gravity alone friction of any kind is left out.

    Raises:
        BadOption: theta of another length or not finite, or a friction part that cannot be simulated.
    """
    values = np.array(theta, dtype=np.float64)
    if values.shape != (len(model.parameters),):
        raise BadOption("theta", f"of shape {values.shape}", f"the model has {len(model.parameters)} parameters")
    if not np.all(np.isfinite(values)):
        bad = model.parameters[int(np.argmin(np.isfinite(values)))]
        raise BadOption("theta", f"{bad.symbol} of {bad.owner} not finite", "give finite numbers")
    coupling = np.asarray(model.robot.coupling)
    rotors = coupling.T @ np.diag(model.rotors(values)) @ coupling + model.robot.reflected_inertia
    moved = model if is_moved else replace(model, friction=())
    known = values if is_moved else values[: model.inertial_count]
    return Plant(model.robot, values[: model.inertial_count], rotors, drive_friction(moved, known))
