"""The loops over samples of the generic compiled kernels; any tree, any size. Arguments as in generic.py, by sample."""

from __future__ import annotations

import numpy as np

from dynident.arrays import Array, IntArray
from dynident.model.kernels.generic import WORK, cross, joint_mass, motion, place, rotate, torque_of_motion, turn_back
from dynident.model.kernels.jit import compiled, inlined
from dynident.model.robot import PRISMATIC


@inlined
def joint_twists(links: IntArray, reals: Array, i: int, work: Array, twists: Array) -> None:
    """Write the unit twists of link i's joint and of its ancestors in link i's frame, twists (l, l, 6).

    A twist is the direction of turning (0-2) and the velocity of the link's origin (3-5).
    """
    parent = links[i, 0]
    px, py, pz = work[i, 9], work[i, 10], work[i, 11]
    k = parent
    while k >= 0:
        sx, sy, sz = twists[parent, k, 0], twists[parent, k, 1], twists[parent, k, 2]
        vx, vy, vz = cross(sx, sy, sz, px, py, pz)
        vx, vy, vz = vx + twists[parent, k, 3], vy + twists[parent, k, 4], vz + twists[parent, k, 5]
        twists[i, k, 0], twists[i, k, 1], twists[i, k, 2] = turn_back(work, i, sx, sy, sz)
        twists[i, k, 3], twists[i, k, 4], twists[i, k, 5] = turn_back(work, i, vx, vy, vz)
        k = links[k, 0]
    slides = links[i, 1] == PRISMATIC
    for k in range(3):
        twists[i, i, k] = 0.0 if slides else reals[i, 12 + k]
        twists[i, i, 3 + k] = reals[i, 12 + k] if slides else 0.0


@inlined
def link_columns(links: IntArray, reals: Array, i: int, work: Array, twists: Array, s: int, out: Array) -> None:
    """Write the power along each twist of link i of the wrenches of its ten unit parameters.

    Into row s of out (N, l * 10 l): link k whose joint gives the twist, link i, parameter.
    """
    size = len(links)
    wx, wy, wz, ex, ey, ez = work[i, 12], work[i, 13], work[i, 14], work[i, 15], work[i, 16], work[i, 17]
    ax, ay, az = work[i, 18], work[i, 19], work[i, 20]
    xx, yy, zz = wx * wx, wy * wy, wz * wz
    xy, xz, yz = wx * wy, wx * wz, wy * wz
    k = i
    while k >= 0:
        factor = reals[k, 15]
        sx, sy, sz = factor * twists[i, k, 0], factor * twists[i, k, 1], factor * twists[i, k, 2]
        vx, vy, vz = factor * twists[i, k, 3], factor * twists[i, k, 4], factor * twists[i, k, 5]
        ux, uy, uz = cross(sx, sy, sz, wx, wy, wz)
        at = (k * size + i) * 10
        out[s, at] = ex * sx + wx * ux
        out[s, at + 1] = ex * sy + ey * sx + wx * uy + wy * ux
        out[s, at + 2] = ex * sz + ez * sx + wx * uz + wz * ux
        out[s, at + 3] = ey * sy + wy * uy
        out[s, at + 4] = ey * sz + ez * sy + wy * uz + wz * uy
        out[s, at + 5] = ez * sz + wz * uz
        # h enters by (skew(e) + skew(w)^2) h along v and by h x a along s
        out[s, at + 6] = (xy + ez) * vy + (xz - ey) * vz - (yy + zz) * vx + ay * sz - az * sy
        out[s, at + 7] = (xy - ez) * vx + (yz + ex) * vz - (xx + zz) * vy + az * sx - ax * sz
        out[s, at + 8] = (xz + ey) * vx + (yz - ex) * vy - (xx + yy) * vz + ax * sy - ay * sx
        out[s, at + 9] = vx * ax + vy * ay + vz * az
        k = links[k, 0]


@compiled
def regressor(links: IntArray, reals: Array, gravity: Array, q: Array, dq: Array, ddq: Array, out: Array) -> None:
    """Write the regressor of each link's joint, out (N, l * 10 l); mimic joints are still apart."""
    size = len(links)
    work, twists = np.empty((size + 1, WORK)), np.empty((size, size, 6))
    for s in range(len(q)):
        motion(links, reals, gravity, q[s], dq[s], ddq[s], 1.0, work)
        for c in range(out.shape[1]):
            out[s, c] = 0.0
        for i in range(size):
            joint_twists(links, reals, i, work, twists)
            link_columns(links, reals, i, work, twists, s, out)


@compiled
def columns(
    links: IntArray, reals: Array, gravity: Array, entries: IntArray, q: Array, dq: Array, ddq: Array, out: Array
) -> None:
    """Write chosen entries of the regressor, out (rows, N): rows of out and entries of :func:`regressor`, (k, 2)."""
    size = len(links)
    used = np.zeros(size, np.int64)
    for k in range(len(entries)):
        used[entries[k, 1] // 10 % size] = 1
    work, twists, block = np.empty((size + 1, WORK)), np.empty((size, size, 6)), np.zeros((1, size * size * 10))
    out[:, :] = 0.0
    for s in range(len(q)):
        motion(links, reals, gravity, q[s], dq[s], ddq[s], 1.0, work)
        for i in range(size):
            joint_twists(links, reals, i, work, twists)
            if used[i]:
                link_columns(links, reals, i, work, twists, 0, block)
        for k in range(len(entries)):
            out[entries[k, 0], s] += block[0, entries[k, 1]]


@compiled
def inverse_dynamics(
    links: IntArray, reals: Array, gravity: Array, theta: Array, q: Array, dq: Array, ddq: Array, out: Array
) -> None:
    """Write the torques (N, n)."""
    work = np.empty((len(links) + 1, WORK))
    for s in range(len(q)):
        motion(links, reals, gravity, q[s], dq[s], ddq[s], 1.0, work)
        torque_of_motion(links, reals, theta, out[s], work)


@compiled
def mass_matrix(links: IntArray, reals: Array, theta: Array, q: Array, out: Array) -> None:
    """Write the mass matrices (N, n, n)."""
    work = np.empty((len(links) + 1, WORK))
    for s in range(len(q)):
        joint_mass(links, reals, theta, q[s], out[s], work)


@compiled
def link_poses(links: IntArray, reals: Array, q: Array, out: Array) -> None:
    """Write the poses of the links in the base frame, out (N, l, 12): rotation row-major, translation."""
    size = len(links)
    work = np.empty((size + 1, WORK))
    world = np.zeros((size + 1, 12))
    world[size, 0] = world[size, 4] = world[size, 8] = 1.0
    for s in range(len(q)):
        for i in range(size):
            parent = size if links[i, 0] < 0 else links[i, 0]
            place(links, reals, i, q[s], work)
            for k in range(3):
                x, y, z = rotate(world, parent, work[i, k], work[i, 3 + k], work[i, 6 + k])
                world[i, k], world[i, 3 + k], world[i, 6 + k] = x, y, z
            x, y, z = rotate(world, parent, work[i, 9], work[i, 10], work[i, 11])
            world[i, 9], world[i, 10], world[i, 11] = x, y, z
            for k in range(3):
                world[i, 9 + k] += world[parent, 9 + k]
            for k in range(12):
                out[s, i, k] = world[i, k]
