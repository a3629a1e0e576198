"""Torques of bodies that move otherwise than the log says: elastic gears, other zeros and scales, a clock, a lean.

Each is linear in its figure for a small one, a column of the fit. With a figure the column is a secant: that figure
times it is the torque that is added, however large.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from dynident.arrays import Array
from dynident.data.log import Log
from dynident.identification.problem.regressor_stream import RegressorStream, motion_of
from dynident.model.kernels.batched import inverse_dynamics
from dynident.model.kernels.generated import chain_kernel
from dynident.model.kernels.inputs import parameters, samples
from dynident.model.robot import Chain

#: Steps of the finite differences: of positions in rad or m, of their scale and by the clock, shares.
SHIFT, STRETCH_STEP, CLOCK_STEP = 1e-3, 1e-3, 1e-3

#: Signals of a motion, each the derivative of the one before.
MOTION = ("q", "dq", "ddq")


@dataclass(frozen=True)
class BodiesInMotion:
    """A motion and the bodies that make it.

    Attributes:
        regressor: What makes the rows of the robot.
        log: The motion, of N samples.
        bodies: Base parameters without friction, shape (b,).
        rigid: Their torque in the motion as it was logged, shape (N, n).
    """

    regressor: RegressorStream
    log: Log
    bodies: Array
    rigid: Array

    @classmethod
    def of_bodies(cls, regressor: RegressorStream, log: Log, bodies: Array) -> BodiesInMotion:
        """Return that of bodies by their base parameters, shape (b,)."""
        bare = cls(regressor, log, bodies, np.zeros(0))
        return replace(bare, rigid=bare._torque(log))

    def elastic(self, joint: int, compliance: float = 0.0) -> Array:
        """Return the torque by an elastic gear over its compliance in rad/N m or m/N, shape (N, n).

        The drive, whose position is logged, is ahead of the link by the torque of the bodies over the stiffness (Spong
        1987).
        """
        step = compliance or SHIFT / max(float(np.abs(self.rigid[:, joint]).max()), 1e-300)
        behind = -step * self._torque(self._bent(joint, -step * self.rigid[:, joint]))[:, joint]
        return (self._torque(self._bent(joint, behind)) - self.rigid) / step

    def zero(self, joint: int, offset: float = 0.0) -> Array:
        """Return the torque by positions that are larger than the logged ones, over the difference, shape (N, n)."""
        step = offset or SHIFT
        return (self._torque(self.moved(joint, step)) - self.rigid) / step

    def stretched(self, joint: int, zero: float, share: float = 0.0) -> Array:
        """Return the torque by positions that are larger by a share, over it, shape (N, n); see :meth:`scaled`."""
        step = share or STRETCH_STEP
        return (self._torque(self.scaled(joint, zero, step)) - self.rigid) / step

    def late(self, joint: int, delay: float = 0.0) -> Array:
        """Return what a delay of one joint's torque adds over its seconds, shape (N, n)."""
        column, own, time = np.zeros_like(self.rigid), self.rigid[:, joint], np.asarray(self.log.time)
        column[:, joint] = (np.interp(time - delay, time, own) - own) / delay if delay else -np.gradient(own, time)
        return column

    def clock(self) -> Array:
        """Return the derivative of the torque by the speed of the clock, shape (N, n)."""
        speed = 1.0 + CLOCK_STEP
        faster = replace(self.log, dq=np.asarray(self.log.dq) * speed, ddq=np.asarray(self.log.ddq) * speed**2)
        return (self._torque(faster) - self.rigid) / CLOCK_STEP

    def moved(self, joint: int, offset: float) -> Log:
        """Return the motion where the position of a joint is larger by an offset."""
        q = np.array(self.log.q)
        q[:, joint] += offset
        return replace(self.log, q=q)

    def scaled(self, joint: int, zero: float, share: float) -> Log:
        """Return the motion where a joint is farther by a share from where its log says 0, at position ``zero``."""
        q, dq, ddq = (np.asarray(getattr(self.log, name))[:, joint] for name in MOTION)
        return self._with(joint, [share * (q - zero), share * dq, share * ddq])

    def _bent(self, joint: int, shift: Array) -> Log:
        """Return the motion where the position of a joint is larger by ``shift`` (N,)."""
        time, shifts = np.asarray(self.log.time), [shift]
        for _ in MOTION[1:]:
            shifts.append(np.gradient(shifts[-1], time))
        return self._with(joint, shifts)

    def _with(self, joint: int, shifts: Sequence[Array]) -> Log:
        """Return the motion where position, velocity and acceleration of a joint are larger by as much, (N,) each."""
        moved = {}
        for name, shift in zip(MOTION, shifts, strict=True):
            moved[name] = np.array(getattr(self.log, name))
            moved[name][:, joint] += shift
        return replace(self.log, **moved)

    def _torque(self, log: Log) -> Array:
        """Return the torque of the bodies in another motion, shape (N, n)."""
        return self.regressor.model.torque(motion_of(log), self.regressor.base.to_standard(self.bodies))


def apart(torque: Array, time: Array, clock: Array, growth: float = 0.0) -> Array:
    """Return what a delay of all torques that grows along the log adds over its growth in s per s, shape (N, n).

    Args:
        torque: As predicted, friction with it, shape (N, n).
        time: In s, shape (N,).
        clock: The same since the log began in which each sample is, shape (N,); the delay is zero at its mean.
        growth: For which it is a secant; 0 for the straight line.
    """
    since = (clock - clock.mean())[:, None]
    if not growth:
        return -np.gradient(torque, time, axis=0) * since
    return np.stack([np.interp(time - growth * since[:, 0], time, own) - own for own in torque.T], axis=1) / growth


def lean_torques(regressor: RegressorStream, log: Log, beta: Array) -> Array:
    """Return the torques of bodies by a lean of the base about both axes across gravity, per radian, shape (2, N, n).

    Args:
        regressor: What makes the rows of the robot on its base.
        log: The motion, of N samples.
        beta: Base parameters of the bodies, shape (b,).
    """
    model = regressor.model
    gravity, bodies = np.asarray(model.robot.gravity), regressor.base.to_standard(beta)[: model.inertial_count]
    pulls = float(np.linalg.norm(gravity)) * across_gravity(gravity)
    return weight_torques(model.robot.chain, bodies, log.q, pulls)


def weight_torques(chain: Chain, theta: npt.ArrayLike, q: npt.ArrayLike, fields: npt.ArrayLike) -> Array:
    """Return the joint torques at rest under other gravities than that of the chain, shape (m, N, n), in N m or N.

    Args:
        chain: The robot.
        theta: Inertial parameters, shape (10 l,); physical or not.
        q: Positions, shape (N, n).
        fields: The gravities in m/s^2, shape (m, 3), which share one kernel.

    Raises:
        ValueError: A shape is wrong.
    """
    (q,), theta, fields = samples(chain, {"q": q}), parameters(chain, theta), np.array(fields, dtype=np.float64)
    kernel, still = chain_kernel(replace(chain, gravity=np.zeros(3)), "weight"), np.zeros_like(q)
    if kernel is None:
        return np.stack([inverse_dynamics(replace(chain, gravity=own), theta, q, still, still) for own in fields])
    out = np.empty((len(fields), len(q), chain.joints))
    for field, own in zip(fields, out, strict=True):
        kernel.run((theta, field, q), (own,), len(q))
    return out


def leaned(gravity: Array, lean: Array) -> Array:
    """Return gravity (3,) turned by small angles (2,) in rad towards the vectors across it, of the same size."""
    size = float(np.linalg.norm(gravity))
    found = gravity + size * lean @ across_gravity(gravity)
    return found * (size / float(np.linalg.norm(found)))


def across_gravity(gravity: Array) -> Array:
    """Return two unit vectors across gravity and each other, shape (2, 3)."""
    return np.linalg.svd(gravity[None] / np.linalg.norm(gravity))[2][1:]
