"""What a controller adds to its feedback: feed-forward, gravity and friction torques of an identified model.

Each function takes one state, (n,) each, or many, (N, n) each, and returns torques of the same shape in N m or N, at
the joints. ``theta`` are standard parameters (p,): :func:`parameters_of` an estimate, or those of a description.
Source: Siciliano, Sciavicco, Villani and Oriolo 2009, section 8.5.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from dynident.applications.states import motion_of_arrays, rows_of
from dynident.arrays import Array
from dynident.errors import BadOption
from dynident.identification.estimate.estimate import Estimate
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import Motion
from dynident.model.kernels import batched


def parameters_of(estimate: Estimate) -> Array:
    """Return standard parameters with the torques of an estimate, shape (p,).

    They are its bodies, where it has some: torques of weight and inertia alone are then those of exported models. Else
    they are in general of no possible body, and what only shows together (a rotor and the weight of a vertical slide)
    stands in one of the parameters.
    """
    return estimate.base.to_standard(estimate.beta) if estimate.theta is None else np.asarray(estimate.theta)


def feed_forward(
    model: DynamicModel,
    theta: Array,
    q: npt.ArrayLike,
    dq: npt.ArrayLike | None,
    ddq: npt.ArrayLike | None,
    temperature: npt.ArrayLike | None = None,
    step: float | None = None,
) -> Array:
    """Return the torque that the planned motion needs: bodies, rotors, friction.

    Args:
        model: Robot, drives and friction.
        theta: Standard parameters, shape (p,).
        q: Planned positions, in rad or m.
        dq: Planned velocities; at a planned stand friction that depends on the sign of the speed is zero.
        ddq: Planned accelerations.
        temperature: Of the drives, in degrees Celsius, where friction depends on it.
        step: Time from one state to the next in s where they follow each other from standstill on, for friction that
            remembers; None where they do not, and it has slipped the way of the motion.

    Raises:
        BadArgument: Shapes that differ.
        BadOption: A temperature that is missing.
    """
    motion, one = motion_of_arrays(model.robot, q, dq, ddq, temperature)
    return _shaped(model.torque(motion if step is None else model.with_states(motion, step), theta), one)


def gravity_torque(model: DynamicModel, theta: Array, q: npt.ArrayLike) -> Array:
    """Return the torque that holds the arm against gravity, springs, ripple and known bias, without friction.

    Args:
        model: Robot, drives and friction.
        theta: Standard parameters, shape (p,).
        q: Positions, in rad or m.

    Raises:
        BadArgument: A shape that is not (n,) or (N, n).
    """
    motion, one = motion_of_arrays(model.robot, q)
    inertial = np.asarray(theta, dtype=float)[: model.inertial_count]
    rigid = batched.inverse_dynamics(model.robot.chain, inertial, motion.q, motion.dq, motion.ddq)
    return _shaped(rigid + model.known_torque(motion) + _of_position(model, theta, motion), one)


def friction_torque(
    model: DynamicModel,
    theta: Array,
    q: npt.ArrayLike,
    dq: npt.ArrayLike,
    temperature: npt.ArrayLike | None = None,
    share: float = 1.0,
    offset: bool = True,
    step: float | None = None,
) -> Array:
    """Return the friction at the joints, without rotors; where it grows with the load, that of no acceleration.

    What follows the position alone, a spring or a ripple, is part of :func:`gravity_torque`.

    With planned velocities it is feed-forward. With measured ones it is a positive feedback of the speed: a share below
    1 keeps it from driving the arm on its own, where the model has a little too much.

    Args:
        model: Robot, drives and friction.
        theta: Standard parameters, shape (p,).
        q: Positions, in rad or m.
        dq: Velocities, in rad/s or m/s.
        temperature: Of the drives, in degrees Celsius, where friction depends on it.
        share: Of the friction, 0 to 1.
        offset: Whether terms that do not depend on the motion (an offset of the torque sensor or the current) count.
        step: As of :func:`feed_forward`.

    Raises:
        BadOption: Shapes that differ, a share that is none, or a temperature that is missing.
    """
    if not 0 <= share <= 1:
        raise BadOption("share", share, "give a share of the friction from 0 to 1, such as 0.9")
    motion, one = motion_of_arrays(model.robot, q, dq, None, temperature)
    own = model.loaded(motion if step is None else model.with_states(motion, step), theta)
    table = model.coefficient_table(theta)
    pairs = [(part, c.symbol) for part in model.friction for c in part.coefficients]
    counts = np.array([not part.is_of_position and (offset or symbol != "F0") for part, symbol in pairs], dtype=float)
    drives = np.einsum("sjk,jk->sj", model.friction_values(own), table * counts)
    return _shaped(share * drives @ np.asarray(model.robot.coupling), one)


def mass_matrices(model: DynamicModel, theta: Array, q: npt.ArrayLike) -> Array:
    """Return the mass matrix with all rotors, known and identified, shape (n, n) or (N, n, n).

    Args:
        model: Robot, drives and friction.
        theta: Standard parameters, shape (p,).
        q: Positions, in rad or m.

    Raises:
        BadArgument: A shape that is not (n,) or (N, n).
    """
    motion, one = motion_of_arrays(model.robot, q)
    coupling = np.asarray(model.robot.coupling)
    inertial = np.asarray(theta, dtype=float)[: model.inertial_count]
    rotors = coupling.T @ np.diag(model.rotors(np.asarray(theta, dtype=float))) @ coupling
    found = batched.mass_matrix(model.robot.chain, inertial, motion.q) + rotors + model.robot.reflected_inertia
    return found[0] if one else found


def computed_torque(
    model: DynamicModel,
    theta: Array,
    planned: tuple[npt.ArrayLike, npt.ArrayLike, npt.ArrayLike],
    q: npt.ArrayLike,
    dq: npt.ArrayLike,
    stiffness: npt.ArrayLike,
    damping: npt.ArrayLike,
) -> Array:
    """Return M(q) (ddq_d + D (dq_d - dq) + S (q_d - q)) and what else the model has at the measured state.

    Friction is taken at the planned velocity: at the measured one it would be fed back.

    Args:
        model: Robot, drives and friction.
        theta: Standard parameters, shape (p,).
        planned: q_d, dq_d and ddq_d.
        q: Measured positions, in rad or m.
        dq: Measured velocities.
        stiffness: S, one number or one per joint, in 1/s^2.
        damping: D, one number or one per joint, in 1/s.

    Raises:
        BadArgument: Shapes that differ.
    """
    goal, one = motion_of_arrays(model.robot, *planned)
    now, speed = rows_of(model.robot, "q", q), rows_of(model.robot, "dq", dq)
    demand = goal.ddq + np.asarray(damping) * (goal.dq - speed) + np.asarray(stiffness) * (goal.q - now)
    inertial = np.asarray(theta, dtype=float)[: model.inertial_count]
    rigid = batched.inverse_dynamics(model.robot.chain, inertial, now, speed, demand)
    turning = Motion(now, speed, demand)
    rotors = model.rotor_torque(turning, model.rotors(np.asarray(theta, dtype=float))) - model.robot.bias
    resting = _of_position(model, theta, turning)
    friction = friction_torque(model, theta, goal.q, goal.dq, goal.temperature)
    return _shaped(rigid + rotors + resting + np.atleast_2d(friction), one)


def _of_position(model: DynamicModel, theta: Array, motion: Motion) -> Array:
    """Return the torque of springs and ripple at the joints, shape (N, n)."""
    own = replace(model, friction=tuple(part for part in model.friction if part.is_of_position))
    counts = np.array([part.is_of_position for part in model.friction for _ in part.coefficients], dtype=bool)
    drives = np.einsum("sjk,jk->sj", own.friction_values(motion), model.coefficient_table(theta)[:, counts])
    return drives @ np.asarray(model.robot.coupling)


def _shaped(torque: Array, one: bool) -> Array:
    return torque[0] if one else torque
