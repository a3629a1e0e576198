"""simulate_cell: a robot with known parameters follows a motion in a virtual cell, and its log is kept."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numba
import numpy as np
import numpy.typing as npt
from numba import types

from dynident.arrays import Array
from dynident.data.log import Source
from dynident.errors import BadOption, SolverFailed
from dynident.excitation.trajectories.base import Trajectory
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import Motion
from dynident.model.kernels import batched
from dynident.model.kernels.generic import pack
from dynident.simulation.cell import Cell, CellRun
from dynident.simulation.cell_loop import ROWS, STATES, closed_cell
from dynident.simulation.cell_plant import CellPlant, armature, cell_plant
from dynident.simulation.controllers import CONTROLLERS, Controller, Loop
from dynident.simulation.drive_friction import ROOM
from dynident.simulation.effects import Encoder, each
from dynident.simulation.mujoco_plant import mujoco_loop
from dynident.simulation.plant import Clock, clock
from dynident.simulation.recording import CommandedCourse, LoopRun, Samples, course, streams

#: States along the motion at which masses and torques are looked at.
LOOKS = 200

#: Share of its motion by which a joint may be displaced where the controller chooses its gains.
NEAR = 0.05

#: Deviation of the positions in rad or m below which a joint stands still: there is no motion for it to follow.
STILL = 1e-9


def simulate_cell(
    model: DynamicModel,
    theta: npt.ArrayLike,
    trajectory: Trajectory,
    cell: Cell | None = None,
    *,
    duration: float | None = None,
    gains: Mapping[str, float] | None = None,
    believed: npt.ArrayLike | None = None,
    seed: int = 0,
) -> CellRun:
    """Return the log of a robot with the parameters theta (p,) of ``model`` that follows ``trajectory`` in a cell.

    Integrated by the classical Runge-Kutta rule in compiled code.

    Args:
        model: Robot, coupling, known rotor inertia and friction; what the controller believes but for its numbers.
        theta: The true parameters but for the payload, shape (p,).
        trajectory: The commanded motion.
        cell: Controller and effects; None for the default cell.
        duration: Length of the log in s; None for the trajectory's. Only periodic motions go on beyond theirs.
        gains: Drive gains by joint in N m/A (16); the log then has motor currents instead of joint torques.
        believed: Parameters that the controller believes, shape (p,); None for theta.
        seed: Of all that is drawn; every effect has a stream of its own.

    Raises:
        BadOption: An option out of range, or a friction part that cannot be simulated.
        MissingDependency: MuJoCo is asked for and not installed.
        NotConsistent: The mass matrix is not positive definite along the motion.
        SolverFailed: The motion diverged.
        UnknownChoice: A joint or link that is not there.
    """
    cell = cell or Cell()
    body = cell_plant(model, theta, cell)
    told = np.array(theta if believed is None else believed, dtype=np.float64)
    if told.shape != (len(model.parameters),):
        raise BadOption("believed", f"of shape {told.shape}", f"the model has {len(model.parameters)} parameters")
    motion = course(trajectory, cell.lead_in, duration, body.joints)
    look = np.linspace(-cell.lead_in, motion.length, LOOKS)
    looked = np.asarray(motion.evaluate(look))
    masses = body.masses(looked[0])
    control = cell.controller
    decay = body.fastest(masses, looked[0], looked[1])
    ticks = clock(cell.recorder.rate, control.rate, cell.integration_rate, decay, cell.lead_in, motion.length)
    needed = body.model.torque(_moved(body.model, looked, look[1] - look[0]), body.theta)
    lacking = needed - _fed(model, told, looked, control.feedforward, look[1] - look[0])[0]
    settings = np.array(control.settings(_loop(control, body, masses, looked, lacking)), dtype=np.float64)
    noise = _noise(cell.encoder, ticks, body.joints, seed)
    goals = _goals(model, told, motion, ticks.control_times, control)
    believed_model = (
        *(np.array(one) for one in pack(model.robot.chain)),
        told[: model.inertial_count].copy(),
        armature(model, told),
    )
    out, cut = _run(body, cell, ticks, settings, goals, noise, believed_model)
    rows = (ticks.first + np.arange(ticks.rows) * ticks.per_row) // ticks.per_noise
    text = f"{CONTROLLERS.name_of(control)} at {control.rate:g} Hz, {ticks.rate:g} Hz integration, seed {seed}"
    source = Source(rows=ticks.rows, steps=(f"virtual cell of '{model.robot.name}': {text}",))
    found = LoopRun(Samples(*np.moveaxis(out, 1, 0)), body, cell, ticks, motion, noise[rows], source, seed)
    return CellRun(*found.log(gains), body.theta, np.array(body.robot.gravity), cut, ticks.rate)


def _loop(control: Controller, body: CellPlant, masses: Array, states: Array, lacking: Array) -> Loop:
    """Return what a controller is told for its gains; behind springs a fast torque moves the rotor alone.

    Args:
        control: The controller.
        body: What it moves.
        masses: Mass matrices along the motion, shape (N, n, n).
        states: q, dq and ddq there, shape (3, N, n).
        lacking: Torque there that is not fed forward, shape (N, n).
    """
    inertia, coupling = np.diagonal(masses[0]).copy(), body.coupling
    moved = (coupling.T @ np.diag(body.springs[2]) @ coupling)[None] if body.is_elastic else masses
    dead = 1.0 / control.rate + control.delay_s
    dead += 1.0 / (2.0 * np.pi * control.current_hz) if control.current_hz else 0.0
    speed = body.greatest_speed(states[1])
    friction = np.diagonal(
        coupling.T @ np.diag(body.friction.gentlest(states[0] @ coupling.T, speed)) @ coupling
    ).copy()
    size, span = np.sqrt(np.mean(lacking**2, axis=0)), np.std(states[0], axis=0)
    wanted = np.sqrt(np.divide(size, NEAR * span * inertia, out=np.zeros_like(size), where=span > STILL))
    return Loop(inertia, moved, dead, friction, wanted)


def _noise(encoder: Encoder, ticks: Clock, joints: int, seed: int) -> Array:
    """Return the noise of measured q and dq per measurement, shape (T, 2, n)."""
    draw, shape = streams(seed), (ticks.measurements, joints)
    q = draw["position"].normal(size=shape) * each("encoder.noise", encoder.noise, joints)
    dq = draw["velocity"].normal(size=shape) * each("encoder.velocity_noise", encoder.velocity_noise, joints)
    return np.stack([q, dq], axis=1)


def _goals(model: DynamicModel, theta: Array, motion: CommandedCourse, time: Array, control: Controller) -> Array:
    """Return per tick of the controller what its law is told, shape (K, 5, n); see controllers/base.py."""
    states = np.asarray(motion.evaluate(time))
    return np.stack([*states, *_fed(model, theta, states, control.feedforward, 1.0 / control.rate)], axis=1)


def _moved(model: DynamicModel, states: Array, step: float) -> Motion:
    """Return states (3, N, n), ``step`` seconds apart, as friction takes them, of drives that are not warm yet."""
    temperature = np.full_like(states[0], ROOM) if "temperature" in model.needs else None
    return model.with_states(Motion(*states, temperature=temperature), step)


def _fed(model: DynamicModel, theta: Array, states: Array, feed: str, step: float) -> tuple[Array, Array]:
    """Return at states (3, N, n), ``step`` seconds apart, two torques (N, n): fed forward, and beside the bodies."""
    q, dq, ddq = states
    rest, robot = np.zeros_like(q), model.robot
    bodies = theta[: model.inertial_count]
    fed, beside = rest, rest - robot.bias
    if feed == "gravity":
        fed = batched.inverse_dynamics(robot.chain, bodies, q, rest, rest) - robot.bias
    if feed == "model":
        fed = model.torque(_moved(model, states, step), theta)
        rigid = batched.inverse_dynamics(robot.chain, bodies, q, dq, ddq)
        beside = fed - rigid - ddq @ armature(model, theta).T
    return fed, beside


def _run(
    body: CellPlant, cell: Cell, ticks: Clock, settings: Array, goals: Array, noise: Array, believed: tuple[Any, ...]
) -> tuple[Array, int]:
    """Run the loop; return its samples (N, ROWS, n), and how many torques were cut."""
    control, n = cell.controller, body.joints
    counts = [ticks.per_control, ticks.per_row, ticks.per_noise, ticks.first, round(control.delay_s * ticks.rate)]
    step, period = 1.0 / ticks.rate, 1.0 / control.rate
    decay = np.exp(-np.pi * control.current_hz * step) if control.current_hz else 0.0
    keep = np.exp(-2.0 * np.pi * cell.encoder.filter_hz * period) if cell.encoder.filter_hz else 0.0
    state, out = np.zeros((STATES, n)), np.empty((ticks.rows, ROWS, n))
    state[:2] = goals[0, :2]
    if body.is_elastic:
        state[2:4] = goals[0, :2] @ body.coupling.T
        given = body.coupling.T @ np.diag(body.springs[0])
        state[2] += np.linalg.solve(given, goals[0, 3])  # springs that carry what is fed forward
    sensors = np.array([each("encoder.resolution", cell.encoder.resolution, n), np.ones(n)])
    sensors[1] = 1.0 if cell.encoder.velocity == "motor" else 0.0
    limits = np.array([joint.limits.effort if cell.saturation else np.inf for joint in body.robot.active])
    own = (*body.loop_tables(), (believed, settings, limits, sensors, np.array([step, period, decay, keep])))
    rest = ((np.ascontiguousarray(goals), noise), np.array(counts, dtype=np.int64))
    memory = np.zeros((control.memory, n))
    arguments = (*own, *rest, (state, memory), out)
    loop = mujoco_loop(body) if cell.plant == "mujoco" else _compiled(control.law(), arguments)
    try:
        failed, cut = loop(control.law(), *arguments)
    except TypeError as error:  # what numba makes of Ctrl-C while it looks up the address of the law
        if "_get_wrapper_address" not in str(error):
            raise
        raise KeyboardInterrupt from error
    if failed >= 0:
        evidence = f"the motion is lost at {(failed - ticks.first) / ticks.rate:.4g} s"
        step_text = "give a lower bandwidth, a faster controller or a higher integration rate"
        raise SolverFailed(f"the simulation of '{body.robot.name}'", evidence, step_text)
    return out, int(cut)


def _compiled(law: Any, arguments: tuple[Any, ...]) -> Any:
    """Return the compiled loop for these kinds of arguments; laws are called by their address, so it is one for all."""
    if not hasattr(closed_cell, "overloads"):  # NUMBA_DISABLE_JIT leaves the function as it is
        return closed_cell
    matrix, vector = types.float64[:, ::1], types.float64[::1]
    model = numba.typeof(arguments[2][0])
    kinds = (matrix, matrix, matrix, types.Tuple((vector, types.float64, model)), matrix, matrix, vector)
    law.compile(kinds)
    loop: Any = closed_cell
    signature = (types.FunctionType(types.none(*kinds)), *map(numba.typeof, arguments))
    loop.compile(signature)
    return loop.overloads[signature].entry_point
