"""The compiled loop of the virtual cell: a sampled controller around drives, friction, springs and bodies (RK4)."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np

from dynident.arrays import Array, IntArray
from dynident.model.kernels.generic import WORK, bias_torque, placed_mass, solve
from dynident.model.kernels.jit import compiled, inlined
from dynident.simulation.friction_machine import DQ, RISE, TEMPERATURE, Friction, Q, begin, lose, place, remember

#: links, reals, gravity and theta as in generic.py; inertia of the rotors at the joints (n, n); known torque beside the
#: drives, at the joints and as if at the drives (2, n); coupling (n, n) with motor speed = coupling @ joint speed, and
#: its inverse.
Bodies: TypeAlias = tuple[IntArray, Array, Array, Array, Array, Array, Array, Array]

#: Of the drives: smooth friction, and the dry friction that bristles stand for, as in friction_machine.py; waves
#: (w, 4): drive, cycles, and the factors of sine and cosine; bristles (2, n): stiffness s0, damping s1, or (0, n);
#: stiction: share and speed (2,); springs (3, n): stiffness, damping, rotor inertia, or (0, n) for stiff joints; heat
#: (3, n): rise in the end, its decay in 1/s, 1 where friction depends on temperature or 0; first temperature (n,).
Drives: TypeAlias = tuple[Friction, Friction, Array, Array, Array, Array, Array, Array]

#: Rows of the state: joint positions and speeds, drive positions and speeds (of springs), deflection of the bristles.
STATES = 5

#: Rows of a logged sample: q, dq, ddq; torque of the drives, friction, and torque of the springs, at the joints;
#: positions and speeds of the drives carried to the joints; by how much the torque jumps there.
ROWS = 9

#: What the law is told of the robot, any tuple; its settings (s, n); largest torques at the joints (n,); sensors as in
#: :func:`look`; length of a step and of a tick of the controller in s, decay of the currents over half a step (0 for
#: currents that follow at once), share of the old velocity that the controller's filter keeps, (4,).
Control: TypeAlias = tuple[Any, Array, Array, Array, Array]

#: mass (n, n); vectors (8, n); work of the kernels; slopes (4, STATES, n); place (STATES, n).
Scratch: TypeAlias = tuple[Array, Array, Array, Array, Array]


@inlined
def bend(drives: Drives, j: int, dq: float, level: float, slack: float) -> tuple[float, float]:
    """Return the torque of the bristles of drive j and their speed.

    Args:
        drives: See :data:`Drives`.
        j: The drive.
        dq: Its speed.
        level: Its dry friction.
        slack: Deflection of its bristles.
    """
    bristles, stiction = drives[3], drives[4]
    if bristles[0, j] <= 0.0:
        return 0.0, 0.0
    level = abs(level) * (1.0 + stiction[0] * math.exp(-((dq / stiction[1]) ** 2)))
    slip = dq - bristles[0, j] * abs(dq) * slack / max(level, 1e-9 * bristles[0, j])
    if abs(slip) > 5.0 * abs(dq) and dq != 0.0:  # the steps are too long for so fast a slip
        slip = math.nan
    return bristles[0, j] * slack + bristles[1, j] * slip, slip


@inlined
def drag(drives: Drives, state: Array, rise: Array, drawn: Array, rate: Array, lost: Array, level: Array) -> None:
    """Write the friction of the drives (n,), whose motion stands in the memory, and the speed of their bristles.

    drawn (n,): torque that they give to friction and load together, or the load itself where there are springs.
    """
    smooth, dry, waves, bristles, springs, start = drives[0], drives[1], drives[2], drives[3], drives[5], drives[7]
    joints, soft = len(lost), len(bristles) > 0
    for j in range(joints):
        smooth[1][TEMPERATURE, j], smooth[1][RISE, j] = start[j] + rise[j], rise[j]
        if soft and len(springs) == 0:
            drawn[j] -= bristles[0, j] * state[4, j]
    lose(smooth, drawn, len(springs) > 0, lost)
    if soft:
        for j in range(joints):
            for row in (Q, DQ, TEMPERATURE, RISE):
                dry[1][row, j] = smooth[1][row, j]
            if len(springs) == 0:
                drawn[j] -= lost[j]
        lose(dry, drawn, True, level)
    for j in range(joints):
        q, dq = smooth[1][Q, j], smooth[1][DQ, j]
        rate[4, j] = 0.0
        if soft:
            held, rate[4, j] = bend(drives, j, dq, level[j], state[4, j])
            lost[j] += held
        for k in range(len(waves)):
            if int(waves[k, 0]) == j:
                lost[j] += waves[k, 2] * math.sin(waves[k, 1] * q) + waves[k, 3] * math.cos(waves[k, 1] * q)


@inlined
def load_joints(
    bodies: Bodies, drives: Drives, state: Array, torque: Array, rise: Array, rate: Array, vectors: Array
) -> None:
    """Write what the drives give the joints under their torques (n,), less friction: row 1 of the rate (STATES, n).

    All other rows of the rate are written too. Friction of the drives and torque of the springs go to rows 2 and 3 of
    the vectors.
    """
    beside, coupling, springs, smooth = bodies[5], bodies[6], drives[5], drives[0]
    joints, elastic = len(torque), len(springs) > 0
    lost, spring, left, level = vectors[2], vectors[3], vectors[4], vectors[7]
    place(smooth, coupling, state[0], state[1])
    for j in range(joints):
        left[j] = torque[j] + beside[1, j]
        if elastic:
            q, dq = smooth[1][Q, j], smooth[1][DQ, j]
            spring[j] = springs[0, j] * (state[2, j] - q) + springs[1, j] * (state[3, j] - dq)
            left[j] = spring[j]
            smooth[1][Q, j], smooth[1][DQ, j] = state[2, j], state[3, j]
    drag(drives, state, rise, left, rate, lost, level)
    for j in range(joints):
        left[j] = torque[j] - lost[j]
        if elastic:
            rate[2, j], rate[3, j] = state[3, j], (torque[j] - lost[j] - spring[j]) / springs[2, j]
            left[j] = spring[j]
    for i in range(joints):
        given = beside[0, i]
        for j in range(joints):
            given += coupling[j, i] * left[j]
        rate[0, i], rate[1, i] = state[1, i], given


@inlined
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


@inlined
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
    joints, rows = len(rise), STATES if len(drives[3]) > 0 or len(drives[5]) > 0 else 2
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


@inlined
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


@inlined
def feel(seen: Array, felt: Array, sensors: Array, period: float, keep: float, first: bool) -> None:
    """Write q and dq as the controller takes them, (2, n): differences where asked for, and its velocity filter."""
    for i in range(seen.shape[1]):
        speed = seen[1, i]
        if sensors[1, i] == 0.0:
            speed = 0.0 if first else (seen[0, i] - felt[0, i]) / period
        felt[1, i] = speed if first else keep * felt[1, i] + (1.0 - keep) * speed
        felt[0, i] = seen[0, i]


@inlined
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


@inlined
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


@inlined
def drive(torques: Array, wanted: Array, decay: float, rise: Array, heat: Array, time: float) -> None:
    """Write the torques (3, n) of the drives over a step from where the last one left them, and their heat."""
    for j in range(len(wanted)):
        begin = torques[2, j] if decay > 0.0 else wanted[j]
        torques[0, j] = begin
        torques[1, j] = wanted[j] + (begin - wanted[j]) * decay
        torques[2, j] = wanted[j] + (begin - wanted[j]) * decay * decay
        if heat[2, j] > 0.0:
            rise[j] = heat[0, j] * (1.0 - math.exp(-heat[1, j] * time))


@inlined
def carry(bodies: Bodies, drives: Drives, state: Array, step: float) -> None:
    """Carry what the friction remembers over a step that has led to a state (STATES, n); at 0 s it begins there."""
    for friction in (drives[0], drives[1]):
        if len(friction[4]) > 0:
            place(friction, bodies[6], state[0], state[1])
            for j in range(state.shape[1] if len(drives[5]) > 0 else 0):
                friction[1][Q, j], friction[1][DQ, j] = state[2, j], state[3, j]
            if step > 0.0:
                remember(friction, step)
            else:
                begin(friction)


@compiled
def closed_cell(
    law: Callable[..., Any],
    bodies: Bodies,
    drives: Drives,
    control: Control,
    course: tuple[Array, Array],
    ticks: IntArray,
    start: tuple[Array, Array],
    out: Array,
) -> tuple[int, int]:
    """Run the cell and write one sample per logged tick.

    Args:
        law: Of the controller; see controllers/base.py.
        bodies: See :data:`Bodies`.
        drives: See :data:`Drives`.
        control: See :data:`Control`.
        course: Per tick of the controller the goals, (K, 5, n); per measured tick the noise of q and dq, (T, 2, n).
        ticks: Steps per control, per row and per row of noise; the first logged step; steps of the delay.
        start: State at step 0, (STATES, n), used as scratch; memory of the law, (m, n), zeros.
        out: Samples, (N, ROWS, n).

    Returns:
        The step at which the simulation failed, or -1; how many torques were cut at the limits in the logged part.
    """
    goals, noise, state, memory = course[0], course[1], start[0], start[1]
    joints = state.shape[1]
    model, settings, limits, sensors, reals = control
    robot = (limits, reals[1], model)
    per_control, per_row, per_noise, first, delay = ticks[0], ticks[1], ticks[2], ticks[3], ticks[4]
    work, slopes = np.zeros((len(bodies[0]) + 1, WORK)), np.zeros((4, STATES, joints))
    scratch = (np.empty((joints, joints)), np.zeros((8, joints)), work, slopes, np.zeros((STATES, joints)))
    seen, felt, carried, after = np.zeros((2, joints)), np.zeros((2, joints)), np.empty((2, joints)), state.copy()
    tau, rise, torques, before = np.zeros(joints), np.zeros(joints), np.zeros((3, joints)), np.zeros(joints)
    queue, row, cut = np.zeros((delay // per_control + 2, joints)), 0, 0
    carry(bodies, drives, state, 0.0)
    for tick in range(first + (len(out) - 1) * per_row + 1):
        logged, controlled = tick >= first and (tick - first) % per_row == 0, tick % per_control == 0
        if logged or controlled:
            look(bodies, drives, state, noise[tick // per_noise], sensors, seen, carried)
        if controlled:
            turn = tick // per_control
            feel(seen, felt, sensors, reals[1], reals[3], turn == 0)
            for i in range(joints):
                memory[0, i] = turn
            law(settings, goals[turn], felt, robot, memory, work, tau)
            found = command(tau, limits, bodies[7], queue, turn, torques)
            cut += found if tick >= first else 0
        wanted = queue[(max(tick - delay, 0) // per_control) % len(queue)]
        for j in range(joints):
            before[j] = torques[2, j]
        drive(torques, wanted, reals[2], rise, drives[6], reals[0] * max(tick - first, 0))
        if not advance(bodies, drives, state, torques, rise, reals[0], after, scratch):
            return tick, cut
        carry(bodies, drives, after, reals[0])
        if logged:
            keep_row(out[row], state, carried, torques[0], before, bodies, scratch)
            row += 1
        state, after = after, state
    return -1, cut
