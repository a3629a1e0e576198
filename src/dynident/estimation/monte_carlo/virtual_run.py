"""The one place where rehearsals and benchmarks ask the virtual robot for a log."""

from __future__ import annotations

from dataclasses import dataclass

import numpy.typing as npt

from dynident.arrays import Array
from dynident.experiment.simulation.virtual_robot import Controller, Noise, SimulatedRun, simulate
from dynident.experiment.trajectories.base import Trajectory
from dynident.model.dynamic_model import DynamicModel


@dataclass(frozen=True)
class Recording:
    """How a virtual robot records.

    Attributes:
        rate: Rows of the log a second, in Hz.
        control_rate: Ticks of the controller a second, in Hz.
        position_noise: Standard deviation of the encoders, in rad or m, one number or one per joint.
        torque_noise: Standard deviation of the measured motor torques, in N m or N, one number or one per joint.
        resolution: Step of the encoders, in rad or m, one number or one per joint; 0 for none.
        stiffness: Of the controller in N m/rad or N/m, one number per joint; None: of loops of 8 Hz.
        damping: Of the controller in N m s/rad or N s/m, one number per joint; None: critical.
        lead_in: Length in s of the run-in from rest, not recorded; 0 where the motion itself starts at rest.
    """

    rate: float = 1000.0
    control_rate: float = 1000.0
    position_noise: npt.ArrayLike = 2e-5
    torque_noise: npt.ArrayLike = 0.0
    resolution: npt.ArrayLike = 0.0
    stiffness: tuple[float, ...] | None = None
    damping: tuple[float, ...] | None = None
    lead_in: float = 0.0


def record(
    model: DynamicModel,
    theta: Array,
    motion: Trajectory,
    how: Recording,
    seed: int,
    duration: float | None = None,
) -> SimulatedRun:
    """Return what a robot with the parameters theta (p,) records along a motion.

    Args:
        model: Robot and friction of the plant.
        theta: Its parameters, shape (p,).
        motion: What its controller is told to follow.
        how: Rates, noise and encoders.
        seed: Of the noise.
        duration: Length of the log in s; None for that of the motion.

    Raises:
        BadOption: A rate or noise out of range, or friction that cannot be simulated.
        NotConsistent: The mass matrix is not positive definite along the motion.
        SolverFailed: The motion diverged.
    """
    return simulate(
        model,
        theta,
        motion,
        duration=duration,
        rate=how.rate,
        controller=Controller(rate=how.control_rate, stiffness=how.stiffness, damping=how.damping),
        noise=Noise(position=how.position_noise, torque=how.torque_noise),
        resolution=how.resolution,
        lead_in=how.lead_in,
        seed=seed,
    )
