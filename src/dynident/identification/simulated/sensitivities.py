"""Exact derivatives of a simulated closed loop by the base parameters.

At every stage of the integration rule the derivatives of the inverse dynamics by positions, velocities and parameters
come from the kernels in batches; the forward sensitivity equations are linear in them and are integrated by the same
rule along the states already found. The result is the derivative of the discrete simulation, to rounding.
"""

from __future__ import annotations

import importlib
from dataclasses import replace
from typing import Any

import numpy as np

from dynident.arrays import Array
from dynident.excitation.design.observation import Observation
from dynident.identification.simulated.closed_loop import ClosedLoop, SimulatedSegment
from dynident.identification.simulated.course import Course, refuse_states
from dynident.identification.simulated.implicit import implicit_tangent
from dynident.model.friction import Motion
from dynident.simulation.drive_friction import drive_friction

#: Samples below which several joints are differentiated at a time.
FEW = 2_000


def sensitivities(
    loop: ClosedLoop, course: Course, beta: Array, of: str, observation: Observation | None = None
) -> tuple[Array, Array]:
    """Return the simulated samples of one log and the derivative of positions or torques by the base parameters.

    Args:
        loop: The closed loop.
        course: One of its courses.
        beta: Base parameters, shape (b,).
        of: ``q`` or ``torque``.
        observation: Of the model and its base parameters; None makes one.

    Returns:
        q, dq, ddq and torque at the rows, shape (N, 4, n), and the derivative, shape (N, n, b).

    Raises:
        NotConsistent: The mass matrix of ``beta`` is not positive definite along the reference.
        SolverFailed: The motion diverged.
        BadOption: Friction with a state of its own, of a motion that has to be integrated.
    """
    compiled: Any = importlib.import_module("dynident.simulation.tangent_loop")
    observation = observation or Observation(loop.problem.model, loop.problem.base)
    joints, count = course.reference.shape[2], len(beta)
    if loop.is_exact(course):  # the states do not move with the parameters
        still = np.zeros((course.reference.shape[1], joints, count))
        return loop.along(course, beta), still if of == "q" else _dense(observation, loop.goal(course))
    refuse_states(loop.problem.model, "an output error")
    state, torque = np.zeros((2, joints, count)), np.zeros((joints, count))
    rows, slopes = [], []
    for segment in loop.follow(course, beta):
        fed = _fed_slopes(loop, observation, segment, beta)
        along = (loop.gains, fed, segment.counts, segment.step, state, torque)
        if segment.implicit:
            found = implicit_tangent(motion_slopes(observation, segment.stages, beta, segment.temperature), *along)
        else:
            found = np.empty((len(segment.out), 2, joints, count))
            compiled.tangent(inverse_slopes(observation, segment.stages, beta, segment.temperature), *along, found)
        rows.append(segment.out)
        slopes.append(found[:, 0 if of == "q" else 1].copy())
    return np.concatenate(rows), np.concatenate(slopes)


def inverse_slopes(
    observation: Observation, states: Array, beta: Array, temperature: Array | None = None
) -> tuple[Array, Array, Array, Array]:
    """Return what :func:`motion_slopes` returns, with the inverse of the mass matrix in its place."""
    by_q, by_dq, by_beta, mass = motion_slopes(observation, states, beta, temperature)
    return by_q, by_dq, by_beta, np.linalg.inv(mass)


def motion_slopes(
    observation: Observation, states: Array, beta: Array, temperature: Array | None = None
) -> tuple[Array, Array, Array, Array]:
    """Return the derivatives of the inverse dynamics by q, dq, beta and ddq, the mass matrix.

    Friction f that depends on the load, the torque R of bodies and rotors, adds A dR to its own derivatives, with
    A = C' diag(df/dload) C^-T; the last is then (1 + A) M.

    Args:
        observation: Of the model and its base parameters.
        states: q, dq and ddq at the s stages of S steps, shape (S, s, 3, n).
        beta: Base parameters, shape (b,).
        temperature: Of the drives in each step, shape (S, n), in degrees Celsius; None where it is not known.

    Returns:
        Shapes (S, s, n, n), (S, s, n, n), (S, s, n, b) and (S, s, n, n).
    """
    steps, stages, _, joints = states.shape
    motion = Motion(*np.ascontiguousarray(states.reshape(-1, 3, joints).swapaxes(0, 1)))
    if temperature is not None:
        motion = replace(motion, temperature=np.repeat(temperature, stages, axis=0))
    motion = observation.model.loaded(motion, observation.base.to_standard(beta))
    by_motion = _by_motion(observation, motion, beta)
    answer = _load_answer(observation, motion, beta)
    if answer is not None:
        by_motion += answer @ _by_motion(observation, motion, np.where(observation.base.is_friction, 0.0, beta))
    at = (steps, stages, joints, -1)
    by_q, by_dq, mass = (array.reshape(at) for array in by_motion)
    return by_q, by_dq, _by_parameters(observation, motion, answer).reshape(at), mass


def _by_motion(observation: Observation, motion: Motion, beta: Array) -> Array:
    """Return the derivatives of the torque by q, dq and ddq at a load that is held, shape (3, N, n, n)."""
    samples, joints = motion.q.shape
    by_motion: Array = np.empty((3, samples, joints, joints))
    together = max(1, FEW // samples)
    for first in range(0, joints, together):
        own = range(first, min(first + together, joints))
        found = observation.pullback(_repeated(motion, len(own)), _one_joint_each(observation, own, beta, samples))
        for order, slopes in enumerate(found):
            by_motion[order, :, first : own.stop] = slopes.reshape(len(own), samples, joints).swapaxes(0, 1)
    by_motion[2] += observation.model.robot.reflected_inertia
    return by_motion


def _load_answer(observation: Observation, motion: Motion, beta: Array) -> Array | None:
    """Return A = C' diag(df/dload) C^-T at each sample, shape (N, n, n); None where no friction depends on the load."""
    model = observation.model
    if "torque" not in model.needs:
        return None
    coupling = np.asarray(model.robot.coupling)
    friction = drive_friction(model, observation.base.to_standard(beta))
    slopes = friction.load_slopes(motion.at_motors(coupling))
    return (coupling.T * slopes[:, None]) @ np.linalg.inv(coupling).T


def _by_parameters(observation: Observation, motion: Motion, answer: Array | None) -> Array:
    """Return the derivative of the torque by the parameters, shape (N, n, b), with what friction makes of the load."""
    found = _dense(observation, motion)
    return found if answer is None else found + answer @ np.where(observation.base.is_friction, 0.0, found)


def _repeated(motion: Motion, times: int) -> Motion:
    return motion.rows(np.tile(np.arange(len(motion.q)), times))


def _one_joint_each(observation: Observation, joints: range, beta: Array, samples: int) -> list[Array]:
    """Return weights of the rows that make the torque of one joint after the other, (K_i, len(joints) samples) each."""
    weights: list[Array] = [np.zeros((len(columns), len(joints) * samples)) for columns in observation.columns]
    for place, joint in enumerate(joints):
        weights[joint][:, place * samples : (place + 1) * samples] = beta[observation.columns[joint]][:, None]
    return weights


def _fed_slopes(loop: ClosedLoop, observation: Observation, segment: SimulatedSegment, beta: Array) -> Array:
    """Return the derivative of the torque fed forward at every half step, shape (2 S + 1, n, b)."""
    reference = segment.reference
    if loop.feedforward == "computed":
        reference = observation.model.loaded(reference, observation.base.to_standard(beta))
        return _by_parameters(observation, reference, _load_answer(observation, reference, beta))
    if loop.feedforward == "gravity":
        rest = np.zeros_like(reference.q)
        still = Motion(reference.q, rest, rest, rest, reference.temperature)
        found = _dense(observation, still)
        found[:, :, observation.base.independent >= observation.model.inertial_count] = 0.0
        return found
    return np.zeros((*reference.q.shape, observation.base.count))


def _dense(observation: Observation, motion: Motion) -> Array:
    """Return the rows of the base observation matrix, shape (N, n, b)."""
    found = np.zeros((len(motion.q), len(observation.columns), observation.base.count))
    for i, (columns, block) in enumerate(zip(observation.columns, observation.rows(motion), strict=True)):
        found[:, i, columns] = block.T
    return found
