"""A momentum observer: torques from outside without accelerations.

p = M(q) dq changes by dp/dt = tau + C'(q, dq) dq - g(q) - friction + outside (De Luca, Albu-Schaeffer, Haddadin and
Hirzinger 2006, (7)). Over a step from sample k to k+1 the mean torque from outside is (p_k+1 - p_k) / dt less the mean
of the rest, and the residual follows it with the gain K: r_k+1 = a r_k + (1 - a) mean, a = exp(-K dt). That is the
observer of the source with the integral solved over the step, stable at any rate. C' dq is the slope of dq' M dq / 2
by q.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from dynident.applications.monitor.equations import Equations, Terms
from dynident.applications.standstill import end_states, state_paths
from dynident.arrays import Array
from dynident.errors import BadOption
from dynident.identification.estimate.estimate import Estimate
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import Motion
from dynident.model.reduction import CHUNK

#: Steps in which no drive turns unseen, nor does one within a time constant of the observer.
UNSEEN = 2.5


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

    def longest_step(self, usual: float) -> float:
        """Return the longest step between samples that it follows, in s; ``usual`` is one without a gap.

        Over a longer one the torques are not known in between: it begins anew behind it.
        """
        return max(1.0 / self.gain, UNSEEN * usual)

    @cached_property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the joints that move on their own."""
        return self.model.robot.joint_names

    @cached_property
    def equations(self) -> Equations:
        """The equations, compiled when they are first evaluated."""
        return Equations(self.estimate)

    @property
    def theta(self) -> Array:
        """Standard parameters with the torques of the estimate, shape (p,)."""
        return self.equations.theta

    def momentum(self, q: Array, dq: Array) -> Array:
        """Return M(q) dq with all rotors, shape (N, n)."""
        return self.equations.at(q, dq, self._mild(q)).momentum

    def drift(self, q: Array, dq: Array, temperature: Array | None = None) -> Array:
        """Return g + friction - C' dq, what the measured torque meets beside the change of momentum, shape (N, n)."""
        return self.equations.at(q, dq, temperature).drift

    def outside(
        self,
        time: Array,
        q: Array,
        dq: Array,
        torque: Array,
        temperature: Array | None = None,
        first: Array | None = None,
    ) -> Array:
        """Return the mean torque from outside over each step, shape (N - 1, n).

        Args:
            time: Shape (N,), in s.
            q: Positions, shape (N, n), in rad or m.
            dq: Velocities, shape (N, n), in rad/s or m/s.
            torque: Measured torques at the joints, shape (N, n), in N m or N.
            temperature: Of the drives, shape (N, n), where friction depends on it.
            first: States of friction at the first sample, shape (n, s); None for their start.
        """
        parts = list(self.chunks(q, dq, float(time[-1] - time[0]) / max(len(time) - 1, 1), temperature, first, False))
        momentum, drift = (np.concatenate([getattr(one, name) for one in parts]) for name in ("momentum", "drift"))
        return self.steps(np.diff(time), momentum, torque - drift)

    def steps(self, dt: Array, momentum: Array, push: Array) -> Array:
        """Return the mean torque from outside over each step, shape (N - 1, n).

        Args:
            dt: Length of each step, shape (N - 1,), in s.
            momentum: Shape (N, n).
            push: Measured torque less the drift, shape (N, n).
        """
        return np.diff(momentum, axis=0) / dt[:, None] - 0.5 * (push[:-1] + push[1:])

    def deviations(self, terms: Terms) -> Array:
        """Return the standard deviation of the torque by the parameters' covariance, without acceleration, (N, n)."""
        turned = terms.columns @ self._root
        return np.sqrt(np.einsum("sjb,sjb->sj", turned, turned))

    def chunks(
        self,
        q: Array,
        dq: Array,
        step: float,
        temperature: Array | None = None,
        first: Array | None = None,
        with_held: bool = True,
    ) -> Iterator[Terms]:
        """Yield the terms of many samples that follow each other after a step in s, some at a time.

        Without ``with_held`` what static friction can hold is left out, as 0.
        """
        state, rests = self.states(q, dq, step, first), self.equations.rests(dq, step) if with_held else None
        ends = end_states(self.model, first) if with_held else None
        paths = state_paths(self.model, Motion(q, dq, np.zeros_like(q)), step, ends)
        for start in range(0, len(q), CHUNK):
            part = slice(start, start + CHUNK)
            warm, kept = (None if one is None else one[part] for one in (temperature, state))
            apart = None if paths is None else (paths[0][part], paths[1][part])
            yield self.equations.at(q[part], dq[part], warm, kept, apart, None if rests is None else rests[part])

    def states(self, q: Array, dq: Array, step: float, first: Array | None = None) -> Array | None:
        """Return the states of friction along samples that follow each other, shape (N, n, s); None where none has one.

        ``first`` are those at the first sample, shape (n, s); None for their start.
        """
        return self.model.with_states(Motion(q, dq, np.zeros_like(q)), step, first).state

    def known_from(self, q: Array) -> int:
        """Return the sample from which on states of friction along positions (N, n) do not depend on their start."""
        at = Motion(q, q, q).at_motors(np.asarray(self.model.robot.coupling))
        open_ones = [part.is_unsettled(at).any(axis=1) for part in self.model.friction if part.states]
        return max((int(np.flatnonzero(own)[-1]) + 1 for own in open_ones if own.any()), default=0)

    @cached_property
    def _root(self) -> Array:
        values, vectors = np.linalg.eigh(self.estimate.covariance)
        return vectors * np.sqrt(np.maximum(values, 0.0))

    def _mild(self, q: Array) -> Array | None:
        """Return temperatures for what does not depend on them."""
        return np.full_like(q, 20.0) if "temperature" in self.model.needs else None
