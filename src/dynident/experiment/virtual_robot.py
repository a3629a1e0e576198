"""A log from a model, a controller and a trajectory, with the effects of a real cell."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from dynident.arrays import Array
from dynident.errors import BadOption, UnknownChoice
from dynident.experiment.log import Log, Source
from dynident.experiment.plant import Plant, clock, plant
from dynident.experiment.trajectories.base import Trajectory
from dynident.experiment.trajectories.quintic import Quintic
from dynident.model.dynamic_model import DynamicModel
from dynident.model.robot import Robot

#: States along the motion at which the mass matrix is looked at.
LOOKS = 200


@dataclass(frozen=True)
class Noise:
    """Standard deviations of white noise, one number or one per joint.

    Attributes:
        position: Of the encoders, in rad or m; the controller sees it too.
        velocity: Of the measured velocities, in rad/s or m/s. None: the log has no velocities, and the controller
            knows the true ones, as from a motor encoder far finer than the logged signal.
        torque: Of the measured motor torques, in N m or N; only in the log.
    """

    position: npt.ArrayLike = 0.0
    velocity: npt.ArrayLike | None = None
    torque: npt.ArrayLike = 0.0


@dataclass(frozen=True)
class Controller:
    """A proportional-derivative controller at each joint, its output held between its ticks.

    Attributes:
        rate: Ticks a second, in Hz.
        bandwidth_hz: Natural frequency w of the loops in Hz: stiffness M_ii w^2 and damping 2 damping_ratio M_ii w,
            with the diagonal of the mass matrix at the start.
        damping_ratio: Damping ratio of the loops.
        gravity: Whether the gravity torque at the commanded position is fed forward; the rest is feedback.
        stiffness: In N m/rad or N/m, one number or one per joint; None: from the bandwidth.
        damping: In N m s/rad or N s/m, one number or one per joint; None: from the bandwidth.
    """

    rate: float = 1000.0
    bandwidth_hz: float = 4.0
    damping_ratio: float = 1.0
    gravity: bool = True
    stiffness: npt.ArrayLike | None = None
    damping: npt.ArrayLike | None = None


@dataclass(frozen=True)
class SimulatedRun:
    """What a virtual robot recorded, and what was true.

    Attributes:
        log: The measured signals: q, dq where velocities are measured, torque or current.
        truth: q, dq, ddq of the plant and the torque at its joints, at the same times. The torque is constant between
            two ticks of the controller; a row that falls on a tick has the torque that begins there.
        saturated: How many torques of the logged part were cut at the joints' effort limits.
    """

    log: Log
    truth: Log
    saturated: int


def simulate(
    model: DynamicModel,
    theta: npt.ArrayLike,
    trajectory: Trajectory,
    *,
    duration: float | None = None,
    rate: float = 1000.0,
    controller: Controller = Controller(),  # noqa: B008 - a frozen value
    noise: Noise = Noise(),  # noqa: B008
    resolution: npt.ArrayLike = 0.0,
    gains: Mapping[str, float] | None = None,
    lead_in: float = 2.0,
    integration_rate: float | None = None,
    seed: int = 0,
) -> SimulatedRun:
    """Return the log of a robot with the parameters theta (p,) of ``model`` that follows ``trajectory``.

    Integrated by the classical Runge-Kutta rule; torques stop at the joints' effort limits.

    Args:
        model: Robot, coupling, known rotor inertia and friction of the plant.
        theta: Its parameters, shape (p,).
        trajectory: The commanded motion.
        duration: Length of the log in s; None for the trajectory's. Only periodic motions go on beyond theirs.
        rate: Rows of the log a second.
        controller: The controller.
        noise: Measurement noise.
        resolution: Step of the measured positions, in rad or m, one number or one per joint; 0 for none.
        gains: Drive gains by joint in N m/A (16); the log then has motor currents instead of joint torques.
        lead_in: Length in s of a run-in from rest that joins position, velocity and acceleration of the start; it is
            simulated, not logged. 0 starts the plant on the trajectory.
        integration_rate: Steps a second, a multiple of both rates; None chooses.
        seed: Of the noise; position, velocity and torque draw from streams of their own.

    Raises:
        BadOption: An option out of range, a sharp Coulomb sign or another friction part that cannot be simulated.
        NotConsistent: The mass matrix is not positive definite along the motion.
        SolverFailed: The motion diverged.
        UnknownChoice: A drive gain for a joint that is not there.
    """
    body = plant(model, theta)
    rows = _rows(trajectory, duration, rate, body)
    course = _Course(trajectory, lead_in)
    masses = body.masses(course.evaluate(np.linspace(-lead_in, rows / rate, LOOKS))[0])
    tables = _gains(controller, masses, body)
    ticks = clock(rate, controller.rate, integration_rate, body.fastest_decay(masses), lead_in, rows)
    reference = _reference(body, course, ticks.control_times, controller.gravity)
    streams = [np.random.default_rng(child) for child in np.random.SeedSequence(seed).spawn(3)]
    shape = (ticks.measurements, body.joints)
    shaken = [_drawn(stream, name, level, shape) for stream, name, level in zip(streams, *_errors(noise), strict=False)]
    start = np.array(course.evaluate(ticks.control_times[:1])[:2])[:, 0]
    encoder = _per_joint("resolution", resolution, body.joints)
    out, cut = body.run(ticks, start, tables, encoder, reference, np.stack(shaken, axis=1))
    text = f"{controller.rate:g} Hz control, {ticks.rate:g} Hz integration, seed {seed}"
    source = Source(rows=rows, steps=(f"virtual robot '{model.robot.name}': {text}",))
    truth = Log(model.robot.joint_names, ticks.row_times, *np.moveaxis(out[:, :4], 1, 0), source=source)
    seen = replace(truth, q=out[:, 4], dq=None if noise.velocity is None else out[:, 5], ddq=None, torque=None)
    error = _drawn(streams[2], "noise.torque", noise.torque, (rows, body.joints))
    return SimulatedRun(replace(seen, **_effort(model.robot, out[:, 3], error, gains)), truth, cut)
