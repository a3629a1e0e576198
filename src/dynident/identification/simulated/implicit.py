"""Implicit steps of the simulated closed loop: the rule, its nodes and the exact derivative of its result.

Stiff friction and light wrists make an explicit rule take hundreds of steps a row, only to stay stable. The rule here
is stable at every step, so that steps follow the motion. The derivative by the parameters is that of the discrete
simulation: the equations of the stages, differentiated, are linear.
"""

from __future__ import annotations

import numpy as np

from dynident.arrays import Array, IntArray

_ROOT = np.sqrt(6.0)

#: Where the stages stand in a step, the last at its end.
NODES = np.array([(4 - _ROOT) / 10, (4 + _ROOT) / 10, 1.0])

_SPEEDS = np.array(
    [
        [(88 - 7 * _ROOT) / 360, (296 - 169 * _ROOT) / 1800, (-2 + 3 * _ROOT) / 225],
        [(296 + 169 * _ROOT) / 1800, (88 + 7 * _ROOT) / 360, (-2 - 3 * _ROOT) / 225],
        [(16 - _ROOT) / 36, (16 + _ROOT) / 36, 1 / 9],
    ]
)

#: Velocities and positions of the stages from their accelerations, in units of the step and its square, (2, 3, 3).
RULE = np.array([_SPEEDS, _SPEEDS @ _SPEEDS])

#: Places of the reference in a step: its start and its first two stages.
PLACES = np.array([0.0, *NODES[:2]])


def implicit_tangent(
    slopes: tuple[Array, Array, Array, Array],
    gains: Array,
    fed: Array,
    counts: IntArray,
    step: float,
    state: Array,
    torque: Array,
) -> Array:
    """Carry the derivatives by b parameters along implicit steps.

    Args:
        slopes: At every stage the derivatives of the inverse dynamics by q, dq (S, 3, n, n), by the parameters
            (S, 3, n, b) and by ddq, the mass matrix (S, 3, n, n).
        gains: Stiffness and damping, (2, n).
        fed: Derivatives of the torque fed forward at the start and the first two stages of every step, and at the end,
            (3 S + 1, n, b).
        counts: Steps per row, steps of held torque, number of the first step.
        step: Length of a step in s.
        state: Derivatives of q and dq at the start, (2, n, b); overwritten by those at the end.
        torque: Derivative of the torque that is held, (n, b); overwritten.

    Returns:
        Derivatives of q and of the torque at the rows, (S / steps per row, 2, n, b).
    """
    steps, _, joints, count = slopes[2].shape
    per_row, held, first = (int(c) for c in counts)
    answers = _answers(slopes, gains, fed, step, held == 0)
    out = np.empty((steps // per_row, 2, joints, count))
    speeds, places = step * RULE[0, -1], step**2 * RULE[1, -1]
    for k in range(steps):
        if held == 0 or (first + k) % held == 0:
            torque[:] = fed[3 * k] - gains[0][:, None] * state[0] - gains[1][:, None] * state[1]
        if k % per_row == 0:
            out[k // per_row, 0], out[k // per_row, 1] = state[0], torque
        answer = answers[k]
        found = answer[:, 3 * joints :] + answer[:, : 2 * joints] @ state.reshape(2 * joints, count)
        if held:
            found += answer[:, 2 * joints : 3 * joints] @ torque
        accelerations = found.reshape(3, -1)
        state[0] += step * state[1] + (places @ accelerations).reshape(joints, count)
        state[1] += (speeds @ accelerations).reshape(joints, count)
    return out


def _answers(
    slopes: tuple[Array, Array, Array, Array], gains: Array, fed: Array, step: float, continuous: bool
) -> Array:
    """Return how the accelerations of all stages answer to q, dq, held torque and parameters, (S, 3 n, 3 n + b)."""
    by_q, by_dq, by_beta, mass = slopes
    if continuous:
        by_q, by_dq = by_q + np.diag(gains[0]), by_dq + np.diag(gains[1])
    steps, stages, joints, count = by_beta.shape
    matrix = step * np.einsum("ij,siac->siajc", RULE[0], by_dq) + step**2 * np.einsum("ij,siac->siajc", RULE[1], by_q)
    for i in range(stages):
        matrix[:, i, :, i] += mass[:, i]
    right = np.empty((steps, stages, joints, 3 * joints + count))
    right[..., :joints] = -by_q
    right[..., joints : 2 * joints] = -by_dq - step * NODES[:, None, None] * by_q
    right[..., 2 * joints : 3 * joints] = 0.0 if continuous else np.eye(joints)
    right[..., 3 * joints :] = -by_beta
    if continuous:
        for i in range(stages):
            right[:, i, :, 3 * joints :] += fed[i + 1 :: stages][:steps]
    return np.linalg.solve(
        matrix.reshape(steps, stages * joints, -1), right.reshape(steps, stages * joints, 3 * joints + count)
    )
