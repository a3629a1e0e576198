"""A momentum observer: torques from outside without accelerations.

p = M(q) dq changes by dp/dt = tau + C'(q, dq) dq - g(q) - friction + outside (De Luca, Albu-Schaeffer, Haddadin and
Hirzinger 2006, (7)). Over a step from sample k to k+1 the mean torque from outside is (p_k+1 - p_k) / dt less the mean
of the rest, and the residual follows it with the gain K: r_k+1 = a r_k + (1 - a) mean, a = exp(-K dt). That is the
observer of the source with the integral solved over the step, stable at any rate. C' dq = dM/dt dq - C dq, the first by
central differences along dq.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from dynident.arrays import Array
from dynident.errors import BadOption
from dynident.estimation.compensation import friction_torque, parameters_of
from dynident.estimation.estimate import Estimate
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import Motion
from dynident.model.kernels import batched
from dynident.model.reduction import CHUNK

#: Step along the motion for the change of the mass matrix, in s.
ALONG = 1e-4


@dataclass(frozen=True)
class MomentumObserver:
    """The equations of an identified robot that an observer needs, on many samples at once or on one.

    Attributes:
        estimate: The robot.
        gain: K, how fast the residual follows, in 1/s.
    """

    estimate: Estimate
    gain: float = 50.0

    def __post_init__(self) -> None:
        if not 0 < self.gain < np.inf:
            raise BadOption("gain", self.gain, "give the observer's gain in 1/s, above 0, such as 50")

    @property
    def model(self) -> DynamicModel:
        """The model of the estimate."""
        return self.estimate.model

    @cached_property
    def theta(self) -> Array:
        """Standard parameters with the torques of the estimate, shape (p,)."""
        return parameters_of(self.estimate)

    def momentum(self, q: Array, dq: Array) -> Array:
        """Return M(q) dq with all rotors, shape (N, n)."""
        model = self.model
        return self._masses(q, dq) + model.rotor_torque(Motion(q, dq, dq), model.rotors(self.theta))

    def drift(self, q: Array, dq: Array, temperature: Array | None = None) -> Array:
        """Return g + friction - C' dq, what the measured torque meets beside the change of momentum, shape (N, n)."""
        model, inertial = self.model, self.theta[: self.model.inertial_count]
        rest = np.zeros_like(q)
        with_gravity = batched.inverse_dynamics(model.robot.chain, inertial, q, dq, rest)  # C dq + g
        turning = (self._masses(q + ALONG * dq, dq) - self._masses(q - ALONG * dq, dq)) / (2 * ALONG)
        friction = friction_torque(model, self.theta, q, dq, temperature)
        return with_gravity - turning + friction - model.robot.bias

    def outside(self, time: Array, q: Array, dq: Array, torque: Array, temperature: Array | None = None) -> Array:
        """Return the mean torque from outside over each step, shape (N - 1, n).

        Args:
            time: Shape (N,), in s.
            q: Positions, shape (N, n), in rad or m.
            dq: Velocities, shape (N, n), in rad/s or m/s.
            torque: Measured torques at the joints, shape (N, n), in N m or N.
            temperature: Of the drives, shape (N, n), where friction depends on it.
        """
        return self.steps(np.diff(time), self.momentum(q, dq), torque - self.drift(q, dq, temperature))

    def steps(self, dt: Array, momentum: Array, push: Array) -> Array:
        """Return the mean torque from outside over each step, shape (N - 1, n).

        Args:
            dt: Length of each step, shape (N - 1,), in s.
            momentum: Shape (N, n).
            push: Measured torque less the drift, shape (N, n).
        """
        return np.diff(momentum, axis=0) / dt[:, None] - 0.5 * (push[:-1] + push[1:])

    def deviations(self, q: Array, dq: Array, temperature: Array | None = None) -> Array:
        """Return the standard deviation of the torque by the parameters' covariance, without acceleration, (N, n)."""
        model, base = self.model, self.estimate.base
        found = np.empty(q.shape)
        for start in range(0, len(q), CHUNK):
            part = slice(start, start + CHUNK)
            warm = None if temperature is None else temperature[part]
            motion = Motion(q[part], dq[part], np.zeros_like(q[part]), temperature=warm)
            columns = model.regressor(model.loaded(motion, self.theta))[..., base.independent]
            found[part] = np.linalg.norm(columns @ self._root, axis=-1)
        return found

    @cached_property
    def _root(self) -> Array:
        values, vectors = np.linalg.eigh(self.estimate.covariance)
        return vectors * np.sqrt(np.maximum(values, 0.0))

    def _masses(self, q: Array, dq: Array) -> Array:
        """Return M(q) dq of the links: the torque that the acceleration dq needs at rest, less that of gravity."""
        model, inertial = self.model, self.theta[: self.model.inertial_count]
        rest = np.zeros_like(q)
        chain = model.robot.chain
        return batched.inverse_dynamics(chain, inertial, q, rest, dq) - batched.inverse_dynamics(
            chain, inertial, q, rest, rest
        )
