"""What the roll-outs of all joints give of the bodies: rows of the base parameters, less what the drives explain."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag

from dynident.actuators.arm_coupling import Arm, Response
from dynident.actuators.joint_load import rigid_inertia
from dynident.actuators.parameters import PLACE, SCALE_POWER, with_zero
from dynident.actuators.verdict import DRAWS, score_covariance
from dynident.arrays import Array
from dynident.model.base_parameters import BaseParameters
from dynident.model.kernels import batched
from dynident.model.reduction import triangle_of

#: Change of a base parameter by which derivatives are found, as a share of the torque of the bodies. Larger ones move
#: reversals and saturation from step to step: what bodies and drives share would seem to be known.
_CHANGE = 1e-6

#: Change of the zero of an encoder by which derivatives are found, in rad.
_TURN = 1e-3

#: Singular values below this share of the largest, of columns of unit length, are directions that the errors of a joint
#: do not see.
_UNSEEN = 1e-6


@dataclass(frozen=True)
class BodyRows:
    """What the roll-outs of all joints give of a change of the base parameters beta, shape (b,).

    Attributes:
        rows: In standard deviations of the errors, shape (r, b).
        errors: The same of the errors as they are, shape (r,).
        noise: Covariance of these, shape (r, r).
        theta: The bodies, shape (10 l,).
        base: Their base parameters, shape (b,).
        along: How large others are beside them is ``along @ beta``, shape (b,).
        drives: What the P free parameters of all joints answer to a change, shape (P, b).
        powers: What they change by with a scale of all bodies and torques, shape (P,).
        offset: What they answer to the errors, shape (P,).
        pieces: Number of pieces of logs that count as independent.
    """

    rows: Array
    errors: Array
    noise: Array
    theta: Array
    base: Array
    along: Array
    drives: Array
    powers: Array
    offset: Array
    pieces: int

    def answer(self, beta: Array) -> Array:
        """Return what the free parameters answer to base parameters, shape (P,)."""
        size = float(self.along @ beta)
        return np.asarray(self.drives @ (beta / size - self.base + (size - 1.0) * self.base))


def body_rows(arm: Arm, base: BaseParameters, along_base: Array, theta: Array, finely: bool) -> BodyRows:
    """Return what the roll-outs give of the base parameters, from the torque of the bodies theta, shape (10 l,).

    The zero of an encoder turns all bodies behind it: zeros are found from the errors of all joints together.

    Args:
        arm: With the fits of its joints.
        base: Base parameters of its robot.
        along_base: How large bodies are beside those of the robot model is ``along_base @ beta``, shape (b,).
        theta: The bodies that its motions are by.
        finely: Whether with the step of the answer.
    """
    columns, inertias = (
        [
            np.dstack([each[:, :, base.independent], each @ (rigid_inertia(robot) - theta)])
            for robot, each in zip(arm.robots, regressors, strict=False)
        ]
        for regressors in (regressors_of(arm), _inertia_regressors(arm))
    )
    zeros = 0
    for joint, (fit, used) in enumerate(zip(arm.fits, arm.used, strict=True)):
        if "angle_offset" in fit.free:
            zero, zeros = float(used[PLACE["angle_offset"]]), zeros + 1
            after, before = (arm.torques(joint, with_zero(used, zero + by), is_whole=False) for by in (_TURN, -_TURN))
            turn = [(one - other) / (2.0 * _TURN) for one, other in zip(after, before, strict=True)]
            columns = [np.dstack([own, each]) for own, each in zip(columns, turn, strict=True)]
    beta, each = base.from_standard(theta), []
    spreads = arm.fine_spreads([None] * len(arm.fits)) if finely else arm.spreads()
    count, size = len(beta), along_base / (along_base @ beta)
    scale, along = np.append(beta, 1.0), np.append(size, np.zeros(zeros + 2))
    for joint, ((one, fit), spread) in enumerate(zip(arm.pairs(), spreads, strict=True)):
        inner = spread.inner & (np.array(one.free) != "angle_offset")
        response = Response(one.finely if finely else one, fit, replace(spread, inner=inner, seen=np.ones_like(inner)))
        loads = [
            _load_changes(torque[:, joint], inertia[:, joint], motion.ddq[:, joint])
            for torque, inertia, motion in zip(columns, inertias, arm.motions, strict=False)
        ]
        draws = DRAWS if finely else 0
        rows, answers, noise = _of_joint(response, loads, [own[:, joint] for own in columns], beta, draws)
        own = np.where(inner, SCALE_POWER[one.places] * fit.parameters[one.places], 0.0)
        # bodies, what is carried and all torques of one scale move alike; what is left of that is an error of columns
        left = _complement(rows[:, : count + 1] @ scale)
        each.append(
            (left @ rows, answers + np.outer(own - answers[:, : count + 1] @ scale, along), own, left @ noise @ left)
        )
    rows, answers, powers = (np.concatenate(parts) for parts in list(zip(*each, strict=True))[:3])
    whole, turns, errors = slice(count), slice(count + 1, count + 1 + zeros), -1
    turned, triangle = np.linalg.qr(np.column_stack([rows[:, turns], rows[:, whole]]))
    left, noise = turned.T @ rows[:, errors], turned.T @ block_diag(*[parts[3] for parts in each]) @ turned
    of_zeros = -np.linalg.solve(triangle[:zeros, :zeros], np.column_stack([triangle[:zeros, zeros:], left[:zeros]]))
    drives = np.column_stack([answers[:, whole], answers[:, errors]]) + answers[:, turns] @ of_zeros
    drives[arm.zeros] = of_zeros
    own, pieces = slice(zeros, None), sum(one.pieces for one in spreads)
    said = triangle[own, zeros:], left[own], noise[own, own]
    return BodyRows(*said, theta, beta, size, drives[:, :-1], powers, drives[:, -1], pieces)


def _of_joint(
    response: Response, loads: Sequence[Array], columns: Sequence[Array], beta: Array, draws: int
) -> tuple[Array, Array, Array]:
    """Return rows of a joint and what its free parameters answer, from its torque by c numbers in each log, (K, c).

    Both have the errors in their last column, shapes (r, c + 1) and (f, c + 1); the first b of the c numbers are beta.
    Rows and errors are in standard deviations of the errors, whose covariance is the third, shape (r, r).
    """
    rms = float(np.sqrt(np.mean(np.concatenate([own[:, : len(beta)] @ beta for own in columns]) ** 2)))
    sizes = np.sqrt(np.mean(np.concatenate(columns) ** 2, axis=0))
    moves = np.flatnonzero(sizes * max(float(np.abs(beta).max()), 1.0) > 1e-9 * rms)
    changes = []
    for k in moves.tolist():
        size = _CHANGE * rms / sizes[k]
        changes.append([change / size for change in response.changes([size * own[:, :, k] for own in loads])])
    slopes, errors, answer = response.less_own([np.column_stack(own) for own in zip(*changes, strict=True)])
    rows = np.concatenate(slopes)
    norms = np.maximum(np.linalg.norm(rows, axis=0), 1e-300)
    _, values, vectors = np.linalg.svd(triangle_of(rows / norms))
    seen = values > _UNSEEN * values[0]
    into = vectors[seen].T / values[seen] / norms[:, None]  # rows times this are orthonormal
    units = [slope @ into for slope in slopes]
    left = sum((own.T @ error for own, error in zip(units, errors, strict=True)), np.zeros(len(into.T)))
    rest = [(e - own @ left) / size for e, own, size in zip(errors, units, response.scales, strict=True)]
    noise = score_covariance(response.problem.records, rest, units, response.scales, draws).covariance
    unit = np.sqrt(np.trace(noise) / len(noise))
    places = [*moves.tolist(), len(sizes)]
    found = np.zeros((len(noise), len(sizes) + 1)), np.zeros((len(answer), len(sizes) + 1))
    found[0][:, places] = np.column_stack([values[seen, None] * vectors[seen] * norms, left]) / unit
    found[1][:, places] = answer
    return *found, noise / unit**2


def _complement(direction: Array) -> Array:
    """Return the projection on what is not along a direction (r,), shape (r, r)."""
    square = float(direction @ direction)
    whole = np.eye(len(direction))
    return whole - np.outer(direction, direction) / square if square > 0 else whole


def regressors_of(arm: Arm) -> list[Array]:
    """Return the regressor of the standard parameters in each training log, shape (K, n, 10 l)."""
    return [
        batched.torque_regressor(robot.chain, motion.q, motion.dq, motion.ddq)
        for robot, motion, _ in zip(arm.robots, arm.motions, arm.datas[0].train, strict=False)
    ]


def _inertia_regressors(arm: Arm) -> list[Array]:
    """Return that of the inertia about each joint, the others held, shape (K, n, 10 l)."""
    found = []
    for robot, motion, _ in zip(arm.robots, arm.motions, arm.datas[0].train, strict=False):
        still = np.zeros_like(motion.q)
        weight, own = batched.torque_regressor(robot.chain, motion.q, still, still), []
        for joint in range(robot.dof):
            pushed = still.copy()
            pushed[:, joint] = 1.0
            own.append((batched.torque_regressor(robot.chain, motion.q, still, pushed) - weight)[:, joint])
        found.append(np.stack(own, axis=1))
    return found


def _load_changes(torque: Array, inertia: Array, acceleration: Array) -> Array:
    """Return the change of inertia and bias torque about a joint, shape (K, 2, c).

    Args:
        torque: Of the bodies along the motion, shape (K, c); the last of the c numbers may have no inertia.
        inertia: Shape (K, at most c).
        acceleration: Of the joint, shape (K,).
    """
    whole = np.zeros_like(torque)
    whole[:, : inertia.shape[1]] = inertia
    return np.stack([whole, torque - whole * acceleration[:, None]], axis=1)
