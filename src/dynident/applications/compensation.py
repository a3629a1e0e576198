"""What a controller adds to its feedback: feed-forward, gravity and friction torques of an identified model.

Each function takes one state, (n,) each, or many, (N, n) each, and returns torques of the same shape in N m or N, at
the joints. ``theta`` are standard parameters (p,): :func:`parameters_of` an estimate, or those of a description.
Source: Siciliano, Sciavicco, Villani and Oriolo 2009, section 8.5.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from dynident.arrays import Array
from dynident.errors import BadOption
from dynident.identification.estimate.estimate import Estimate
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import Motion
from dynident.model.kernels import batched


def parameters_of(estimate: Estimate) -> Array:
    """Return standard parameters with the torques of an estimate, shape (p,); in general of no possible body."""
    return estimate.base.to_standard(estimate.beta)


def feed_forward(
    model: DynamicModel,
    theta: Array,
    q: npt.ArrayLike,
    dq: npt.ArrayLike,
    ddq: npt.ArrayLike,
    temperature: npt.ArrayLike | None = None,
) -> Array:
    """Return the torque that the planned motion needs: bodies, rotors, friction.

    Args:
        model: Robot, drives and friction.
        theta: Standard parameters, shape (p,).
        q: Planned positions, in rad or m.
        dq: Planned velocities; at a planned stand friction that depends on the sign of the speed is zero.
        ddq: Planned accelerations.
        temperature: Of the drives, in degrees Celsius, where friction depends on it.

    Raises:
        BadOption: Shapes that differ, or a temperature that is missing.
    """
    motion, one = _motion(model, q, dq, ddq, temperature)
    return _shaped(model.torque(motion, theta), one)


def gravity_torque(model: DynamicModel, theta: Array, q: npt.ArrayLike) -> Array:
    """Return the torque that holds the arm against gravity, springs and other known bias, without friction.

    Args:
        model: Robot, drives and friction.
        theta: Standard parameters, shape (p,).
        q: Positions, in rad or m.

    Raises:
        BadOption: A shape that is not (n,) or (N, n).
    """
    motion, one = _motion(model, q, np.zeros_like(np.asarray(q, dtype=float)), np.zeros_like(np.asarray(q, float)))
    inertial = np.asarray(theta, dtype=float)[: model.inertial_count]
    rigid = batched.inverse_dynamics(model.robot.chain, inertial, motion.q, motion.dq, motion.ddq)
    return _shaped(rigid + model.known_torque(motion), one)


def friction_torque(
    model: DynamicModel,
    theta: Array,
    q: npt.ArrayLike,
    dq: npt.ArrayLike,
    temperature: npt.ArrayLike | None = None,
    share: float = 1.0,
    offset: bool = True,
) -> Array:
    """Return the friction at the joints, without rotors; where it grows with the load, that of no acceleration.

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

    Raises:
        BadOption: Shapes that differ, a share that is none, or a temperature that is missing.
    """
    if not 0 <= share <= 1:
        raise BadOption("share", share, "give a share of the friction from 0 to 1, such as 0.9")
    motion, one = _motion(model, q, dq, np.zeros_like(np.asarray(dq, dtype=float)), temperature)
    own = model.loaded(motion, theta)
    table = model.coefficient_table(theta)
    values = model.friction_values(own)
    if not offset:
        symbols = [c.symbol for part in model.friction for c in part.coefficients]
        values = values * np.array([symbol != "F0" for symbol in symbols])
    drives = np.einsum("sjk,jk->sj", values, table)
    return _shaped(share * drives @ np.asarray(model.robot.coupling), one)


def mass_matrices(model: DynamicModel, theta: Array, q: npt.ArrayLike) -> Array:
    """Return the mass matrix with all rotors, known and identified, shape (n, n) or (N, n, n).

    Args:
        model: Robot, drives and friction.
        theta: Standard parameters, shape (p,).
        q: Positions, in rad or m.

    Raises:
        BadOption: A shape that is not (n,) or (N, n).
    """
    positions, one = _rows(model, "q", q)
    coupling = np.asarray(model.robot.coupling)
    inertial = np.asarray(theta, dtype=float)[: model.inertial_count]
    rotors = coupling.T @ np.diag(model.rotors(np.asarray(theta, dtype=float))) @ coupling
    found = batched.mass_matrix(model.robot.chain, inertial, positions) + rotors + model.robot.reflected_inertia
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
        BadOption: Shapes that differ.
    """
    goal, one = _motion(model, *planned)
    (now, _), (speed, _) = _rows(model, "q", q), _rows(model, "dq", dq)
    demand = goal.ddq + np.asarray(damping) * (goal.dq - speed) + np.asarray(stiffness) * (goal.q - now)
    inertial = np.asarray(theta, dtype=float)[: model.inertial_count]
    rigid = batched.inverse_dynamics(model.robot.chain, inertial, now, speed, demand)
    turning = Motion(now, speed, demand)
    rotors = model.rotor_torque(turning, model.rotors(np.asarray(theta, dtype=float))) - model.robot.bias
    return _shaped(rigid + rotors + np.atleast_2d(_slippery(model, theta, goal)), one)


def _slippery(model: DynamicModel, theta: Array, goal: Motion) -> Array:
    """Return friction without the columns of rotors, shape (N, n)."""
    return friction_torque(model, theta, goal.q, goal.dq, goal.temperature)


def _motion(
    model: DynamicModel,
    q: npt.ArrayLike,
    dq: npt.ArrayLike,
    ddq: npt.ArrayLike,
    temperature: npt.ArrayLike | None = None,
) -> tuple[Motion, bool]:
    (rows, one), (speed, _), (acceleration, _) = (
        _rows(model, name, values) for name, values in (("q", q), ("dq", dq), ("ddq", ddq))
    )
    if not len(rows) == len(speed) == len(acceleration):
        step = "give as many velocities and accelerations as positions"
        raise BadOption("states", f"{len(rows)}, {len(speed)}, {len(acceleration)} rows", step)
    warm = None if temperature is None else _rows(model, "temperature", temperature)[0]
    return Motion(rows, speed, acceleration, temperature=warm), one


def _rows(model: DynamicModel, name: str, values: npt.ArrayLike) -> tuple[Array, bool]:
    """Return values as rows (N, n), and whether they were of one state."""
    array = np.asarray(values, dtype=float)
    if array.ndim not in (1, 2) or array.shape[-1] != model.robot.dof:
        step = f"give one number for each of the {model.robot.dof} joints, in one row or in many"
        raise BadOption(name, f"of shape {array.shape}", step)
    return np.ascontiguousarray(np.atleast_2d(array)), array.ndim == 1


def _shaped(torque: Array, one: bool) -> Array:
    return torque[0] if one else torque
