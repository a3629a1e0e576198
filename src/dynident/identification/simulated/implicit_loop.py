"""The compiled tracking loop for stiff robots: implicit Runge-Kutta steps, each solved by Newton's method.

Collocation at three points of Radau (Radau IIA, order 5; Hairer and Wanner 1996, section IV.5), written for the
accelerations of the stages, so that a step needs inverse dynamics only: M A + c + g + C' f(C V) = tau at each stage.
Friction and the controller's gains, which make the loop stiff, stand in the Newton matrix exactly; what gravity and
Coriolis torque add to it over a step is left to the iteration.
"""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np

from dynident.arrays import Array, IntArray
from dynident.model.kernels.generic import bias_torque, placed_mass, solve
from dynident.model.kernels.jit import compiled, inlined
from dynident.simulation.friction_machine import BY_LOAD, BY_SPEED, lose, place, warm
from dynident.simulation.tracking_loop import (
    Plant,
    acceleration,
    begin_at,
    carry,
    feedback,
    keep,
    keep_torque,
    scratch_of,
)

#: Newton steps at most; the change of the accelerations, against their size, that ends them.
NEWTON_STEPS, SETTLED = 40, 1e-11

#: Stages of a step.
STAGES = 3


#: Inverse dynamics: lost (n,), mass, slope and a place to work (3, n, n), drive (2, n), work (l + 1, WORK).
Torques: TypeAlias = tuple[Array, Array, Array, Array]

#: Newton's system: matrix (3 n, 3 n), change (3 n,), scale (3 n,).
System: TypeAlias = tuple[Array, Array, Array]


@inlined
def add_load_slopes(mass: Array, coupling: Array, inverse: Array, by_load: Array, work: Array) -> None:
    """Add C' diag(by_load) C^-T M to a mass matrix M (n, n): the torque that friction takes of the load."""
    joints = len(mass)
    for i in range(joints):
        for j in range(joints):
            work[i, j] = 0.0
            for k in range(joints):
                work[i, j] += inverse[k, i] * mass[k, j]
    for i in range(joints):
        for j in range(joints):
            for k in range(joints):
                mass[i, j] += coupling[k, i] * by_load[k] * work[k, j]


@inlined
def losses(plant: Plant, motion: Array, found: Torques) -> None:
    """Write the torque that a motion (3, n) takes, its slope by the acceleration and that of friction by the speed.

    The slope by the acceleration is the mass matrix with rotors, and what friction makes of the load in it.
    """
    links, reals, gravity, theta, armature, coupling, inverse, beside, friction = plant
    lost, matrices, drive, work = found
    memory, ends = friction[1], friction[2]
    mass, slope, joints = matrices[0], matrices[1], len(lost)
    bias_torque(links, reals, gravity, theta, motion[0], motion[1], lost, work)
    placed_mass(links, reals, theta, mass, work)
    for i in range(joints):
        for j in range(joints):
            mass[i, j] += armature[i, j]
            lost[i] += mass[i, j] * motion[2, j]
    for j in range(joints):
        drive[1, j] = 0.0
        for i in range(joints):
            drive[1, j] += inverse[i, j] * lost[i]
    place(friction, coupling, motion[0], motion[1])
    lose(friction, drive[1], True, drive[0])
    if ends[BY_LOAD] >= 0:
        add_load_slopes(mass, coupling, inverse, memory[ends[BY_LOAD]], matrices[2])
    for j in range(joints):
        drive[1, j] = memory[ends[BY_SPEED], j] if ends[BY_SPEED] >= 0 else 0.0
    for i in range(joints):
        lost[i] -= beside[i]
        for j in range(joints):
            lost[i] += coupling[j, i] * drive[0, j]
            slope[i, j] = 0.0
            for k in range(joints):
                slope[i, j] += coupling[k, i] * drive[1, k] * coupling[k, j]


@inlined
def place_stages(state: Array, rule: Array, step: float, motion: Array) -> None:
    """Write positions and speeds of the stages (3, 3, n) from their accelerations."""
    for i in range(STAGES):
        for a in range(state.shape[1]):
            motion[i, 0, a], motion[i, 1, a] = state[0, a], state[1, a]
        for j in range(STAGES):
            of_speed, of_place = step * rule[0, i, j], step * step * rule[1, i, j]
            for a in range(state.shape[1]):
                motion[i, 0, a] += of_speed * state[1, a] + of_place * motion[j, 2, a]
                motion[i, 1, a] += of_speed * motion[j, 2, a]


@inlined
def add_stage(i: int, rule: Array, step: float, gains: Array, tau: Array, found: Torques, system: System) -> None:
    """Write the rows of stage i of Newton's system; gains (2, n) are those that act within the step."""
    lost, matrices = found[0], found[1]
    joints = len(lost)
    for a in range(joints):
        row = system[0][i * joints + a]
        system[1][i * joints + a] = tau[a] - lost[a]
        for j in range(STAGES):
            of_speed, of_place = step * rule[0, i, j], step * step * rule[1, i, j]
            for c in range(joints):
                row[j * joints + c] = of_speed * matrices[1, a, c] + (matrices[0, a, c] if i == j else 0.0)
            row[j * joints + a] += of_speed * gains[1, a] + of_place * gains[0, a]


@inlined
def correct(motion: Array, change: Array, before: float, share: float) -> tuple[float, float, float]:
    """Add a share of Newton's change to the accelerations of the stages; return its size, theirs, and the share.

    Where friction turns its sign a step can overshoot: the share is halved while changes grow.
    """
    joints, moved, size = motion.shape[2], 0.0, 1.0
    for k in range(len(change)):
        moved = max(moved, abs(change[k]))
        size = max(size, abs(motion[k // joints, 2, k % joints]))
    share = 0.5 * share if moved > before else min(1.0, 2.0 * share)
    for k in range(len(change)):
        motion[k // joints, 2, k % joints] += share * change[k]
    return moved, size, share


@inlined
def guess(ddq: Array, motion: Array) -> None:
    """Write accelerations (n,) as those of all stages (3, 3, n), where Newton's method begins."""
    for i in range(STAGES):
        for a in range(len(ddq)):
            motion[i, 2, a] = ddq[a]


@compiled
def solve_stages(
    plant: Plant,
    gains: Array,
    goals: Array,
    clock: tuple[Array, bool, float],
    state: Array,
    tau: Array,
    motion: Array,
    scratch: tuple[Torques, System],
) -> bool:
    """Write q, dq and ddq at the stages (3, 3, n); goals (3, 3, n) are those of the stages. False where none is found.

    The accelerations that ``motion`` has are the start of the iteration; clock: the rule, whether the torque is held,
    and the length of the step in s.
    """
    rule, is_held, step = clock
    found, system = scratch
    before, share = np.inf, 1.0
    within = np.zeros_like(gains) if is_held else gains
    for _ in range(NEWTON_STEPS):
        place_stages(state, rule, step, motion)
        for i in range(STAGES):
            if not is_held:
                feedback(gains, goals[i], motion[i], tau)
            losses(plant, motion[i], found)
            add_stage(i, rule, step, within, tau, found, system)
        if not solve(system[0], system[1], system[2]):
            return False
        before, size, share = correct(motion, system[1], before, share)
        if before <= SETTLED * size:
            place_stages(state, rule, step, motion)
            return True
        if not math.isfinite(before):
            return False
    return False


@compiled
def implicit_tracking(
    plant: Plant,
    gains: Array,
    goals: Array,
    clock: tuple[IntArray, float, Array],
    state: Array,
    tau: Array,
    out: Array,
    stages: Array,
) -> int:
    """Follow a course as ``tracking_loop.tracking`` does, by implicit steps.

    Args:
        plant: As of the tracking loop.
        gains: Stiffness and damping, (2, n).
        goals: The course at the start and the first two stages of every step, and at the end, (3 S + 1, 3, n);
            (3 S + 1, 4, n) with temperatures of the drives, held over a step.
        clock: As of the tracking loop, with the coefficients of the velocities and of the positions in the
            accelerations of the stages, (2, 3, 3).
        state: q and dq at the start, (2, n); overwritten by those at the end.
        tau: The torque that is held, (n,); overwritten.
        out: Rows of q, dq, ddq, torque, (S / steps per row, 4, n).
        stages: q, dq and ddq at the three stages of every step, (S, 3, 3, n), or (0, 3, 3, n) to keep none.

    Returns:
        The step at which the simulation failed, or -1.
    """
    counts, step, rule = clock
    joints, per_row, held, first = state.shape[1], counts[0], counts[1], counts[2]
    scratch = scratch_of(joints, len(plant[0]))
    found = (np.empty(joints), np.empty((3, joints, joints)), np.empty((2, joints)), scratch[2])
    size = STAGES * joints
    system = (np.empty((size, size)), np.empty(size), np.empty(size))
    motion, now = np.zeros((STAGES, 3, joints)), np.zeros(joints)
    begin_at(plant, state, first)
    for k in range(len(out) * per_row):
        warm(plant[8], goals[3 * k])
        is_tick = held == 0 or (first + k) % held == 0
        if is_tick:
            feedback(gains, goals[3 * k], state, tau)
        guess(motion[STAGES - 1, 2], motion)
        if k % per_row == 0 or (held > 0 and is_tick):
            if not acceleration(plant, state[0], state[1], tau, now, scratch):
                return k
            guess(now, motion)
        if k % per_row == 0:
            keep(state, now, out[k // per_row])
            keep_torque(tau, out[k // per_row])
        at_stages = goals[3 * k + 1 : 3 * k + 1 + STAGES]
        if not solve_stages(plant, gains, at_stages, (rule, held > 0, step), state, tau, motion, (found, system)):
            return k
        for i in range(STAGES if len(stages) > 0 else 0):
            keep(motion[i], motion[i, 2], stages[k, i])
        for i in range(joints):
            state[0, i], state[1, i] = motion[STAGES - 1, 0, i], motion[STAGES - 1, 1, i]
        carry(plant, state, step)
    return -1
