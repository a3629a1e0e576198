"""The compiled loop of the virtual robot: a sampled joint controller around a plant that is integrated by RK4."""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np

from dynident.arrays import Array, IntArray
from dynident.model.kernels.generic import WORK, bias_torque, placed_mass, solve
from dynident.model.kernels.jit import compiled
from dynident.simulation.friction_machine import BY_LOAD, Friction, begin, lose, place, remember, warm

#: links, reals, gravity and theta as in generic.py; armature (n, n) at the joints; coupling (n, n) with motor speed =
#: coupling @ joint speed, and its inverse; known torque beside the drives (n,) at the joints; friction of the drives.
Plant: TypeAlias = tuple[IntArray, Array, Array, Array, Array, Array, Array, Array, Friction]

#: mass (n, n), vectors (4, n), work (l + 1, WORK), slopes (4, 2, n), place (2, n).
Scratch: TypeAlias = tuple[Array, Array, Array, Array, Array]


@compiled
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


@compiled
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


@compiled
def begin_at(plant: Plant, state: Array, number: int) -> None:
    """Take a state (2, n) as the one before the first step, where the number of the step is 0."""
    if number == 0:
        place(plant[8], plant[5], state[0], state[1])
        begin(plant[8])


@compiled
def runge_kutta(plant: Plant, state: Array, tau: Array, step: float, after: Array, scratch: Scratch) -> bool:
    """Write the state (2, n) one step later by the classical fourth-order rule; the slopes stay in the scratch."""
    slopes, place = scratch[3], scratch[4]
    joints = len(tau)
    for stage in range(4):
        before = stage - 1 if stage > 0 else 0
        share = 0.0 if stage == 0 else (step if stage == 3 else 0.5 * step)
        for i in range(joints):
            place[0, i] = state[0, i] + (share * slopes[before, 0, i] if stage > 0 else 0.0)
            place[1, i] = state[1, i] + (share * slopes[before, 1, i] if stage > 0 else 0.0)
            slopes[stage, 0, i] = place[1, i]
        if not acceleration(plant, place[0], place[1], tau, slopes[stage, 1], scratch):
            return False
    finite = True
    for i in range(joints):
        for k in range(2):
            slope = slopes[0, k, i] + 2.0 * (slopes[1, k, i] + slopes[2, k, i]) + slopes[3, k, i]
            after[k, i] = state[k, i] + step / 6.0 * slope
            finite = finite and math.isfinite(after[k, i])
    return finite


@compiled
def measure(state: Array, noise: Array, resolution: Array, seen: Array) -> None:
    """Write what the encoders, of a resolution (0 for none), say of q and dq (2, n) with their noise added."""
    for i in range(len(resolution)):
        position = state[0, i] + noise[0, i]
        if resolution[i] > 0.0:
            position = resolution[i] * math.floor(position / resolution[i] + 0.5)
        seen[0, i], seen[1, i] = position, state[1, i] + noise[1, i]


@compiled
def control(gains: Array, goal: Array, seen: Array, tau: Array) -> int:
    """Write the torque (n,) of the joint controller, cut at the limits; return how many joints were cut.

    gains (3, n): stiffness, damping, largest torque; goal (3, n): q, dq, torque fed forward; seen (2, n): q, dq.
    """
    cut = 0
    for i in range(len(tau)):
        wanted = goal[2, i] + gains[0, i] * (goal[0, i] - seen[0, i]) + gains[1, i] * (goal[1, i] - seen[1, i])
        tau[i] = max(-gains[2, i], min(gains[2, i], wanted))
        if tau[i] != wanted:
            cut += 1
    return cut


@compiled
def closed_loop(
    plant: Plant,
    control_of: tuple[Array, Array],
    reference: Array,
    noise: Array,
    clock: tuple[IntArray, float],
    state: Array,
    out: Array,
) -> tuple[int, int]:
    """Run the closed loop and write one row per logged tick.

    Args:
        plant: See :data:`Plant`.
        control_of: Gains, see :func:`control`; resolution of the encoders, (n,).
        reference: Per control tick the goal, (K, 3, n).
        noise: Per measured tick the noise of q and dq, (T, 2, n).
        clock: Ticks per control, per logged row, per row of noise, and the first logged tick; length of a tick in s.
        state: q and dq at tick 0, (2, n); overwritten.
        out: Rows of q, dq, ddq, torque, measured q, measured dq, (N, 6, n).

    Returns:
        The tick at which the simulation failed, or -1; how many torques were cut at the limits in the logged part.
    """
    joints, gains, resolution, ticks, step = state.shape[1], control_of[0], control_of[1], clock[0], clock[1]
    tau, seen, after = np.zeros(joints), np.empty((2, joints)), np.empty((2, joints))
    scratch = scratch_of(joints, len(plant[0]))
    per_control, per_row, per_noise, first = ticks[0], ticks[1], ticks[2], ticks[3]
    row, cut = 0, 0
    begin_at(plant, state, 0)
    for tick in range(first + (len(out) - 1) * per_row + 1):
        logged, controlled = tick >= first and (tick - first) % per_row == 0, tick % per_control == 0
        if logged or controlled:
            measure(state, noise[tick // per_noise], resolution, seen)
        if controlled:
            found = control(gains, reference[tick // per_control], seen, tau)
            cut += found if tick >= first else 0
        if not runge_kutta(plant, state, tau, step, after, scratch):
            return tick, cut
        for i in range(joints):
            if logged:
                out[row, 0, i], out[row, 1, i], out[row, 2, i] = state[0, i], state[1, i], scratch[3][0, 1, i]
                out[row, 3, i], out[row, 4, i], out[row, 5, i] = tau[i], seen[0, i], seen[1, i]
            state[0, i], state[1, i] = after[0, i], after[1, i]
        carry(plant, state, step)
        row += 1 if logged else 0
    return -1, cut


@compiled
def feedback(gains: Array, goal: Array, state: Array, tau: Array) -> None:
    """Write the torque (n,) of a joint controller; gains (2, n): stiffness, damping; goal (3, n): q, dq, torque fed."""
    for i in range(len(tau)):
        tau[i] = goal[2, i] + gains[0, i] * (goal[0, i] - state[0, i]) + gains[1, i] * (goal[1, i] - state[1, i])


@compiled
def keep(state: Array, ddq: Array, row: Array) -> None:
    """Write q and dq (2, n) and ddq (n,) into the first three of a row; arrays are slow to compile when assigned."""
    for i in range(len(ddq)):
        row[0, i], row[1, i], row[2, i] = state[0, i], state[1, i], ddq[i]


@compiled
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
