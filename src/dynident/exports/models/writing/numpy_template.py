"""The source of the NumPy module, less its numbers: recursive Newton-Euler over many samples, and friction."""

from __future__ import annotations

from typing import Final

#: What friction remembers, where it does.
MEMORY: Final = '''class Memory:
    """What friction remembers of the way to a sample: give it positions in the order of time.

    state: of each joint's drive, shape (@JOINTS@, @STATES@), for the argument of that name.
    """

    def __init__(self):
        self.state, self.motor = np.tile(@STARTS@, (len(JOINTS), 1)), None

    def step(self, q@DT@):
        """Move on to the positions (@JOINTS@,) of the next sample@LATER@ and return the state there."""
        motor = COUPLING @ np.asarray(q, dtype=float)
        if self.motor is not None:
            moved = motor - self.motor
@UPDATES@
        self.motor = motor
        return self.state


def states_along(q@DT@):
    """Return the states along positions (N, @JOINTS@) that follow each other@LATER@, (N, @JOINTS@, @STATES@)."""
    memory = Memory()
    return np.array([memory.step(row@DT@) for row in q])


'''

#: Functions of the module; ``@...@`` are replaced.
SOURCE: Final = '''"""Inverse dynamics of an identified robot arm with NumPy alone; written by dynident.

SI units. Positions q, velocities dq and accelerations ddq have the shape (N, @JOINTS@) or (@JOINTS@,), in the order of
JOINTS.

    inverse_dynamics(q, dq, ddq@MORE@)  torque of the drives, with friction: M ddq + c + g + friction
    gravity(q)  torque that holds the arm still, without friction
    coriolis(q, dq)  torque of speed alone, without friction
    mass_matrix(q)  M, rotors included, shape (N, @JOINTS@, @JOINTS@)
    friction(q, dq, ddq@MORE@)  torque of friction and offsets
@MEMORY_ABOUT@
Run the file to check it against the numbers that dynident gave.
"""

import numpy as np

JOINTS = @NAMES@
GRAVITY = np.array(@GRAVITY@)
# One row a link: parent (-1: base), sliding or not, joint that moves it, multiplier and offset, pose, axis.
PARENT = @PARENT@
SLIDES = @SLIDES@
COLUMN = @COLUMN@
MULTIPLIER = @MULTIPLIER@
OFFSET = @OFFSET@
ROTATION = np.array(@ROTATION@)
TRANSLATION = np.array(@TRANSLATION@)
AXIS = np.array(@AXIS@)
# About the origin of the link frame: mass, first moment, tensor.
MASS = @MASS@
MOMENT = np.array(@MOMENT@)
TENSOR = np.array(@TENSOR@)
# Motor speed = COUPLING @ joint speed; rotor inertia at the joint; constant torque that something else gives.
COUPLING = np.array(@COUPLING@)
ARMATURE = np.array(@ARMATURE@)
BIAS = np.array(@BIAS@)


def _rows(*arrays):
    return [np.atleast_2d(np.asarray(array, dtype=float)) for array in arrays]


def _like(result, q):
    return result[0] if np.ndim(q) == 1 else result


def _turns(i, angle):
    """Rotation about the axis of link i (Rodrigues), (N, 3, 3)."""
    x, y, z = AXIS[i]
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    sine, cosine = np.sin(angle)[:, None, None], np.cos(angle)[:, None, None]
    return np.eye(3) + sine * cross + (1.0 - cosine) * (cross @ cross)


def _bodies(q, dq, ddq, gravity):
    """Newton and Euler: out along the tree with motion, back with forces."""
    samples = len(q)
    links = len(PARENT)
    turns, shifts, spins, swings, pushes, forces, moments = ([None] * links for _ in range(7))
    for i in range(links):
        position = MULTIPLIER[i] * q[:, COLUMN[i]] + OFFSET[i]
        speed = (MULTIPLIER[i] * dq[:, COLUMN[i]])[:, None] * AXIS[i]
        rise = (MULTIPLIER[i] * ddq[:, COLUMN[i]])[:, None] * AXIS[i]
        p = PARENT[i]
        if p < 0:
            spin0, swing0 = np.zeros((samples, 3)), np.zeros((samples, 3))
            push0 = np.broadcast_to(-gravity, (samples, 3))
        else:
            spin0, swing0, push0 = spins[p], swings[p], pushes[p]
        if SLIDES[i]:
            turn = np.broadcast_to(ROTATION[i], (samples, 3, 3))
            shift = TRANSLATION[i] + position[:, None] * (ROTATION[i] @ AXIS[i])
        else:
            turn = ROTATION[i] @ _turns(i, position)
            shift = np.broadcast_to(TRANSLATION[i], (samples, 3))
        push = push0 + np.cross(swing0, shift) + np.cross(spin0, np.cross(spin0, shift))
        spin, swing, push = (np.einsum("nji,nj->ni", turn, v) for v in (spin0, swing0, push))
        if SLIDES[i]:
            push = push + rise + 2.0 * np.cross(spin, speed)
        else:
            swing = swing + rise + np.cross(spin, speed)
            spin = spin + speed
        turns[i], shifts[i], spins[i], swings[i], pushes[i] = turn, shift, spin, swing, push
        forces[i] = MASS[i] * push + np.cross(swing, MOMENT[i]) + np.cross(spin, np.cross(spin, MOMENT[i]))
        moments[i] = swing @ TENSOR[i] + np.cross(spin, spin @ TENSOR[i]) + np.cross(MOMENT[i], push)
    torque = np.zeros((samples, len(JOINTS)))
    for i in reversed(range(links)):
        along = forces[i] if SLIDES[i] else moments[i]
        torque[:, COLUMN[i]] += MULTIPLIER[i] * (along @ AXIS[i])
        p = PARENT[i]
        if p >= 0:
            force = np.einsum("nij,nj->ni", turns[i], forces[i])
            forces[p] = forces[p] + force
            moments[p] = moments[p] + np.einsum("nij,nj->ni", turns[i], moments[i]) + np.cross(shifts[i], force)
    return torque


def _rotors(ddq):
    return (ddq @ COUPLING.T * ARMATURE) @ COUPLING


def gravity(q):
    (rows,) = _rows(q)
    zero = np.zeros_like(rows)
    return _like(_bodies(rows, zero, zero, GRAVITY), q)


def coriolis(q, dq):
    rows, speeds = _rows(q, dq)
    return _like(_bodies(rows, speeds, np.zeros_like(rows), np.zeros(3)), q)


def mass_matrix(q):
    (rows,) = _rows(q)
    zero = np.zeros_like(rows)
    columns = [_bodies(rows, zero, np.broadcast_to(unit, rows.shape), np.zeros(3)) for unit in np.eye(len(JOINTS))]
    return _like(np.stack(columns, axis=2) + COUPLING.T @ (ARMATURE[:, None] * COUPLING), q)


@MEMORY@def friction(q, dq, ddq@MORE@):
    """Friction and offsets; ddq matters only where friction grows with the load."""
    rows, speeds, rises = _rows(q, dq, ddq)
    loads = np.linalg.solve(COUPLING.T, (_bodies(rows, speeds, rises, GRAVITY) + _rotors(rises)).T).T
@STATE_ROWS@    at, speed, torque = rows @ COUPLING.T, speeds @ COUPLING.T, np.zeros_like(rows)
@FRICTION@
    return _like(torque @ COUPLING - BIAS, q)


def inverse_dynamics(q, dq, ddq@MORE@):
    rows, speeds, rises = _rows(q, dq, ddq)
    moved = _bodies(rows, speeds, rises, GRAVITY) + _rotors(rises)
    return _like(moved + friction(rows, speeds, rises@MORE@), q)


# Positions, velocities, accelerations and the torques that dynident gave for them.
REFERENCE = @REFERENCE@

if __name__ == "__main__":
    q_, dq_, ddq_, *more_, torque_ = (np.array(values) for values in REFERENCE)
@WALKED@    away_ = float(np.abs(inverse_dynamics(q_, dq_, ddq_, *more_) - torque_).max())
    print(f"largest difference of a torque: {away_:.2g}")
    raise SystemExit(0 if away_ < 1e-6 * float(np.abs(torque_).max()) else 1)
'''
