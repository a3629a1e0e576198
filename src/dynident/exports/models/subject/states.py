"""The random states of a proof, for engines that have more joints than the model: followers and locked ones."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dynident.arrays import Array
from dynident.errors import UnknownChoice
from dynident.identification.estimate.estimate import Estimate
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import Motion

#: States on which torques are compared, and their seed.
STATES, SEED = 1000, 20

#: States among those of the logs of a fit.
SEEN = 10_000

#: Samples in a row that are small steps, where friction remembers the way, and the least and largest of these steps as
#: a share of what its states span; time from one sample to the next in s.
WALK, STEPS, PACE = 20, (0.01, 1.0), 1e-3


@dataclass(frozen=True)
class StateSet:
    """Random motion of the n joints, and how every joint of a file follows from it.

    Attributes:
        motion: Motion of the n joints that move on their own; where friction remembers, its samples follow each other.
        gravity: In the base frame, shape (3,), in m/s^2.
        follows: By joint of a file: column among the n (-1: locked), multiplier and offset of q = multiplier
            q[column] + offset.
        step: Time from sample to sample in s, where a state of friction depends on it; else None.
    """

    motion: Motion
    gravity: Array
    follows: Mapping[str, tuple[int, float, float]]
    step: float | None = None

    def of(self, joints: Sequence[str]) -> tuple[Array, Array, Array]:
        """Return q, dq, ddq of the joints of a file, each (N, m).

        Raises:
            UnknownChoice: A joint that the model does not know.
        """
        for name in joints:
            if name not in self.follows:
                raise UnknownChoice("joint", name, list(self.follows))
        turn, shift = self._map(joints)
        return self.motion.q @ turn.T + shift, self.motion.dq @ turn.T, self.motion.ddq @ turn.T

    def gather(self, joints: Sequence[str], torque: Array) -> Array:
        """Return the torques (N, n) of the joints that move on their own from those of all joints (N, m)."""
        return torque @ self._map(joints)[0]

    def _map(self, joints: Sequence[str]) -> tuple[Array, Array]:
        turn, shift = np.zeros((len(joints), self.motion.q.shape[1])), np.zeros(len(joints))
        for row, name in enumerate(joints):
            column, multiplier, offset = self.follows[name]
            if column >= 0:
                turn[row, column] = multiplier
            shift[row] = offset
        return turn, shift


def takes_time(model: DynamicModel) -> bool:
    """Return whether a state of its friction depends on the time from sample to sample."""
    return any("step" in program.arrays for part in model.friction for program in part.expression.updates)


def states_of(model: DynamicModel, locked: Mapping[str, float] | None = None) -> StateSet:
    """Return the states of a proof; ``locked`` are joints of the file that the model has fixed, with positions."""
    column = {name: i for i, name in enumerate(model.robot.joint_names)}
    follows = {name: (-1, 0.0, float(position)) for name, position in (locked or {}).items()}
    for joint in model.robot.joints:
        follow = joint.mimic
        follows[joint.name] = (
            (column[joint.name], 1.0, 0.0)
            if follow is None
            else (column[follow.joint], float(follow.multiplier), float(follow.offset))
        )
    motion = model.random_motion(STATES, SEED)
    q = _walk(model, motion.q) if model.lags else motion.q
    # Friction that depends on the load takes the model's own torque, not a drawn one.
    motion = model.with_states(Motion(q, motion.dq, motion.ddq, None, motion.temperature), PACE)
    return StateSet(motion, model.robot.gravity, follows, PACE if takes_time(model) else None)


def motion_of_fit(estimate: Estimate) -> Motion:
    """Return states with the mean and the covariance of those that the logs of a fit have seen, within their range.

    Of an estimate that does not state these they are those of a proof. Friction that remembers is at its full level,
    where it has one.
    """
    model, seen = estimate.model, estimate.envelope
    motion = replace(model.random_motion(SEEN, SEED), torque=None, state=None)
    if seen is not None:
        drawn = np.random.default_rng(SEED).normal(size=(SEEN, len(seen.mean)))
        states = np.asarray(seen.mean) + drawn @ np.linalg.pinv(np.asarray(seen.whitener))
        q, dq, ddq = np.clip(states.reshape(SEEN, 3, -1), seen.low[:3], seen.high[:3]).transpose(1, 0, 2)
        motion = replace(motion, q=q, dq=dq, ddq=ddq)
        if motion.temperature is not None and len(seen.low) > 3:
            motion = replace(motion, temperature=np.clip(motion.temperature, seen.low[3], seen.high[3]))
    has_no_level = any(part.needs_memory for part in model.friction)
    return model.with_states(motion, PACE) if has_no_level else motion


def _walk(model: DynamicModel, q: Array) -> Array:
    """Return positions (N, n) of which every few are a walk of small steps, back and forth, from the first of them."""
    generator = np.random.default_rng(SEED)
    spans = [state.high - state.low for part in model.friction for state in part.states if part.lags]
    low, high = STEPS[0] * min(spans), STEPS[1] * max(spans)
    size = np.exp(generator.uniform(np.log(low), np.log(high), q.shape)) * generator.choice([-1.0, 1.0], q.shape)
    size[::WALK] = 0.0
    walks = np.split(size, range(WALK, len(q), WALK))
    return q[np.arange(len(q)) // WALK * WALK] + np.concatenate([np.cumsum(walk, axis=0) for walk in walks])
