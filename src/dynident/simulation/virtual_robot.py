"""A log from a model, a controller and a trajectory, with the effects of a real cell."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from dynident.arrays import Array
from dynident.data.log import Log, Source
from dynident.errors import BadOption, UnknownChoice
from dynident.excitation.trajectories.base import Trajectory
from dynident.model.dynamic_model import DynamicModel
from dynident.model.robot import Robot
from dynident.simulation.commanded import CommandedCourse, course
from dynident.simulation.drive_friction import ROOM
from dynident.simulation.plant import Clock, Plant, clock, plant
from dynident.simulation.recording import streams

#: States along the motion at which the mass matrix is looked at.
LOOKS = 200

#: Speed of the drives that a free motion may reach, in rad/s or m/s.
FREE_SPEED = 10.0

#: Natural frequency of the joint loops where none is given and the rate of the controller allows it.
BANDWIDTH_HZ = 8.0


@dataclass(frozen=True)
class Noise:
    """Standard deviations of white noise, and the step of the encoders, one number or one per joint.

    Attributes:
        position: Of the encoders, in rad or m; the controller sees it too.
        velocity: Of the measured velocities, in rad/s or m/s. None: the log has no velocities, and the controller
            knows the true ones, as from a motor encoder far finer than the logged signal.
        torque: Of the measured motor torques, in N m or N; only in the log.
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


@dataclass(frozen=True)
class JointController:
    """A proportional-derivative controller at each joint, its output held between its ticks.

    Attributes:
        rate: Ticks a second, in Hz.
        bandwidth_hz: Natural frequency w of the loops in Hz: stiffness M_ii w^2 and damping 2 damping_ratio M_ii w,
            with the diagonal of the mass matrix at the start. None: 8 Hz, or what the rate allows along the motion.
        damping_ratio: Damping ratio of the loops.
        gravity: Whether the gravity torque at the commanded position is fed forward; the rest is feedback.
        stiffness: In N m/rad or N/m, one number or one per joint; None: from the bandwidth.
        damping: In N m s/rad or N s/m, one number or one per joint; None: from the bandwidth.
    """

    rate: float = 1000.0
    bandwidth_hz: float | None = None
    damping_ratio: float = 1.0
    gravity: bool = True
    stiffness: npt.ArrayLike | None = None
    damping: npt.ArrayLike | None = None


@dataclass(frozen=True)
class SimulatedRun:
    """What a virtual robot recorded, and what was true.

    Attributes:
        log: The measured signals: q, dq where velocities are measured, torque or current; the commanded q_ref, dq_ref.
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
    controller: JointController | None = None,
    noise: Noise | None = None,
    timing: Timing | None = None,
    gains: Mapping[str, float] | None = None,
    seed: int = 0,
) -> SimulatedRun:
    """Return the log of a robot with the parameters theta (p,) of ``model`` that follows ``trajectory``.

    Integrated by the classical Runge-Kutta rule; torques stop at the joints' effort limits. Drives stay at 25 degrees
    Celsius. Other controllers and the other effects of a cell: ``simulate_cell`` in cell_simulation.py.

    Args:
        model: Robot, coupling, known rotor inertia and friction of the plant.
        theta: Its parameters, shape (p,).
        trajectory: The commanded motion.
        controller: The controller; None for the default one.
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
    controller, noise, timing = controller or JointController(), noise or Noise(), timing or Timing()
    body, lead_in = plant(model, theta), timing.lead_in
    motion = course(trajectory, lead_in, timing.duration, body.joints)
    q, dq, _ = motion.evaluate(np.linspace(-lead_in, motion.length, LOOKS))
    masses = body.masses(q)
    tables, decay = _gains(controller, masses, body.robot), body.fastest_decay(masses, q, dq)
    ticks = clock(timing.rate, controller.rate, timing.integration_rate, decay, lead_in, motion.length)
    errors = _Errors.drawn(noise, ticks, body.joints, seed)
    encoder = _per_joint("noise.resolution", noise.resolution, body.joints, 0.0)
    reference = _reference(body, motion, ticks.control_times, controller.gravity)
    out, cut = body.run(ticks, reference[0, :2], tables, encoder, reference, errors.states)
    text = f"{controller.rate:g} Hz control, {ticks.rate:g} Hz integration, seed {seed}"
    source = Source(rows=ticks.rows, steps=(f"virtual robot '{model.robot.name}': {text}",))
    truth = Log(model.robot.joint_names, ticks.row_times, *np.moveaxis(out[:, :4], 1, 0), source=source)
    speed = None if noise.velocity is None else out[:, 5]
    told = motion.evaluate(ticks.row_times)
    log = Log(truth.joints, truth.time, out[:, 4], speed, q_ref=told[0], dq_ref=told[1], source=source)
    warm = np.full_like(log.q, ROOM) if "temperature" in model.needs else None
    effort = _measured_effort(model.robot, out[:, 3], errors.torque, gains)
    return SimulatedRun(replace(log, temperature=warm, **effort), truth, cut)


def free_motion(
    model: DynamicModel,
    theta: npt.ArrayLike,
    q: npt.ArrayLike,
    dq: npt.ArrayLike = 0.0,
    *,
    torque: npt.ArrayLike = 0.0,
    duration: float,
    rate: float = 1000.0,
    integration_rate: float | None = None,
) -> Log:
    """Return the true motion of a robot that is let go, under constant joint torques: q, dq, ddq and torque.

    Args:
        model: The plant; see :func:`simulate`.
        theta: Its parameters, shape (p,).
        q: Positions at the start, shape (n,), in rad or m.
        dq: Velocities at the start, shape (n,) or one number.
        torque: Joint torques, shape (n,) or one number, in N m or N.
        duration: Length in s.
        rate: Samples a second.
        integration_rate: Steps a second, a multiple of ``rate``; None chooses.

    Raises:
        BadOption: An option out of range, or a friction part that cannot be simulated.
        NotConsistent: The mass matrix is not positive definite at the start.
        SolverFailed: The motion diverged.
    """
    body = plant(model, theta)
    joints = body.joints
    start = np.array([_per_joint("q", q, joints), _per_joint("dq", dq, joints)])
    decay = body.fastest_decay(body.masses(start[:1]), start[:1], np.abs(start[1:]) + FREE_SPEED)
    ticks = clock(rate, rate, integration_rate, decay, 0.0, duration)
    goal = np.zeros((ticks.rows, 3, joints))
    goal[:, 2] = _per_joint("torque", torque, joints)
    tables = np.outer([0.0, 0.0, np.inf], np.ones(joints))
    silence = np.zeros((ticks.measurements, 2, joints))
    out, _ = body.run(ticks, start, tables, np.zeros(joints), goal, silence)
    source = Source(rows=ticks.rows, steps=(f"free motion of '{model.robot.name}', {ticks.rate:g} Hz integration",))
    return Log(model.robot.joint_names, ticks.row_times, *np.moveaxis(out[:, :4], 1, 0), source=source)


def _reference(body: Plant, motion: CommandedCourse, time: Array, gravity: bool) -> Array:
    """Return per control the commanded q and dq and the torque fed forward, shape (K, 3, n)."""
    q, dq, _ = motion.evaluate(time)
    return np.stack([q, dq, body.gravity(q) if gravity else np.zeros_like(q)], axis=1)


def _gains(controller: JointController, masses: Array, robot: Robot) -> Array:
    """Return stiffness, damping and largest torque of each joint, shape (3, n), once the loop is found stable."""
    for name in ("rate", "bandwidth_hz", "damping_ratio"):
        value = getattr(controller, name)
        if value is not None and not 0 < value < np.inf:
            raise BadOption(f"controller.{name}", value, "give a number above 0")
    inertia, ratio = np.diagonal(masses[0]), controller.damping_ratio
    highest = 0.8 * controller.rate / _fastest(masses, inertia, 2 * ratio * inertia)
    pulsation = min(2 * np.pi * BANDWIDTH_HZ, highest)
    if controller.bandwidth_hz is not None:
        pulsation = 2 * np.pi * controller.bandwidth_hz
    stiffness, damping = pulsation**2 * inertia, 2 * ratio * pulsation * inertia
    if controller.stiffness is not None:
        stiffness = _per_joint("controller.stiffness", controller.stiffness, robot.dof, 0.0)
    if controller.damping is not None:
        damping = _per_joint("controller.damping", controller.damping, robot.dof, 0.0)
    fastest = _fastest(masses, stiffness, damping)
    if fastest > controller.rate:
        step = f"the loop acts within {1e3 / fastest:.3g} ms somewhere on the motion; take a faster one or lower gains"
        raise BadOption("controller.rate", controller.rate, step)
    return np.array([stiffness, damping, [joint.limits.effort for joint in robot.active]])


def _fastest(masses: Array, stiffness: Array, damping: Array) -> float:
    """Return the fastest decay in 1/s of joint loops over mass matrices (N, n, n).

    A damping torque that is held between ticks overshoots from one decay a tick on, and is unstable from two on.
    """
    decay = np.abs(np.linalg.eigvals(np.linalg.solve(masses, np.diag(damping))))
    pulsation = np.sqrt(np.abs(np.linalg.eigvals(np.linalg.solve(masses, np.diag(stiffness)))))
    return float(max(np.max(decay), 2 * np.max(pulsation)))


@dataclass(frozen=True)
class _Errors:
    """Drawn noise: of q and dq per measurement (T, 2, n), of the motor torques per row (N, n)."""

    states: Array
    torque: Array

    @classmethod
    def drawn(cls, noise: Noise, ticks: Clock, joints: int, seed: int) -> _Errors:
        drawn, velocity = streams(seed), 0.0 if noise.velocity is None else noise.velocity
        q, dq, torque = (
            drawn[stream].normal(size=(count, joints)) * _per_joint(f"noise.{name}", level, joints, 0.0)
            for stream, name, level, count in (
                ("position", "position", noise.position, ticks.measurements),
                ("velocity", "velocity", velocity, ticks.measurements),
                ("effort", "torque", noise.torque, ticks.rows),
            )
        )
        return cls(np.stack([q, dq], axis=1), torque)


def _measured_effort(robot: Robot, torque: Array, error: Array, gains: Mapping[str, float] | None) -> dict[str, Array]:
    """Return the logged torques at the joints, or the currents of the motors where drive gains are given."""
    coupling = np.asarray(robot.coupling)
    motors = np.linalg.solve(coupling.T, torque.T).T + error  # torques at the joints are C' times those of the motors
    if gains is None:
        return {"torque": motors @ coupling}
    for name in gains:
        if name not in robot.joint_names:
            raise UnknownChoice("joint", name, robot.joint_names)
    for name in robot.joint_names:
        if not (name in gains and np.isfinite(gains[name]) and gains[name] != 0):
            raise BadOption(f"gains['{name}']", gains.get(name), "give each joint's drive gain in N m/A, not 0")
    return {"current": motors / np.array([gains[name] for name in robot.joint_names])}


def _per_joint(name: str, values: npt.ArrayLike, joints: int, lowest: float = -np.inf) -> Array:
    """Return one number per joint, shape (n,), from one for all or one each."""
    array = np.array(values, dtype=np.float64)
    if array.shape not in ((), (joints,)):
        raise BadOption(name, f"of shape {array.shape}", f"give one number, or one for each of the {joints} joints")
    if not (np.all(np.isfinite(array)) and np.all(array >= lowest)):
        raise BadOption(name, array.tolist(), f"give finite numbers{', 0 or more' if lowest == 0 else ''}")
    return np.broadcast_to(array, (joints,)).copy()
