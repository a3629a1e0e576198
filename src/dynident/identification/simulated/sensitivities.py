"""Exact derivatives of a simulated closed loop by the base parameters.

At every stage of the integration rule the derivatives of the inverse dynamics by positions, velocities and parameters
come from the kernels in batches; the forward sensitivity equations are linear in them and are integrated by the same
rule along the states already found. The result is the derivative of the discrete simulation, to rounding.
"""

from __future__ import annotations

import importlib
from typing import Any

import numpy as np

from dynident.arrays import Array
from dynident.excitation.design.observation import Observation
from dynident.identification.simulated.closed_loop import ClosedLoop, Segment
from dynident.identification.simulated.course import Course
from dynident.identification.simulated.implicit import implicit_tangent
from dynident.model.friction import Motion

#: Samples below which several joints are differentiated at a time.
FEW = 2_000


def sensitivities(
    loop: ClosedLoop, course: Course, beta: Array, of: str, observation: Observation | None = None
) -> tuple[Array, Array]:
    """Return the simulated rows of one log and the derivative of positions or torques by the base parameters.

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
    """
    compiled: Any = importlib.import_module("dynident.simulation.tangent_loop")
    observation = observation or Observation(loop.problem.model, loop.problem.base)
    joints, count = course.reference.shape[2], len(beta)
    if loop.is_exact(course):  # the states do not move with the parameters
        still = np.zeros((course.reference.shape[1], joints, count))
        return loop.along(course, beta), still if of == "q" else _dense(observation, loop.goal(course))
    state, torque = np.zeros((2, joints, count)), np.zeros((joints, count))
    rows, slopes = [], []
    for segment in loop.follow(course, beta):
        fed = _fed_slopes(loop, observation, segment)
        along = (loop.gains, fed, segment.counts, segment.step, state, torque)
        if segment.implicit:
            found = implicit_tangent(motion_slopes(observation, segment.stages, beta), *along)
        else:
            found = np.empty((len(segment.out), 2, joints, count))
            compiled.tangent(inverse_slopes(observation, segment.stages, beta), *along, found)
        rows.append(segment.out)
        slopes.append(found[:, 0 if of == "q" else 1].copy())
    return np.concatenate(rows), np.concatenate(slopes)


def inverse_slopes(observation: Observation, states: Array, beta: Array) -> tuple[Array, Array, Array, Array]:
    """Return what :func:`motion_slopes` returns, with the inverse of the mass matrix in its place."""
    by_q, by_dq, by_beta, mass = motion_slopes(observation, states, beta)
    return by_q, by_dq, by_beta, np.linalg.inv(mass)


def motion_slopes(observation: Observation, states: Array, beta: Array) -> tuple[Array, Array, Array, Array]:
    """Return the derivatives of the inverse dynamics by q, dq, beta and ddq, the mass matrix.

    Args:
        observation: Of the model and its base parameters.
        states: q, dq and ddq at the s stages of S steps, shape (S, s, 3, n).
        beta: Base parameters, shape (b,).

    Returns:
        Shapes (S, s, n, n), (S, s, n, n), (S, s, n, b) and (S, s, n, n).
    """
    steps, stages, _, joints = states.shape
    motion = Motion(*np.ascontiguousarray(states.reshape(-1, 3, joints).swapaxes(0, 1)))
    samples = steps * stages
    by_motion: Array = np.empty((3, samples, joints, joints))
    together = max(1, FEW // samples)
    for first in range(0, joints, together):
        own = range(first, min(first + together, joints))
        found = observation.pullback(_repeated(motion, len(own)), _one_joint_each(observation, own, beta, samples))
        for order, slopes in enumerate(found):
            by_motion[order, :, first : own.stop] = slopes.reshape(len(own), samples, joints).swapaxes(0, 1)
    mass = by_motion[2] + observation.model.robot.reflected_inertia
    at = (steps, stages, joints, -1)
    by_q, by_dq, mass = (array.reshape(at) for array in (by_motion[0], by_motion[1], mass))
    return by_q, by_dq, _dense(observation, motion).reshape(at), mass


def _repeated(motion: Motion, times: int) -> Motion:
    return Motion(*(np.tile(signal, (times, 1)) for signal in (motion.q, motion.dq, motion.ddq)))


def _one_joint_each(observation: Observation, joints: range, beta: Array, samples: int) -> list[Array]:
    """Return weights of the rows that make the torque of one joint after the other, (K_i, len(joints) samples) each."""
    weights: list[Array] = [np.zeros((len(columns), len(joints) * samples)) for columns in observation.columns]
    for place, joint in enumerate(joints):
        weights[joint][:, place * samples : (place + 1) * samples] = beta[observation.columns[joint]][:, None]
    return weights


def _fed_slopes(loop: ClosedLoop, observation: Observation, segment: Segment) -> Array:
    """Return the derivative of the torque fed forward at every half step, shape (2 S + 1, n, b)."""
    reference = segment.reference
    if loop.feedforward == "computed":
        return _dense(observation, reference)
    if loop.feedforward == "gravity":
        rest = np.zeros_like(reference.q)
        found = _dense(observation, Motion(reference.q, rest, rest))
        found[:, :, observation.base.independent >= observation.model.inertial_count] = 0.0
        return found
    return np.zeros((*reference.q.shape, observation.base.count))


def _dense(observation: Observation, motion: Motion) -> Array:
    """Return the rows of the base observation matrix, shape (N, n, b)."""
    found = np.zeros((len(motion.q), len(observation.columns), observation.base.count))
    for i, (columns, block) in enumerate(zip(observation.columns, observation.rows(motion), strict=True)):
        found[:, i, columns] = block.T
    return found
