"""Compiled dynamics of one sample for any tree of links; the loops over samples stand in generic_batches.py.

The functions below can be called inside another compiled loop (a simulation); none of them allocates.

    tables = pack(chain)                                   links (l, 3) int64, reals (l, 17), gravity (3,)
    work = np.empty((l + 1, WORK))                         scratch, one per thread; its last row is the base
    motion(links, reals, gravity, q, dq, ddq, 1.0, work); torque_of_motion(links, reals, theta, tau, work)
                                                                            tau (n,) <- M ddq + c + g
    bias_torque(links, reals, gravity, theta, q, dq, bias, work)            bias (n,) <- c + g (ddq = 0)
    joint_mass(links, reals, theta, q, mass, work)                          mass (n, n) <- M
    placed_mass(links, reals, theta, mass, work)            the same, right after a call above at the same q
    solve(matrix, vector, scale) -> bool     vector <- matrix^-1 vector, both overwritten, scale (n,) scratch;
                                             False where the matrix is singular (vector is then of no use)

theta (10 l,), q, dq, ddq, tau, bias (n,). Forward dynamics of one sample is bias_torque, joint_mass, add the armature,
solve(mass, tau - bias, scale).

Source: Newton-Euler in link frames, Luh, Walker and Paul 1980; the regressor by columns, Atkeson, An and Hollerbach
1986, (8)-(10), with the joint axes carried to the links; composite bodies, Walker and Orin 1982. Masses are never
divided by, so any real parameters are allowed.
"""

from __future__ import annotations

import math

import numpy as np

from dynident.arrays import Array, IntArray
from dynident.model.kernels.jit import inlined
from dynident.model.robot import PRISMATIC, Chain

#: Columns of the scratch array: rotation 0-8, translation 9-11, angular velocity 12-14, angular acceleration 15-17,
#: acceleration of the origin less gravity 18-20, force 21-23, moment 24-26, composite parameters 27-36.
WORK = 37

#: Largest ratio of a pivot to the scaled matrix that still counts as singular.
SINGULAR = 1e-14


def pack(chain: Chain) -> tuple[IntArray, Array, Array]:
    """Return the chain as the tables of the kernels.

    Returns:
        links (l, 3): parent, kind, joint; reals (l, 17): rotation (9), translation (3), axis (3), multiplier, offset;
        gravity (3,). All read-only.
    """
    links = np.stack([chain.parent, chain.kind, chain.joint], axis=1).astype(np.int64)
    size = chain.links
    parts = [chain.rotation.reshape(size, 9), chain.translation, chain.axis, chain.multiplier[:, None]]
    reals = np.concatenate([*parts, chain.offset[:, None]], axis=1)
    gravity = np.array(chain.gravity, dtype=np.float64)
    for array in (links, reals, gravity):
        array.setflags(write=False)
    return np.ascontiguousarray(links), np.ascontiguousarray(reals), gravity


@inlined
def rotate(frames: Array, i: int, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Return R v for the rotation in the first nine numbers of row i."""
    return (
        frames[i, 0] * x + frames[i, 1] * y + frames[i, 2] * z,
        frames[i, 3] * x + frames[i, 4] * y + frames[i, 5] * z,
        frames[i, 6] * x + frames[i, 7] * y + frames[i, 8] * z,
    )


@inlined
def turn_back(frames: Array, i: int, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Return R' v for the rotation in the first nine numbers of row i."""
    return (
        frames[i, 0] * x + frames[i, 3] * y + frames[i, 6] * z,
        frames[i, 1] * x + frames[i, 4] * y + frames[i, 7] * z,
        frames[i, 2] * x + frames[i, 5] * y + frames[i, 8] * z,
    )


@inlined
def cross(ax: float, ay: float, az: float, bx: float, by: float, bz: float) -> tuple[float, float, float]:
    """Return a x b."""
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx


@inlined
def place(links: IntArray, reals: Array, i: int, q: Array, work: Array) -> None:
    """Write the pose of link i in its parent at the joint positions q (Rodrigues' formula)."""
    position = reals[i, 15] * q[links[i, 2]] + reals[i, 16]
    ax, ay, az = reals[i, 12], reals[i, 13], reals[i, 14]
    for k in range(12):
        work[i, k] = reals[i, k]
    if links[i, 1] == PRISMATIC:
        sx, sy, sz = rotate(reals, i, ax, ay, az)
        work[i, 9] += sx * position
        work[i, 10] += sy * position
        work[i, 11] += sz * position
        return
    sine, cosine = math.sin(position), math.cos(position)
    versine = 1.0 - cosine
    for k in range(0, 9, 3):
        x, y, z = reals[i, k], reals[i, k + 1], reals[i, k + 2]
        along = (x * ax + y * ay + z * az) * versine
        work[i, k] = x * cosine + along * ax + (y * az - z * ay) * sine
        work[i, k + 1] = y * cosine + along * ay + (z * ax - x * az) * sine
        work[i, k + 2] = z * cosine + along * az + (x * ay - y * ax) * sine


@inlined
def move(links: IntArray, reals: Array, i: int, parent: int, speed: float, rate: float, work: Array) -> None:
    """Carry velocity and acceleration from row ``parent`` to link i, whose pose is placed."""
    px, py, pz = work[i, 9], work[i, 10], work[i, 11]
    wx, wy, wz = work[parent, 12], work[parent, 13], work[parent, 14]
    ex, ey, ez = work[parent, 15], work[parent, 16], work[parent, 17]
    sx, sy, sz = cross(wx, wy, wz, px, py, pz)
    cx, cy, cz = cross(wx, wy, wz, sx, sy, sz)
    sx, sy, sz = cross(ex, ey, ez, px, py, pz)
    vx, vy, vz = turn_back(work, i, work[parent, 18] + cx + sx, work[parent, 19] + cy + sy, work[parent, 20] + cz + sz)
    wx, wy, wz = turn_back(work, i, wx, wy, wz)
    ex, ey, ez = turn_back(work, i, ex, ey, ez)
    ax, ay, az = reals[i, 12], reals[i, 13], reals[i, 14]
    sx, sy, sz = cross(wx, wy, wz, ax, ay, az)
    if links[i, 1] == PRISMATIC:
        vx += ax * rate + 2.0 * sx * speed
        vy += ay * rate + 2.0 * sy * speed
        vz += az * rate + 2.0 * sz * speed
    else:
        wx, wy, wz = wx + ax * speed, wy + ay * speed, wz + az * speed
        ex, ey, ez = ex + ax * rate + sx * speed, ey + ay * rate + sy * speed, ez + az * rate + sz * speed
    work[i, 12], work[i, 13], work[i, 14] = wx, wy, wz
    work[i, 15], work[i, 16], work[i, 17] = ex, ey, ez
    work[i, 18], work[i, 19], work[i, 20] = vx, vy, vz


@inlined
def motion(
    links: IntArray, reals: Array, gravity: Array, q: Array, dq: Array, ddq: Array, share: float, work: Array
) -> None:
    """Place and move all links; the joint accelerations are share * ddq, so 0 gives the motion without them."""
    base = len(links)
    for k in range(12, 18):
        work[base, k] = 0.0
    for k in range(3):
        work[base, 18 + k] = -gravity[k]  # a base that accelerates upwards is gravity
    for i in range(base):
        joint, factor = links[i, 2], reals[i, 15]
        parent = base if links[i, 0] < 0 else links[i, 0]
        place(links, reals, i, q, work)
        move(links, reals, i, parent, factor * dq[joint], factor * share * ddq[joint], work)


@inlined
def inertia_times(tens: Array, at: int, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Return I v for the inertia in the six numbers of ``tens`` that begin at ``at``."""
    xy, xz, yz = tens[at + 1], tens[at + 2], tens[at + 4]
    return tens[at] * x + xy * y + xz * z, xy * x + tens[at + 3] * y + yz * z, xz * x + yz * y + tens[at + 5] * z


@inlined
def link_wrench(theta: Array, i: int, work: Array) -> None:
    """Write force (21-23) and moment (24-26) about its origin that move link i."""
    wx, wy, wz = work[i, 12], work[i, 13], work[i, 14]
    ex, ey, ez = work[i, 15], work[i, 16], work[i, 17]
    vx, vy, vz = work[i, 18], work[i, 19], work[i, 20]
    at = 10 * i
    hx, hy, hz, mass = theta[at + 6], theta[at + 7], theta[at + 8], theta[at + 9]
    sx, sy, sz = cross(wx, wy, wz, hx, hy, hz)
    cx, cy, cz = cross(wx, wy, wz, sx, sy, sz)
    sx, sy, sz = cross(ex, ey, ez, hx, hy, hz)
    work[i, 21], work[i, 22], work[i, 23] = mass * vx + cx + sx, mass * vy + cy + sy, mass * vz + cz + sz
    lx, ly, lz = inertia_times(theta, at, wx, wy, wz)
    sx, sy, sz = cross(wx, wy, wz, lx, ly, lz)
    cx, cy, cz = cross(hx, hy, hz, vx, vy, vz)
    lx, ly, lz = inertia_times(theta, at, ex, ey, ez)
    work[i, 24], work[i, 25], work[i, 26] = lx + sx + cx, ly + sy + cy, lz + sz + cz


@inlined
def torque_of_motion(links: IntArray, reals: Array, theta: Array, tau: Array, work: Array) -> None:
    """Sum the wrenches of the moved links from the tips to the base and write what the joints carry of them."""
    for k in range(len(tau)):
        tau[k] = 0.0
    for i in range(len(links)):
        link_wrench(theta, i, work)
    for i in range(len(links) - 1, -1, -1):
        at = 21 if links[i, 1] == PRISMATIC else 24
        effort = reals[i, 12] * work[i, at] + reals[i, 13] * work[i, at + 1] + reals[i, 14] * work[i, at + 2]
        tau[links[i, 2]] += reals[i, 15] * effort
        parent = links[i, 0]
        if parent >= 0:
            fx, fy, fz = rotate(work, i, work[i, 21], work[i, 22], work[i, 23])
            nx, ny, nz = rotate(work, i, work[i, 24], work[i, 25], work[i, 26])
            cx, cy, cz = cross(work[i, 9], work[i, 10], work[i, 11], fx, fy, fz)
            work[parent, 21] += fx
            work[parent, 22] += fy
            work[parent, 23] += fz
            work[parent, 24] += nx + cx
            work[parent, 25] += ny + cy
            work[parent, 26] += nz + cz


@inlined
def bias_torque(
    links: IntArray, reals: Array, gravity: Array, theta: Array, q: Array, dq: Array, bias: Array, work: Array
) -> None:
    """Write the torque (n,) of gravity and velocity, without accelerations; see the head of the file."""
    motion(links, reals, gravity, q, dq, dq, 0.0, work)
    torque_of_motion(links, reals, theta, bias, work)


@inlined
def add_to_parent(i: int, parent: int, work: Array) -> None:
    """Add the composite parameters (27-36) of link i to those of its parent, in whose frame they are written."""
    px, py, pz, mass = work[i, 9], work[i, 10], work[i, 11], work[i, 36]
    hx, hy, hz = rotate(work, i, work[i, 33], work[i, 34], work[i, 35])
    # R I R': the columns of R I, then its rows times R'
    ax, ay, az = rotate(work, i, work[i, 27], work[i, 28], work[i, 29])
    bx, by, bz = rotate(work, i, work[i, 28], work[i, 30], work[i, 31])
    cx, cy, cz = rotate(work, i, work[i, 29], work[i, 31], work[i, 32])
    xx, xy, xz = rotate(work, i, ax, bx, cx)
    _, yy, yz = rotate(work, i, ay, by, cy)
    _, _, zz = rotate(work, i, az, bz, cz)
    # about the new origin: r -> R r + p
    x, y, z = px * (2.0 * hx + mass * px), py * (2.0 * hy + mass * py), pz * (2.0 * hz + mass * pz)
    work[parent, 27] += xx + y + z
    work[parent, 28] += xy - hx * py - px * hy - mass * px * py
    work[parent, 29] += xz - hx * pz - px * hz - mass * px * pz
    work[parent, 30] += yy + x + z
    work[parent, 31] += yz - hy * pz - py * hz - mass * py * pz
    work[parent, 32] += zz + x + y
    work[parent, 33] += hx + mass * px
    work[parent, 34] += hy + mass * py
    work[parent, 35] += hz + mass * pz
    work[parent, 36] += mass


@inlined
def unit_wrench(links: IntArray, reals: Array, i: int, work: Array) -> tuple[float, float, float, float, float, float]:
    """Return force and moment that give the composite body of link i a unit acceleration of its joint."""
    ax, ay, az = reals[i, 12], reals[i, 13], reals[i, 14]
    hx, hy, hz, mass = work[i, 33], work[i, 34], work[i, 35], work[i, 36]
    if links[i, 1] == PRISMATIC:
        nx, ny, nz = cross(hx, hy, hz, ax, ay, az)
        return mass * ax, mass * ay, mass * az, nx, ny, nz
    fx, fy, fz = cross(ax, ay, az, hx, hy, hz)
    xy, xz, yz = work[i, 28], work[i, 29], work[i, 31]
    nx = work[i, 27] * ax + xy * ay + xz * az
    ny = xy * ax + work[i, 30] * ay + yz * az
    return fx, fy, fz, nx, ny, xz * ax + yz * ay + work[i, 32] * az


@inlined
def joint_mass(links: IntArray, reals: Array, theta: Array, q: Array, mass: Array, work: Array) -> None:
    """Write the mass matrix (n, n) of one sample by composite bodies; see the head of the file."""
    for i in range(len(links)):
        place(links, reals, i, q, work)
    placed_mass(links, reals, theta, mass, work)


@inlined
def placed_mass(links: IntArray, reals: Array, theta: Array, mass: Array, work: Array) -> None:
    """Write the mass matrix (n, n) of links that are placed already, as after bias_torque at the same q."""
    size = len(links)
    for i in range(size):
        for k in range(10):
            work[i, 27 + k] = theta[10 * i + k]
    mass[:, :] = 0.0
    for i in range(size - 1, -1, -1):
        if links[i, 0] >= 0:
            add_to_parent(i, links[i, 0], work)
        fx, fy, fz, nx, ny, nz = unit_wrench(links, reals, i, work)
        row, k = links[i, 2], i
        while k >= 0:
            x, y, z = nx, ny, nz
            if links[k, 1] == PRISMATIC:
                x, y, z = fx, fy, fz
            value = reals[i, 15] * reals[k, 15] * (reals[k, 12] * x + reals[k, 13] * y + reals[k, 14] * z)
            mass[row, links[k, 2]] += value
            if k != i:
                mass[links[k, 2], row] += value
            fx, fy, fz = rotate(work, k, fx, fy, fz)
            nx, ny, nz = rotate(work, k, nx, ny, nz)
            cx, cy, cz = cross(work[k, 9], work[k, 10], work[k, 11], fx, fy, fz)
            nx, ny, nz = nx + cx, ny + cy, nz + cz
            k = links[k, 0]


@inlined
def equilibrate(matrix: Array, vector: Array, scale: Array) -> None:
    """Scale rows and columns so that the diagonal is about one: N m may stand beside N."""
    size = len(vector)
    for i in range(size):
        largest = 0.0
        for k in range(size):
            largest = max(largest, abs(matrix[i, k]))
        diagonal = abs(matrix[i, i])
        scale[i] = 1.0 / math.sqrt(diagonal if diagonal > SINGULAR * largest else largest)
    for i in range(size):
        vector[i] *= scale[i]
        for k in range(size):
            matrix[i, k] *= scale[i] * scale[k]


@inlined
def solve(matrix: Array, vector: Array, scale: Array) -> bool:
    """Solve a symmetric, possibly indefinite system in place by LU with row exchanges; see the head of the file."""
    size = len(vector)
    equilibrate(matrix, vector, scale)
    for i in range(size):
        best = i
        for k in range(i + 1, size):
            if abs(matrix[k, i]) > abs(matrix[best, i]):
                best = k
        if not abs(matrix[best, i]) > SINGULAR:
            return False
        for k in range(size):
            matrix[i, k], matrix[best, k] = matrix[best, k], matrix[i, k]
        vector[i], vector[best] = vector[best], vector[i]
        for k in range(i + 1, size):
            factor = matrix[k, i] / matrix[i, i]
            for c in range(i + 1, size):
                matrix[k, c] -= factor * matrix[i, c]
            vector[k] -= factor * vector[i]
    for i in range(size - 1, -1, -1):
        for k in range(i + 1, size):
            vector[i] -= matrix[i, k] * vector[k]
        vector[i] /= matrix[i, i]
    for i in range(size):
        vector[i] *= scale[i]
    return True
