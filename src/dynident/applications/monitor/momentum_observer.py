"""A momentum observer: torques from outside without accelerations.

p = M(q) dq changes by dp/dt = tau + C'(q, dq) dq - g(q) - friction + outside (De Luca, Albu-Schaeffer, Haddadin and
Hirzinger 2006, (7)). Over a step from sample k to k+1 the mean torque from outside is (p_k+1 - p_k) / dt less the mean
of the rest, and the residual follows it with the gain K: r_k+1 = a r_k + (1 - a) mean, a = exp(-K dt). That is the
observer of the source with the integral solved over the step, stable at any rate. C' dq is the slope of dq' M dq / 2
by q.

The equations for one robot are compiled once: everything that a sample needs in one call.
Robots too large for generated kernels (see :mod:`dynident.model.kernels.batched`) are evaluated by the generic ones.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from dynident.applications.compensation import parameters_of
from dynident.applications.standstill import (
    StatePaths,
    end_states,
    friction_between,
    held_friction,
    state_paths,
    with_sharp_signs,
)
from dynident.arrays import Array, BoolArray
from dynident.data.preprocessing import at_rest
from dynident.errors import BadOption
from dynident.identification.estimate.estimate import Estimate
from dynident.identification.problem.problem import rest_speeds
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import Motion
from dynident.model.kernels import batched
from dynident.model.kernels.compiled import Kernel, kernel, lanes
from dynident.model.kernels.emit import Access, Buffer, Layout
from dynident.model.kernels.generated import LARGEST, by_sample, chain_key
from dynident.model.kernels.inputs import kernel_choice
from dynident.model.kernels.recursion import TracedChain
from dynident.model.kernels.trace import Number, TracedProgram, gradient
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


#: Step along the motion for the change of the mass matrix where no kernel is generated, in s.
ALONG = 1e-4


@dataclass(frozen=True)
class Terms:
    """What the equations say at some states.

    Attributes:
        mass: M with all rotors, shape (N, n, n).
        momentum: M dq, shape (N, n).
        drift: g + friction - C' dq, what the torque meets beside the change of momentum, shape (N, n).
        friction: Its part by friction, shape (N, n).
        held: How far from that static friction can hold, shape (N, n); 0 where no drive of a joint rests and all have
            moved on since the start.
        columns: The regressor of the base parameters without acceleration, shape (N, n, b).
    """

    mass: Array
    momentum: Array
    drift: Array
    friction: Array
    held: Array
    columns: Array


class Equations:
    """Momentum, drift and regressor of an identified robot over samples, or of one sample.

    Args:
        estimate: The robot.
    """

    def __init__(self, estimate: Estimate) -> None:
        model, self.model = estimate.model, estimate.model
        self.theta = parameters_of(estimate)
        coupling = np.asarray(model.robot.coupling)
        self.rotors = model.robot.reflected_inertia + coupling.T @ (model.rotors(self.theta)[:, None] * coupling)
        drive, column = model.terms
        own = np.asarray(estimate.base.independent)
        inertial = own < model.inertial_count
        self._bodies, self._friction = np.flatnonzero(inertial), np.flatnonzero(~inertial)
        self._body_columns = own[inertial]
        chosen = own[~inertial] - model.inertial_count
        self._drive, self._column = drive[chosen], column[chosen]
        self._shares = coupling[self._drive].T
        self._table = model.coefficient_table(self.theta)
        self._coupling, self._bias = coupling, np.asarray(model.robot.bias)
        self._sharp, self._slow = with_sharp_signs(model), rest_speeds(model.robot, estimate.preprocessing.standstill)
        joints = model.robot.dof
        ends = np.cumsum([0, joints, joints, joints, joints, joints * joints, joints * len(self._bodies)]).tolist()
        self._parts = tuple(slice(a, b) for a, b in pairwise(ends))

    def at(
        self,
        q: Array,
        dq: Array,
        temperature: Array | None = None,
        state: Array | None = None,
        ends: StatePaths | None = None,
        rests: BoolArray | None = None,
    ) -> Terms:
        """Return the terms of some samples.

        Args:
            q: Positions, shape (N, n), in rad or m.
            dq: Velocities, shape (N, n), in rad/s or m/s.
            temperature: Of the drives, shape (N, n), where friction depends on it.
            state: Of friction that remembers, shape (N, n, s); None where it is not known.
            ends: The same from both ends at the start on; None where they have come together.
            rests: Where each drive rests, shape (N, n); None for nowhere.

        Raises:
            BadOption: Friction asks for a temperature that is missing.
        """
        model, (samples, joints) = self.model, q.shape
        found = self._bodies_at(q, dq)
        mass = found.mass + self.rotors
        load = found.load if "torque" in model.needs else None
        motion = Motion(q, dq, np.zeros_like(q), load, temperature, state)
        values = model.friction_values(motion)
        drives, held = np.einsum("sjk,jk->sj", values, self._table), np.zeros_like(q)
        if ends is not None:
            middle, half, apart = friction_between(model, self._table, motion, ends)
            held = np.where(apart, half + np.abs(middle - drives), 0.0)
        if rests is not None and np.any(rests):
            middle, half = held_friction(self._sharp, self._table, motion)
            held = np.where(rests, half + np.abs(middle - drives), held)
        held = held @ np.abs(self._coupling)
        friction = drives @ self._coupling
        columns = np.empty((samples, joints, len(self._bodies) + len(self._friction)))
        columns[..., self._bodies] = found.columns
        columns[..., self._friction] = values[:, None, self._drive, self._column] * self._shares
        drift = found.gravity - found.turning + friction - self._bias
        return Terms(mass, found.momentum + dq @ self.rotors, drift, friction, held, columns)

    def rests(self, dq: Array, step: float) -> BoolArray:
        """Return where each drive rests, of velocities (N, n) a step in s apart, shape (N, n).

        A drive that only passes through zero speed does not; of one sample alone nobody knows whether it does.
        """
        speeds = dq @ self._coupling.T
        return at_rest(speeds, self._slow, 1.0 / step) if len(dq) > 1 else np.abs(speeds) < self._slow

    def _bodies_at(self, q: Array, dq: Array) -> _Bodies:
        if self._kernel is None:
            return self._generic(q, dq)
        samples, joints = q.shape
        width = self._kernel.layout.outputs[0].width
        if samples < lanes():  # the kernel takes so many at once: repeat the last
            picks = np.minimum(np.arange(lanes()), samples - 1)
            given = [one[picks] for one in (q, dq)]
        else:
            given = [np.ascontiguousarray(one) for one in (q, dq)]
        out = np.empty((len(given[0]), width))
        self._kernel.run(given, (out,), len(out))
        out = out[:samples]
        momentum, turning, gravity, load, mass, columns = (out[:, part] for part in self._parts)
        columns = columns.reshape(samples, joints, len(self._bodies))
        return _Bodies(momentum, turning, gravity, load, mass.reshape(samples, joints, joints), columns)

    @cached_property
    def _kernel(self) -> Kernel | None:
        model, choice = self.model, kernel_choice()
        if choice == "generic" or model.robot.chain.links > LARGEST // 100:
            return None
        key = ("observer", chain_key(model.robot.chain), self._inertial.tobytes(), self._body_columns.tobytes())
        return kernel(key, self._compiled)

    @property
    def _inertial(self) -> Array:
        return self.theta[: self.model.inertial_count]

    def _compiled(self) -> tuple[TracedProgram, Layout] | None:
        """Return M dq, C' dq, g, C dq + g, M, and the columns of the bodies at no acceleration, as one program."""
        chain = self.model.robot.chain
        size, count = chain.joints, len(self._body_columns)
        traced = TracedChain(chain, self._inertial, {"ddq": ""})
        still = copy(traced)  # of the same trace
        still.reads = {"dq": "", "ddq": ""}
        slots: dict[int, Number] = {2 * size + slot: value for slot, value in still.torque().items()}
        slots |= {3 * size + slot: value for slot, value in traced.torque().items()}
        slots |= {4 * size + slot: value for slot, value in traced.mass().items()}
        place = {int(column): k for k, column in enumerate(self._body_columns)}
        wide, start = 10 * chain.links, 4 * size + size * size
        for slot, value in traced.regressor([int(column) for column in self._body_columns]).items():
            slots[start + (slot // wide) * count + place[slot % wide]] = value
        speeds = [traced.trace.input("dq", k) for k in range(size)]
        momentum = _times(traced, slots, 4 * size, speeds)
        slots |= momentum
        energy = dict(enumerate(speeds))
        slopes = gradient(traced.trace, momentum, energy, [traced.trace.input("q", k) for k in range(size)])
        slots |= {size + k: 0.5 * slope for k, slope in enumerate(slopes)}
        program = traced.trace.program(slots)
        if program.operations > LARGEST and kernel_choice() == "auto":
            return None
        output = Buffer("out", Access.BY_SAMPLE, start + size * count)
        layout = Layout(by_sample(chain, ("q", "dq")), (output,), {slot: (0, slot) for slot in program.outputs})
        return program, layout

    def _generic(self, q: Array, dq: Array) -> _Bodies:
        chain, inertial, rest = self.model.robot.chain, self._inertial, np.zeros_like(q)
        floating = replace(chain, gravity=np.zeros(3))

        def moved(positions: Array) -> Array:
            return batched.inverse_dynamics(floating, inertial, positions, rest, dq)

        load = batched.inverse_dynamics(chain, inertial, q, dq, rest)
        gravity = batched.inverse_dynamics(chain, inertial, q, rest, rest)
        change = (moved(q + ALONG * dq) - moved(q - ALONG * dq)) / (2 * ALONG)  # dM/dt dq = (C + C') dq
        columns = batched.torque_regressor(chain, q, dq, rest)[..., self._body_columns]
        return _Bodies(
            moved(q), change - (load - gravity), gravity, load, batched.mass_matrix(chain, inertial, q), columns
        )


@dataclass(frozen=True)
class _Bodies:
    """Of the bodies alone: M dq, C' dq, g, C dq + g, M and their columns."""

    momentum: Array
    turning: Array
    gravity: Array
    load: Array
    mass: Array
    columns: Array


def _times(traced: TracedChain, slots: dict[int, Number], start: int, speeds: Sequence[Number]) -> dict[int, Number]:
    """Return M dq by joint from the entries of M that begin at a slot."""
    size = traced.chain.joints
    found: dict[int, Number] = {}
    for i in range(size):
        total: Number = 0.0
        for j in range(size):
            if start + size * i + j in slots:
                total = total + slots[start + size * i + j] * speeds[j]
        found[i] = total
    return found
