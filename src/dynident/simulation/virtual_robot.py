"""A log of a virtual robot from a trajectory, noise and rates: the virtual cell with an ideal drive."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from dynident.excitation.trajectories.base import Trajectory
from dynident.model.dynamic_model import DynamicModel
from dynident.simulation.cell import Cell, CellRun
from dynident.simulation.cell_simulation import simulate_cell
from dynident.simulation.controllers import CONTROLLERS, Controller
from dynident.simulation.effects import Effort, Encoder, Recorder


@dataclass(frozen=True)
class Noise:
    """Standard deviations of white noise, and the step of the encoders, one number or one per joint.

    Attributes:
        position: Of the encoders, in rad or m; the controller sees it too.
        velocity: Of the measured velocities, in rad/s or m/s. None: the log has no velocities, and the controller
            knows the true ones, as from a motor encoder far finer than the logged signal.
        torque: Of the measured motor torques, in N m or N, or of the currents, in A, where drive gains are given; only
            in the log.
        resolution: Step of the measured positions, in rad or m; 0 for none.
    """

    position: npt.ArrayLike = 0.0
    velocity: npt.ArrayLike | None = None
    torque: npt.ArrayLike = 0.0
    resolution: npt.ArrayLike = 0.0


@dataclass(frozen=True)
class Timing:
    """Length and rates of a simulated log.

    Attributes:
        duration: Length of the log in s; None for the trajectory's. Only periodic motions go on beyond theirs.
        rate: Samples of the log a second.
        lead_in: Length in s of a run-in from rest that joins position, velocity and acceleration of the start; it is
            simulated, not logged. 0 starts the plant on the trajectory.
        integration_rate: Steps a second, a multiple of both rates; None chooses.
    """

    duration: float | None = None
    rate: float = 1000.0
    lead_in: float = 2.0
    integration_rate: float | None = None


def simulate(
    model: DynamicModel,
    theta: npt.ArrayLike,
    trajectory: Trajectory,
    *,
    controller: Controller | None = None,
    noise: Noise | None = None,
    timing: Timing | None = None,
    gains: Mapping[str, float] | None = None,
    seed: int = 0,
) -> CellRun:
    """Return the log of a robot with the parameters theta (p,) of ``model`` that follows ``trajectory``.

    A virtual cell with noise and without other effects; torques are logged as the controller commands them, and drives
    stay at their first temperature. Other effects: :func:`~dynident.simulation.cell_simulation.simulate_cell`.

    Args:
        model: Robot, coupling, known rotor inertia and friction of the plant.
        theta: Its parameters, shape (p,).
        trajectory: The commanded motion.
        controller: The controller; None for the part ``pd``.
        noise: Measurement noise and resolution; None for none.
        timing: Length and rates; None for the default ones.
        gains: Drive gains by joint in N m/A (16); the log then has motor currents instead of joint torques.
        seed: Of the noise; position, velocity and torque draw from streams of their own.

    Raises:
        BadOption: An option out of range, a sharp sign of friction, or a friction part that cannot be simulated.
        NotConsistent: The mass matrix is not positive definite along the motion.
        SolverFailed: The motion diverged.
        UnknownChoice: A drive gain for a joint that is not there.
    """
    controller, noise, timing = controller or CONTROLLERS.make("pd"), noise or Noise(), timing or Timing()
    velocity = 0.0 if noise.velocity is None else noise.velocity
    cell = Cell(
        controller,
        Encoder(_numbers(noise.resolution), _numbers(noise.position), velocity_noise=_numbers(velocity)),
        effort=Effort(_numbers(noise.torque), held="after"),
        recorder=Recorder(timing.rate, velocities=noise.velocity is not None),
        lead_in=timing.lead_in,
        integration_rate=timing.integration_rate,
    )
    return simulate_cell(model, theta, trajectory, cell, duration=timing.duration, gains=gains, seed=seed)


def _numbers(values: npt.ArrayLike) -> tuple[float, ...]:
    return tuple(np.atleast_1d(np.array(values, dtype=np.float64)).tolist())
