"""The compiled loop of estimators that simulate: a course followed under a joint controller, integrated by RK4."""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np

from dynident.arrays import Array, IntArray
from dynident.model.kernels.generic import WORK, bias_torque, placed_mass, solve
from dynident.model.kernels.jit import compiled, inlined
from dynident.simulation.friction_machine import BY_LOAD, Friction, begin, lose, place, remember, warm

#: links, reals, gravity and theta as in generic.py; armature (n, n) at the joints; coupling (n, n) with motor speed =
#: coupling @ joint speed, and its inverse; known torque beside the drives (n,) at the joints; friction of the drives.
Plant: TypeAlias = tuple[IntArray, Array, Array, Array, Array, Array, Array, Array, Friction]

#: mass (n, n), vectors (4, n), work (l + 1, WORK), slopes (4, 2, n), place (2, n).
Scratch: TypeAlias = tuple[Array, Array, Array, Array, Array]


@inlined
def acceleration(plant: Plant, q: Array, dq: Array, tau: Array, ddq: Array, scratch: Scratch) -> bool:
    """Write ddq (n,) with (M + armature) ddq + c + g + C' f(C dq) = tau + beside; False where M is singular."""
    links, reals, gravity, theta, armature, coupling, inverse, beside, friction = plant
    mass, vectors, work = scratch[0], scratch[1], scratch[2]
    joints = len(q)
    bias, drive, scale, drawn = vectors[0], vectors[1], vectors[2], vectors[3]
    bias_torque(links, reals, gravity, theta, q, dq, bias, work)
    placed_mass(links, reals, theta, mass, work)
    place(friction, coupling, q, dq)
    for j in range(joints if friction[2][BY_LOAD] >= 0 else 0):
        drawn[j] = 0.0
        for i in range(joints):
            drawn[j] += inverse[i, j] * (tau[i] + beside[i])
    lose(friction, drawn, False, drive)
    for i in range(joints):
        lost = bias[i] - beside[i]
        for j in range(joints):
            lost += coupling[j, i] * drive[j]
            mass[i, j] += armature[i, j]
        ddq[i] = tau[i] - lost
    return solve(mass, ddq, scale)


@inlined
def carry(plant: Plant, state: Array, step: float) -> None:
    """Carry what the friction remembers over a step that has led to a state (2, n)."""
    if len(plant[8][4]) > 0:
        place(plant[8], plant[5], state[0], state[1])
        remember(plant[8], step)


@compiled
def scratch_of(joints: int, links: int) -> Scratch:
    """Return arrays to work in."""
    mass, vectors, work = np.empty((joints, joints)), np.empty((4, joints)), np.empty((links + 1, WORK))
    return mass, vectors, work, np.empty((4, 2, joints)), np.empty((2, joints))


@inlined
def begin_at(plant: Plant, state: Array, number: int) -> None:
    """Take a state (2, n) as the one before the first step, where the number of the step is 0."""
    if number == 0:
        place(plant[8], plant[5], state[0], state[1])
        begin(plant[8])


@inlined
def feedback(gains: Array, goal: Array, state: Array, tau: Array) -> None:
    """Write the torque (n,) of a joint controller; gains (2, n): stiffness, damping; goal (3, n): q, dq, torque fed."""
    for i in range(len(tau)):
        tau[i] = goal[2, i] + gains[0, i] * (goal[0, i] - state[0, i]) + gains[1, i] * (goal[1, i] - state[1, i])


@inlined
def keep(state: Array, ddq: Array, row: Array) -> None:
    """Write q and dq (2, n) and ddq (n,) into the first three of a row; arrays are slow to compile when assigned."""
    for i in range(len(ddq)):
        row[0, i], row[1, i], row[2, i] = state[0, i], state[1, i], ddq[i]


@inlined
def keep_torque(tau: Array, row: Array) -> None:
    """Write the torque (n,) into the fourth of a row."""
    for i in range(len(tau)):
        row[3, i] = tau[i]


@compiled
def tracking(
    plant: Plant,
    gains: Array,
    goals: Array,
    clock: tuple[IntArray, float],
    state: Array,
    tau: Array,
    out: Array,
    stages: Array,
) -> int:
    """Follow a course without noise and without limits of the torque, as estimators that simulate do.

    Args:
        plant: See :data:`Plant`; its memory goes on where the call before has left it, unless the first step is 0.
        gains: See :func:`feedback`.
        goals: The course at every half step, (2 S + 1, 3, n) for S steps; (2 S + 1, 4, n) with temperatures of drives.
        clock: Steps per row, steps that the controller holds its torque, 0 for one that acts continuously, and the
            number of the first step; length of a step in s.
        state: q and dq at the start, (2, n); overwritten by those at the end.
        tau: The torque that is held, (n,); overwritten.
        out: Rows of q, dq, ddq, torque, (S / steps per row, 4, n).
        stages: q, dq and ddq at the four stages of every step, (S, 4, 3, n), or (0, 4, 3, n) to keep none.

    Returns:
        The step at which the simulation failed, or -1.
    """
    joints, counts, step = state.shape[1], clock[0], clock[1]
    per_row, held, first = counts[0], counts[1], counts[2]
    scratch = scratch_of(joints, len(plant[0]))
    slopes, place = scratch[3], scratch[4]
    begin_at(plant, state, first)
    for k in range(len(out) * per_row):
        warm(plant[8], goals[2 * k])
        if held > 0 and (first + k) % held == 0:
            feedback(gains, goals[2 * k], state, tau)
        for stage in range(4):
            share = 0.0 if stage == 0 else (step if stage == 3 else 0.5 * step)
            for i in range(joints):
                for order in range(2):
                    moved = share * slopes[stage - 1, order, i] if stage > 0 else 0.0
                    place[order, i] = state[order, i] + moved
                slopes[stage, 0, i] = place[1, i]
            if held == 0:
                feedback(gains, goals[2 * k + (stage + 1) // 2], place, tau)
            if not acceleration(plant, place[0], place[1], tau, slopes[stage, 1], scratch):
                return k
            if len(stages) > 0:
                keep(place, slopes[stage, 1], stages[k, stage])
            if stage == 0 and k % per_row == 0:
                keep(state, slopes[0, 1], out[k // per_row])
                keep_torque(tau, out[k // per_row])
        for i in range(joints):
            for order in range(2):
                slope = slopes[0, order, i] + 2.0 * (slopes[1, order, i] + slopes[2, order, i]) + slopes[3, order, i]
                state[order, i] += step / 6.0 * slope
                if not math.isfinite(state[order, i]):
                    return k
        carry(plant, state, step)
    return -1
