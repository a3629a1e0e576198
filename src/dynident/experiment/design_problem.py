"""The optimisation problem of an excitation design: objective and limits over free numbers, with exact gradients."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from dynident.arrays import Array
from dynident.errors import BadOption
from dynident.experiment.criteria import Criterion
from dynident.experiment.limits import MotionLimits
from dynident.experiment.observation import Observation
from dynident.experiment.parametrisation import Parametrisation
from dynident.model.friction import Motion

#: Share of each bound kept free on the grid, for what happens between its samples.
GUARD = 1e-3


@dataclass(frozen=True)
class Point:
    """What one set of free numbers gives on the grid.

    Attributes:
        objective: Smoothed criterion; the smaller the better.
        gradient: Its derivative, shape (n m,).
        used: Share of each bound that the highest and that the lowest value uses, shape (c,).
        slopes: Derivatives of ``used``, shape (c, n m).
    """

    objective: float
    gradient: Array
    used: Array
    slopes: Array


@dataclass(frozen=True)
class DesignProblem:
    """Criterion and limits of a parametrised motion on a grid of one period.

    Attributes:
        observation: Observation matrix of the model.
        parametrisation: Free numbers to motion.
        criterion: What is to be made best.
        limits: What the motion must keep.
        noise: Standard deviation of each joint's torque, shape (n,); ones for a criterion that is not weighted.
        theta: Nominal parameters for the torque limits, shape (p,); None leaves them out.
        samples: Number of grid samples in one period.

    Raises:
        BadOption: A joint without any bound, or too few samples.
    """

    observation: Observation
    parametrisation: Parametrisation
    criterion: Criterion
    limits: MotionLimits
    noise: Array
    theta: Array | None
    samples: int

    def __post_init__(self) -> None:
        least = 4 * self.parametrisation.harmonics + 1
        if self.samples < least:
            raise BadOption("samples", self.samples, f"give {least} or more for {self.parametrisation.harmonics} waves")
        unbounded = ~np.isfinite(self.limits.bounds()).any(axis=0)
        if unbounded.any():
            joint = self.limits.joints[int(np.argmax(unbounded))]
            raise BadOption(f"limits of {joint}", "none", "state a range, a speed or an acceleration")

    @property
    def joints(self) -> int:
        """Number of joints, n."""
        return len(self.limits.joints)

    @property
    def size(self) -> int:
        """Number of free numbers, n m."""
        return self.joints * self.parametrisation.count

    @cached_property
    def basis(self) -> Array:
        """Basis on the grid and its three derivatives, shape (4, N, m)."""
        time = np.arange(self.samples) * self.parametrisation.period / self.samples
        return self.parametrisation.basis(time)

    @cached_property
    def unit(self) -> Array:
        """Size of the free numbers of each joint, shape (n,): the amplitude of the first harmonic at a bound."""
        pulsation = 2 * np.pi / self.parametrisation.period
        powers = pulsation ** np.arange(4)[:, None]
        return np.min(self.limits.bounds() / powers, axis=0)

    @cached_property
    def _scale(self) -> Array:
        """Unit over bound, 0 without a bound, shape (4, n)."""
        return self.unit / self.limits.bounds()

    @cached_property
    def _rotors(self) -> Array:
        return self.observation.model.robot.reflected_inertia

    @cached_property
    def beta(self) -> Array | None:
        """Base parameters of the nominal torque, shape (b,)."""
        return None if self.theta is None else self.observation.base.from_standard(self.theta)

    @cached_property
    def kinematic(self) -> tuple[tuple[int, int], ...]:
        """The bounds that are finite: derivative (0 position .. 3 jerk) and joint."""
        return tuple((int(k), int(i)) for k, i in zip(*np.nonzero(np.isfinite(self.limits.bounds())), strict=True))

    @cached_property
    def driven(self) -> tuple[int, ...]:
        """Joints whose torque is bounded."""
        found = np.flatnonzero(np.isfinite(self.limits.torque))
        return () if self.beta is None else tuple(int(i) for i in found)

    def free(self, x: Array) -> Array:
        """Return the free numbers (n, m) of scaled ones (n m,): 0 is the middle of all ranges."""
        found = x.reshape(self.joints, -1) * self.unit[:, None]
        found[:, 0] += self.limits.centre
        return found

    def motion(self, x: Array) -> Motion:
        """Return the motion on the grid."""
        free = self.free(x)
        return Motion(*(self.basis[k] @ free.T for k in range(3)))

    def kinematic_uses(self, x: Array) -> Array:
        """Return each joint's greatest used share of a bound on position to jerk, (n,); in proportion to ``x``."""
        return np.abs(self._shares(x)).max(axis=(0, 1))

    def torque_use(self, x: Array) -> float:
        """Return the greatest share of a torque bound that is used; 0 without such bounds."""
        if not self.driven:
            return 0.0
        motion = self.motion(x)
        torque = self._torque(motion, self.observation.rows(motion))
        return max(float(np.abs(torque[i]).max() / self.limits.torque[i]) for i in self.driven)

    def point(self, x: Array, sharpness: float) -> Point:
        """Return objective, limits and their gradients at scaled free numbers (n m,)."""
        motion = self.motion(x)
        rows = self.observation.rows(motion)
        information = self.observation.information(rows, self.noise)
        objective, by_information = self.criterion.objective(information, sharpness)
        weights = self.observation.by_rows(rows, self.noise, by_information)
        first = 2 * len(self.kinematic)
        used = np.empty(first + 2 * len(self.driven))
        slopes = np.zeros((len(used), self.size))
        self._kinematic_bounds(x, used, slopes)
        if not self.driven:
            return Point(objective, self._chained(self.observation.pullback(motion, weights)), used, slopes)
        shares = self._torque(motion, rows)[self.driven, :] / self.limits.torque[self.driven,][:, None]
        worst = np.concatenate([np.argmax(shares, axis=1), np.argmin(shares, axis=1)])
        joints, signs = self.driven * 2, np.repeat([1.0, -1.0], len(self.driven))
        used[first:] = signs * np.concatenate([shares.max(axis=1), shares.min(axis=1)])
        # One pullback for both: the grid for the objective, then one more sample for each torque at its worst.
        signs /= self.limits.torque[joints,]
        both = [np.concatenate(pair, axis=1) for pair in zip(weights, self._torque_weights(joints, signs), strict=True)]
        states = (np.concatenate([signal, signal[worst]]) for signal in (motion.q, motion.dq, motion.ddq))
        by_motion = self.observation.pullback(Motion(*states), both)
        by_worst = np.stack([part[self.samples :] for part in by_motion])
        by_worst[2] += signs[:, None] * self._rotors[:, joints].T
        slope = np.einsum("ksn,ksm->snm", by_worst, self.basis[:3, worst]) * self.unit[:, None]
        slopes[first:] = slope.reshape(len(joints), -1)
        q, dq, ddq = (part[: self.samples] for part in by_motion)
        return Point(objective, self._chained((q, dq, ddq)), used, slopes)

    def _shares(self, x: Array) -> Array:
        """Return distance from the middle, speed, acceleration and jerk as shares of their bounds, (4, N, n)."""
        return (self.basis @ x.reshape(self.joints, -1).T) * self._scale[:, None, :]

    def _kinematic_bounds(self, x: Array, used: Array, slopes: Array) -> None:
        """Fill in the share of the highest and of the lowest value: one bound for both would jump between them."""
        shares, total = self._shares(x), len(self.kinematic)
        orders, joints = np.array(self.kinematic, dtype=np.int64).reshape(-1, 2).T
        own = joints[:, None] * self.parametrisation.count + np.arange(self.parametrisation.count)
        for half, (sign, worst) in enumerate(((1.0, np.argmax(shares, axis=1)), (-1.0, np.argmin(shares, axis=1)))):
            k, rows = worst[orders, joints], half * total + np.arange(total)
            used[rows] = sign * shares[orders, k, joints]
            slopes[rows[:, None], own] = sign * self._scale[orders, joints, None] * self.basis[orders, k]

    def _torque(self, motion: Motion, rows: tuple[Array, ...]) -> Array:
        """Return the nominal torque on the grid, shape (n, N)."""
        assert self.beta is not None
        moved = [self.beta[columns] @ block for columns, block in zip(self.observation.columns, rows, strict=True)]
        return np.stack(moved) + (motion.ddq @ self._rotors).T

    def _torque_weights(self, joints: Sequence[int], signs: Array) -> Sequence[Array]:
        """Return the derivative of torques, one a sample and joint, by the rows there, (K_i, d): only its joint's."""
        assert self.beta is not None
        weights = [np.zeros((len(columns), len(signs))) for columns in self.observation.columns]
        for s, (i, sign) in enumerate(zip(joints, signs, strict=True)):
            weights[i][:, s] = sign * self.beta[self.observation.columns[i]]
        return weights

    def _chained(self, by_motion: tuple[Array, Array, Array]) -> Array:
        """Return the derivative by the scaled free numbers, shape (n m,), from those by q, dq and ddq, (N, n) each."""
        found = sum(state.T @ self.basis[k] for k, state in enumerate(by_motion))
        return (np.asarray(found) * self.unit[:, None]).ravel()
