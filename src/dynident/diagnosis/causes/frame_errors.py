"""What small errors of a robot model's geometry do to its torques: axes of joints a little askew or displaced.

Newton and Euler's recursion (Luh, Walker and Paul 1980) for all these robots at once: each would need a kernel of its
own, and a few hundred samples are all that is asked for.
"""

from __future__ import annotations

import numpy as np

from dynident.arrays import Array
from dynident.diagnosis.causes.quick_fit import QuickFit
from dynident.identification.problem.regressor_stream import motion_of
from dynident.model.chain import PRISMATIC, Chain
from dynident.model.friction import Motion
from dynident.model.inertia import skew
from dynident.model.joint import rotation_about

#: Standard deviations of an axis, rad and m: general tolerances of angles and lengths (ISO 2768-1, medium, of 0.12 to
#: 0.4 m: 10 minutes of arc, 0.5 mm), of which a link has several.
TURNED, MOVED = np.radians(1.0 / 6.0), 5e-4

#: Step of the finite differences, times these.
STEP = 0.1


def frame_errors(fit: QuickFit, every: int) -> Array | None:
    """Return the torques at some rows of a log by an error of each axis of one standard deviation, shape (6 m, N, n).

    The axis of each of the m joints that another one carries is turned about the axes of its frame and displaced along
    those of its parent's; zeros of the positions are right. The first joint is left out: the base leans then, or
    stands elsewhere. The bodies are the nominal ones, in the size of the fitted torques where nominal torques are not
    small beside those by an error of a radian: fitted bodies that the log hardly tells are large, and cancel each
    other in these frames alone.

    Args:
        fit: The fit of the log.
        every: Rows from one of these to the next.

    Returns:
        None where the robot model states no bodies.
    """
    nominal, chain = fit.model.nominal(), fit.model.robot.chain
    if nominal is None:
        return None
    kept = motion_of(fit.rows.prepared.kept)
    motion = Motion(*(np.asarray(part)[::every] for part in (kept.q, kept.dq, kept.ddq)))
    bodies = nominal[: fit.model.inertial_count]
    right = displaced_torques(chain, chain.axis[None], chain.translation[None], bodies, motion)[0]
    errors, beta = [np.zeros((0, *right.shape))], np.where(fit.base.is_friction, 0.0, fit.plain.beta)
    for i in np.flatnonzero(chain.parent >= 0):
        axes, shifts = (np.array([part] * 6) for part in (chain.axis, chain.translation))
        for about in range(3):
            axes[about, i] = rotation_about(np.eye(3)[about], STEP * TURNED) @ chain.axis[i]
            shifts[3 + about, i, about] += STEP * MOVED
        errors.append(displaced_torques(chain, axes, shifts, bodies, motion) - right)
    fitted = np.stack([b[::every] @ beta[own] for b, own in zip(fit.rows.blocks, fit.rows.columns, strict=True)], 1)
    found = np.concatenate(errors) / STEP
    by_radian = np.sum(found**2, axis=(0, 1)) / (max(len(found), 1) * TURNED**2)  # a joint about which all is even
    along, own = np.abs(np.sum(fitted * right, axis=0)), np.sum(right**2, axis=0)
    return found * (along + by_radian) / np.maximum(own + by_radian, 1e-300)


def displaced_torques(chain: Chain, axes: Array, shifts: Array, theta: Array, motion: Motion) -> Array:
    """Return the torques of chains with axes and translations of joints, shape (m, l, 3) each, shape (m, N, n)."""
    still, bodies = np.zeros((len(axes), len(motion.q), 3)), np.asarray(theta).reshape(-1, 10)
    moves: list[tuple[Array, Array, Array]] = []
    poses, forces, moments = [], [], []
    for i, parent in enumerate(chain.parent):
        q, dq, ddq = (chain.multiplier[i] * part[:, chain.joint[i], None] for part in (motion.q, motion.dq, motion.ddq))
        axis, turn, shift = axes[:, i, None], _turn(chain, i, axes[:, i], q + chain.offset[i]), shifts[:, i, None]
        if chain.kind[i] == PRISMATIC:
            shift = shift + axis @ chain.rotation[i].T * (q + chain.offset[i])
        spin, swing, push = moves[parent] if parent >= 0 else (still, still, still - chain.gravity)
        push = push + np.cross(spin, np.cross(spin, shift)) + np.cross(swing, shift)
        spin, swing, push = ((part[..., None, :] @ turn)[..., 0, :] for part in (spin, swing, push))
        if chain.kind[i] == PRISMATIC:
            push = push + axis * ddq + 2.0 * np.cross(spin, axis * dq)
        else:
            swing = swing + axis * ddq + np.cross(spin, axis * dq)
            spin = spin + axis * dq
        moves.append((spin, swing, push))
        poses.append((turn, shift))
        xx, xy, xz, yy, yz, zz = bodies[i, :6]
        inertia, first, mass = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]), bodies[i, 6:9], bodies[i, 9]
        forces.append(mass * push + np.cross(swing, first) + np.cross(spin, np.cross(spin, first)))
        moments.append(swing @ inertia + np.cross(spin, spin @ inertia) + np.cross(first, push))
    torques = np.zeros((len(axes), len(motion.q), chain.joints))
    for i, (turn, shift) in reversed(list(enumerate(poses))):
        carried = forces[i] if chain.kind[i] == PRISMATIC else moments[i]
        torques[:, :, chain.joint[i]] += chain.multiplier[i] * np.sum(carried * axes[:, i, None], axis=2)
        parent = chain.parent[i]
        if parent >= 0:
            force, moment = ((turn @ part[..., None])[..., 0] for part in (forces[i], moments[i]))
            forces[parent] = forces[parent] + force
            moments[parent] = moments[parent] + moment + np.cross(shift, force)
    return torques


def _turn(chain: Chain, link: int, axes: Array, q: Array) -> Array:
    """Return the orientation of a link in its parent at positions (N, 1) with axes (m, 3), shape (m, N, 3, 3)."""
    if chain.kind[link] == PRISMATIC:
        return chain.rotation[link][None, None]
    cross = np.array([skew(axis) for axis in axes])[:, None]
    sine, cosine = np.sin(q)[..., None], np.cos(q)[..., None]
    return chain.rotation[link] @ (np.eye(3) + sine * cross + (1.0 - cosine) * (cross @ cross))
