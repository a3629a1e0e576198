"""The compiled tangent of the tracking loop: the exact derivative of its result by the parameters of the plant."""

from __future__ import annotations

import numpy as np

from dynident.arrays import Array, IntArray
from dynident.model.kernels.jit import compiled, inlined


@inlined
def add_product(matrix: Array, block: Array, sign: float, total: Array) -> None:
    """Add sign * matrix (n, n) @ block (n, b) to total (n, b)."""
    for i in range(len(total)):
        for j in range(len(block)):
            factor = sign * matrix[i, j]
            for k in range(block.shape[1]):
                total[i, k] += factor * block[j, k]


@inlined
def copy(block: Array, into: Array) -> None:
    """Write a block (n, b); an assignment of arrays would compile the words of its errors with it."""
    for i in range(len(block)):
        for k in range(block.shape[1]):
            into[i, k] = block[i, k]


@inlined
def add_scaled(block: Array, factor: float, total: Array) -> None:
    """Add factor * block to total, both (n, b)."""
    for i in range(len(total)):
        for k in range(total.shape[1]):
            total[i, k] += factor * block[i, k]


@inlined
def carried(gains: Array, fed: Array, place: Array, torque: Array) -> None:
    """Write the derivative of the controller's torque (n, b) from those of the torque fed and of the state."""
    for i in range(len(torque)):
        for k in range(torque.shape[1]):
            torque[i, k] = fed[i, k] - gains[0, i] * place[0, i, k] - gains[1, i] * place[1, i, k]


@compiled
def tangent(
    slopes_of: tuple[Array, Array, Array, Array],
    gains: Array,
    fed: Array,
    counts: IntArray,
    step: float,
    state: Array,
    torque: Array,
    out: Array,
) -> None:
    """Carry the derivatives by b parameters along the steps of ``tracking_loop.tracking``.

    M d(ddq) = d(tau) - K_q d(q) - K_dq d(dq) - Y at every stage of every step: the forward sensitivity equations,
    integrated by the same rule, which is the exact derivative of the discrete simulation.

    Args:
        slopes_of: At every stage the derivatives of the inverse dynamics by q, dq (S, 4, n, n) and by the parameters
            (S, 4, n, b), and the inverse of the mass matrix (S, 4, n, n).
        gains: Stiffness and damping, (2, n).
        fed: Derivatives of the torque fed forward at every half step, (2 S + 1, n, b).
        counts: As of the tracking loop.
        step: Length of a step in s.
        state: Derivatives of q and dq at the start, (2, n, b); overwritten by those at the end.
        torque: Derivative of the torque that is held, (n, b); overwritten.
        out: Rows of the derivatives of q and of the torque, (S / steps per row, 2, n, b).
    """
    by_q, by_dq, by_beta, inverse = slopes_of
    joints, count = state.shape[1], state.shape[2]
    slopes, place, rest = np.zeros((4, 2, joints, count)), np.empty(state.shape), np.empty((joints, count))
    per_row, held, first = counts[0], counts[1], counts[2]
    for k in range(len(by_q)):
        if held > 0 and (first + k) % held == 0:
            carried(gains, fed[2 * k], state, torque)
        for stage in range(4):
            share = 0.0 if stage == 0 else (step if stage == 3 else 0.5 * step)
            for order in range(2):
                copy(state[order], place[order])
                add_scaled(slopes[max(stage - 1, 0), order], share, place[order])
            if held == 0:
                carried(gains, fed[2 * k + (stage + 1) // 2], place, torque)
            if stage == 0 and k % per_row == 0:
                copy(state[0], out[k // per_row, 0])
                copy(torque, out[k // per_row, 1])
            copy(torque, rest)
            add_scaled(by_beta[k, stage], -1.0, rest)
            add_product(by_q[k, stage], place[0], -1.0, rest)
            add_product(by_dq[k, stage], place[1], -1.0, rest)
            copy(place[1], slopes[stage, 0])
            slopes[stage, 1] = 0.0
            add_product(inverse[k, stage], rest, 1.0, slopes[stage, 1])
        for stage in range(4):
            share = step / 6.0 if stage in (0, 3) else step / 3.0
            for order in range(2):
                add_scaled(slopes[stage, order], share, state[order])
