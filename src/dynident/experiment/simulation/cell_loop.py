"""The compiled loop of the virtual cell: a sampled controller around drives, friction, springs and bodies (RK4)."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np

from dynident.arrays import Array, IntArray
from dynident.model.kernels.generic import WORK, bias_torque, placed_mass, solve
from dynident.model.kernels.jit import compiled

#: Speed, in rad/s or m/s, below which the cells of the friction tables are equally wide; their largest speed.
FINEST, FASTEST = 1e-3, 1e4

#: Cells of a table, half of them on each side of standstill, and the width of one in asinh(speed / FINEST).
CELLS = 4096
CELL = 2.0 * math.asinh(FASTEST / FINEST) / CELLS

#: Tables of a drive: torque at the first temperature, its change per degree, its change per unit of the load.
BASE, HEAT, LOAD = 0, 1, 2

#: links, reals, gravity and theta as in generic.py; inertia of the rotors at the joints (n, n); known torque beside the
#: drives, at the joints and as if at the drives (2, n); coupling (n, n) with motor speed = coupling @ joint speed, and
#: its inverse.
Bodies: TypeAlias = tuple[IntArray, Array, Array, Array, Array, Array, Array, Array]

#: Of the drives: smooth (2 or 3, n, cells, 4), dry (0, 2 or 3, n, cells, 4) and waves (w, 4) as in friction_tables.py;
#: bristles (2, n): stiffness s0, damping s1; stiction: share and speed (2,); springs (3, n): stiffness, damping, rotor
#: inertia, or (0, n) for stiff joints; heat (3, n): rise in the end, its decay in 1/s, 1 where friction depends on
#: temperature or 0.
Drives: TypeAlias = tuple[Array, Array, Array, Array, Array, Array, Array]

#: Rows of the state: joint positions and speeds, drive positions and speeds (of springs), deflection of the bristles.
STATES = 5

#: Rows of a logged sample: q, dq, ddq; torque of the drives, friction, and torque of the springs, at the joints;
#: positions and speeds of the drives carried to the joints; by how much the torque jumps there.
ROWS = 9

#: What the law is told of the robot, any tuple; its settings (s, n); largest torques at the joints (n,); sensors as in
#: :func:`look`; length of a step and of a tick of the controller in s, decay of the currents over half a step (0 for
#: currents that follow at once), share of the old velocity that the controller's filter keeps, (4,).
Control: TypeAlias = tuple[Any, Array, Array, Array, Array]

#: mass (n, n); vectors (7, n); work of the kernels; slopes (4, STATES, n); place (STATES, n).
Scratch: TypeAlias = tuple[Array, Array, Array, Array, Array]


@compiled
def torque_at(tables: Array, which: int, j: int, cell: int, x: float) -> float:
    """Return the value of one of the tables (3, n, cells, 4) of drive j at the share x of a cell."""
    highest = tables[which, j, cell, 2] + x * tables[which, j, cell, 3]
    return tables[which, j, cell, 0] + x * (tables[which, j, cell, 1] + x * highest)


@compiled
def friction(
    drives: Drives, j: int, q: float, dq: float, rise: float, drawn: float, slack: float
) -> tuple[float, float]:
    """Return the friction of drive j and the speed of its bristles.

    Args:
        drives: See :data:`Drives`.
        j: The drive.
        q: Its position.
        dq: Its speed.
        rise: Its temperature above the first, in K.
        drawn: Torque that it gives to friction and load together, or the load itself where there are springs.
        slack: Deflection of its bristles.
    """
    smooth, dry, waves, bristles, stiction, springs, _ = drives
    fast = abs(dq) / FINEST  # asinh by its logarithm; what that loses near 0 is far below a cell
    place = math.copysign(math.log(fast + math.sqrt(fast * fast + 1.0)), dq) / CELL + 0.5 * CELLS
    cell = min(max(int(place), 0), CELLS - 1)
    x = place - cell
    lost = torque_at(smooth, BASE, j, cell, x)
    if rise != 0.0:
        lost += rise * torque_at(smooth, HEAT, j, cell, x)
    for k in range(len(waves)):
        if int(waves[k, 0]) == j:
            lost += waves[k, 2] * math.sin(waves[k, 1] * q) + waves[k, 3] * math.cos(waves[k, 1] * q)
    held = bristles[0, j] * slack if len(dry) > 0 else 0.0
    load = drawn
    if len(smooth) > LOAD:
        share = torque_at(smooth, LOAD, j, cell, x)
        if len(springs) == 0:
            # load + share |load| = what friction without load leaves of the torque; |share| < 1 keeps its sign
            load = drawn - lost - held
            load /= 1.0 + (share if load > 0.0 else -share)
        lost += share * abs(load)
    if len(dry) == 0 or bristles[0, j] <= 0.0:
        return lost, 0.0
    level = torque_at(dry, BASE, j, cell, x) + rise * torque_at(dry, HEAT, j, cell, x)
    if len(dry) > LOAD:
        level += abs(load if len(springs) > 0 else drawn - lost - held) * torque_at(dry, LOAD, j, cell, x)
    level = abs(level)
    level *= 1.0 + stiction[0] * math.exp(-((dq / stiction[1]) ** 2))
    slip = dq - bristles[0, j] * abs(dq) * slack / max(level, 1e-9 * bristles[0, j])
    if abs(slip) > 5.0 * abs(dq) and dq != 0.0:  # the steps are too long for so fast a slip
        slip = math.nan
    return lost + held + bristles[1, j] * slip, slip


@compiled
def load_joints(
    bodies: Bodies, drives: Drives, state: Array, torque: Array, rise: Array, rate: Array, vectors: Array
) -> None:
    """Write what the drives give the joints under their torques (n,), less friction: row 1 of the rate (STATES, n).

    All other rows of the rate are written too. Friction of the drives and torque of the springs go to rows 2 and 3 of
    the vectors.
    """
    beside, coupling, springs = bodies[5], bodies[6], drives[5]
    joints, elastic = len(torque), len(springs) > 0
    lost, spring, left = vectors[2], vectors[3], vectors[4]
    for j in range(joints):
        q, dq = 0.0, 0.0
        for k in range(joints):
            q += coupling[j, k] * state[0, k]
            dq += coupling[j, k] * state[1, k]
        if elastic:
            spring[j] = springs[0, j] * (state[2, j] - q) + springs[1, j] * (state[3, j] - dq)
            lost[j], rate[4, j] = friction(drives, j, state[2, j], state[3, j], rise[j], spring[j], state[4, j])
            rate[2, j], rate[3, j] = state[3, j], (torque[j] - lost[j] - spring[j]) / springs[2, j]
            left[j] = spring[j]
        else:
            lost[j], rate[4, j] = friction(drives, j, q, dq, rise[j], torque[j] + beside[1, j], state[4, j])
            left[j] = torque[j] - lost[j]
    for i in range(joints):
        given = beside[0, i]
        for j in range(joints):
            given += coupling[j, i] * left[j]
        rate[0, i], rate[1, i] = state[1, i], given


@compiled
def slope(
    bodies: Bodies, drives: Drives, state: Array, torque: Array, rise: Array, rate: Array, scratch: Scratch
) -> bool:
    """Write the rate (STATES, n) of a state under the torques (n,) of the drives; False where a matrix is singular."""
    links, reals, gravity, theta, armature = bodies[0], bodies[1], bodies[2], bodies[3], bodies[4]
    mass, vectors, work = scratch[0], scratch[1], scratch[2]
    bias, scale = vectors[0], vectors[1]
    load_joints(bodies, drives, state, torque, rise, rate, vectors)
    bias_torque(links, reals, gravity, theta, state[0], state[1], bias, work)
    placed_mass(links, reals, theta, mass, work)
    for i in range(len(torque)):
        rate[1, i] -= bias[i]
        for j in range(len(torque)):
            mass[i, j] += armature[i, j]
    return solve(mass, rate[1], scale)


@compiled
def advance(
    bodies: Bodies,
    drives: Drives,
    state: Array,
    torques: Array,
    rise: Array,
    step: float,
    after: Array,
    scratch: Scratch,
) -> bool:
    """Write the state (STATES, n) one step later by the classical fourth-order rule.

    torques (3, n): of the drives at the start, the middle and the end of the step. The slopes stay in the scratch,
    friction and springs of the start in rows 5 and 6 of the vectors.
    """
    vectors, slopes, place = scratch[1], scratch[3], scratch[4]
    joints, rows = len(rise), STATES if len(drives[1]) > 0 or len(drives[5]) > 0 else 2
    for stage in range(4):
        share = 0.0 if stage == 0 else (step if stage == 3 else 0.5 * step)
        for k in range(rows):
            for i in range(joints):
                place[k, i] = state[k, i] + (share * slopes[stage - 1, k, i] if stage > 0 else 0.0)
        if not slope(bodies, drives, place, torques[(stage + 1) // 2], rise, slopes[stage], scratch):
            return False
        for i in range(joints if stage == 0 else 0):
            vectors[5, i], vectors[6, i] = vectors[2, i], vectors[3, i]
    finite = True
    for k in range(rows):
        for i in range(joints):
            whole = slopes[0, k, i] + 2.0 * (slopes[1, k, i] + slopes[2, k, i]) + slopes[3, k, i]
            after[k, i] = state[k, i] + step / 6.0 * whole
            finite = finite and abs(after[k, i]) < 1e12
    return finite


@compiled
def look(
    bodies: Bodies, drives: Drives, state: Array, noise: Array, sensors: Array, seen: Array, carried: Array
) -> None:
    """Write what the encoders say of q and dq, (2, n), and the drives' motion carried to the joints, (2, n).

    sensors (2, n): resolution, 1 where velocities are those of a sensor and 0 where they are left as they are.
    """
    inverse, elastic = bodies[7], len(drives[5]) > 0
    for i in range(seen.shape[1]):
        q, dq = state[0, i], state[1, i]
        if elastic:
            q, dq = 0.0, 0.0
            for k in range(seen.shape[1]):
                q += inverse[i, k] * state[2, k]
                dq += inverse[i, k] * state[3, k]
        carried[0, i], carried[1, i] = q, dq
        q += noise[0, i]
        if sensors[0, i] > 0.0:
            q = sensors[0, i] * math.floor(q / sensors[0, i] + 0.5)
        seen[0, i] = q
        if sensors[1, i] > 0.0:
            seen[1, i] = dq + noise[1, i]


@compiled
def feel(seen: Array, felt: Array, sensors: Array, period: float, keep: float, first: bool) -> None:
    """Write q and dq as the controller takes them, (2, n): differences where asked for, and its velocity filter."""
    for i in range(seen.shape[1]):
        speed = seen[1, i]
        if sensors[1, i] == 0.0:
            speed = 0.0 if first else (seen[0, i] - felt[0, i]) / period
        felt[1, i] = speed if first else keep * felt[1, i] + (1.0 - keep) * speed
        felt[0, i] = seen[0, i]


@compiled
def keep_row(
    out: Array, state: Array, carried: Array, torque: Array, before: Array, bodies: Bodies, scratch: Scratch
) -> None:
    """Write one logged sample (ROWS, n) of a state from which a step has been made.

    torque and before (n,): of the drives from here on, and until here.
    """
    coupling, vectors, first = bodies[6], scratch[1], scratch[3]
    for i in range(len(torque)):
        out[0, i], out[1, i], out[2, i] = state[0, i], state[1, i], first[0, 1, i]
        out[3, i], out[4, i], out[5, i] = 0.0, 0.0, 0.0
        out[6, i], out[7, i], out[8, i] = carried[0, i], carried[1, i], 0.0
        for j in range(len(torque)):
            out[3, i] += coupling[j, i] * torque[j]
            out[4, i] += coupling[j, i] * vectors[5, j]
            out[5, i] += coupling[j, i] * vectors[6, j]
            out[8, i] += coupling[j, i] * (torque[j] - before[j])


@compiled
def command(tau: Array, limits: Array, inverse: Array, queue: Array, control: int, torques: Array) -> int:
    """Cut the torques (n,) of the joints at the limits and queue those of the drives; return how many were cut."""
    cut = 0
    for i in range(len(tau)):
        within = max(-limits[i], min(limits[i], tau[i]))
        cut += 1 if within != tau[i] else 0
        tau[i] = within
    for j in range(len(tau)):
        wanted = 0.0
        for i in range(len(tau)):
            wanted += inverse[i, j] * tau[i]
        for k in range(len(queue)):
            if control == 0 or k == control % len(queue):  # the first one holds until it arrives
                queue[k, j] = wanted
        if control == 0:
            torques[2, j] = wanted
    return cut


@compiled
def drive(torques: Array, wanted: Array, decay: float, rise: Array, heat: Array, time: float) -> None:
    """Write the torques (3, n) of the drives over a step from where the last one left them, and their heat."""
    for j in range(len(wanted)):
        begin = torques[2, j] if decay > 0.0 else wanted[j]
        torques[0, j] = begin
        torques[1, j] = wanted[j] + (begin - wanted[j]) * decay
        torques[2, j] = wanted[j] + (begin - wanted[j]) * decay * decay
        if heat[2, j] > 0.0:
            rise[j] = heat[0, j] * (1.0 - math.exp(-heat[1, j] * time))


@compiled
def closed_cell(
    law: Callable[..., Any],
    bodies: Bodies,
    drives: Drives,
    control: Control,
    goals: Array,
    noise: Array,
    ticks: IntArray,
    state: Array,
    memory: Array,
    out: Array,
) -> tuple[int, int]:
    """Run the cell and write one sample per logged tick.

    Args:
        law: Of the controller; see controllers/base.py.
        bodies: See :data:`Bodies`.
        drives: See :data:`Drives`.
        control: See :data:`Control`.
        goals: Per tick of the controller, (K, 5, n).
        noise: Per measured tick of q and dq, (T, 2, n).
        ticks: Steps per control, per row and per row of noise; the first logged step; steps of the delay.
        state: At step 0, (STATES, n); used as scratch.
        memory: Of the law, (m, n), zeros.
        out: Samples, (N, ROWS, n).

    Returns:
        The step at which the simulation failed, or -1; how many torques were cut at the limits in the logged part.
    """
    joints, delay = state.shape[1], ticks[4]
    model, settings, limits, sensors, reals = control
    per_control, per_row, per_noise, first = ticks[0], ticks[1], ticks[2], ticks[3]
    work, slopes = np.zeros((len(bodies[0]) + 1, WORK)), np.zeros((4, STATES, joints))
    scratch = (np.empty((joints, joints)), np.zeros((7, joints)), work, slopes, np.zeros((STATES, joints)))
    seen, felt, carried, after = np.zeros((2, joints)), np.zeros((2, joints)), np.empty((2, joints)), state.copy()
    tau, rise, torques, before = np.zeros(joints), np.zeros(joints), np.zeros((3, joints)), np.zeros(joints)
    queue = np.zeros((delay // per_control + 2, joints))
    row, cut = 0, 0
    for tick in range(first + (len(out) - 1) * per_row + 1):
        logged, controlled = tick >= first and (tick - first) % per_row == 0, tick % per_control == 0
        if logged or controlled:
            look(bodies, drives, state, noise[tick // per_noise], sensors, seen, carried)
        if controlled:
            turn = tick // per_control
            feel(seen, felt, sensors, reals[1], reals[3], turn == 0)
            for i in range(joints):
                memory[0, i] = turn
            law(settings, goals[turn], felt, limits, reals[1], model, memory, work, tau)
            found = command(tau, limits, bodies[7], queue, turn, torques)
            cut += found if tick >= first else 0
        before[:] = torques[2]
        wanted = queue[(max(tick - delay, 0) // per_control) % len(queue)]
        drive(torques, wanted, reals[2], rise, drives[6], reals[0] * max(tick - first, 0))
        if not advance(bodies, drives, state, torques, rise, reals[0], after, scratch):
            return tick, cut
        if logged:
            keep_row(out[row], state, carried, torques[0], before, bodies, scratch)
            row += 1
        state, after = after, state
    return -1, cut
