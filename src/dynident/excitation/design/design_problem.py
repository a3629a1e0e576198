"""The optimisation problem of an excitation design: objective and limits over free numbers, with exact gradients."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from dynident.arrays import Array, IntArray
from dynident.errors import BadOption
from dynident.excitation.criteria import Criterion
from dynident.excitation.design.bounds import (
    Bound,
    BoundLabel,
    ByMotion,
    ByTorque,
    ClearanceBound,
    Grid,
    KinematicBound,
    ToolSpeedBound,
    TorqueBound,
    TorqueRateBound,
    smooth_parameters,
)
from dynident.excitation.design.distances import Distances
from dynident.excitation.design.limits import MotionLimits, ToolLimit
from dynident.excitation.design.observation import Observation, TorqueUncertainty
from dynident.excitation.design.parametrisation import Parametrisation
from dynident.model.friction import Motion
from dynident.model.reduction import triangle_of

#: Share of each bound kept free on the grid, for what happens between its samples.
GUARD = 1e-3


@dataclass(frozen=True)
class Point:
    """What one set of free numbers gives on the grid.

    Attributes:
        objective: Smoothed criterion; the smaller the better.
        gradient: Its derivative, shape (n m,).
        used: Share of each row of the bounds that its worst sample uses, shape (c,); see ``DesignProblem.labels``.
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
        uncertainty: Chance margin of the torques; None for none. It needs ``theta``.
        clearance: Pairs of shapes to be kept apart; None leaves them out.
        earlier: Triangle E, shape (b, b): E'E is what earlier runs know, per row of this one; None where nothing is.
        tool: Largest speed of the tool point; None leaves it out.

    Raises:
        BadOption: A joint without any bound, too few samples, or an uncertainty of other parameters or of none.
    """

    observation: Observation
    parametrisation: Parametrisation
    criterion: Criterion
    limits: MotionLimits
    noise: Array
    theta: Array | None
    samples: int
    uncertainty: TorqueUncertainty | None = None
    clearance: Distances | None = None
    earlier: Array | None = None
    tool: ToolLimit | None = None

    def __post_init__(self) -> None:
        least = 4 * self.parametrisation.harmonics + 1
        if self.samples < least:
            raise BadOption("samples", self.samples, f"give {least} or more for {self.parametrisation.harmonics} waves")
        unbounded = ~np.isfinite(self.limits.bounds()).any(axis=0)
        if unbounded.any():
            joint = self.limits.joints[int(np.argmax(unbounded))]
            raise BadOption(f"limits of {joint}", "none", "state a range, a speed or an acceleration")
        if self.uncertainty is not None:
            count = len(self.uncertainty.covariance)
            if self.theta is None:
                raise BadOption("uncertainty", "of no torques", "give the parameters of the torque limits (theta)")
            if count != self.observation.base.count:
                step = f"the model has {self.observation.base.count} base parameters; give their covariance"
                raise BadOption("uncertainty", f"of {count} parameters", step)

    @property
    def joints(self) -> int:
        """Number of joints, n."""
        return len(self.limits.joints)

    @property
    def size(self) -> int:
        """Number of free numbers, n m."""
        return self.joints * self.parametrisation.count

    @cached_property
    def time(self) -> Array:
        """Times of the grid in s, shape (N,)."""
        return np.arange(self.samples) * self.parametrisation.period / self.samples

    @cached_property
    def basis(self) -> Array:
        """Basis on the grid and its three derivatives, shape (4, N, m)."""
        return self.parametrisation.basis(self.time)

    @cached_property
    def unit(self) -> Array:
        """Size of the free numbers of each joint, shape (n,): the amplitude of the first harmonic at a bound."""
        pulsation = 2 * np.pi / self.parametrisation.period
        powers = pulsation ** np.arange(4)[:, None]
        return np.min(self.limits.bounds() / powers, axis=0)

    @cached_property
    def rotors(self) -> Array:
        """Known reflected inertia, shape (n, n)."""
        return self.observation.model.robot.reflected_inertia

    @cached_property
    def beta(self) -> Array | None:
        """Base parameters of the nominal torque, shape (b,)."""
        return None if self.theta is None else self.observation.base.from_standard(self.theta)

    @cached_property
    def smooth_theta(self) -> Array | None:
        """Standard parameters of the torque whose rate is bounded, shape (p,): those without dry friction."""
        return None if self.theta is None else self.theta * smooth_parameters(self.observation.model)

    @cached_property
    def spread_factors(self) -> tuple[Array, ...] | None:
        """Per joint F_i, (K_i, b): the chance margin of its torque is ``|F_i' y|``; None where there is none."""
        return None if self.uncertainty is None else self.uncertainty.factors(self.observation.columns)

    @cached_property
    def _kinematic_bound(self) -> KinematicBound:
        return KinematicBound(self.limits)

    @cached_property
    def _torque_bound(self) -> TorqueBound | None:
        if self.beta is None:
            return None
        return TorqueBound(self.limits, self.beta, self.rotors, self.spread_factors)

    @cached_property
    def bounds(self) -> tuple[Bound, ...]:
        """Everything that is bounded, the kinematic bounds first; parts without a row are left out."""
        found: list[Bound] = [self._kinematic_bound]
        if self._torque_bound is not None:
            found.append(self._torque_bound)
        if self.smooth_theta is not None:
            smooth = self.observation.base.from_standard(self.smooth_theta)
            found.append(TorqueRateBound(self.limits, smooth, self.rotors))
        if self.clearance is not None:
            found.append(ClearanceBound(self.clearance))
        if self.tool is not None:
            found.append(ToolSpeedBound(self.tool))
        return tuple(bound for bound in found if bound.labels)

    @cached_property
    def labels(self) -> tuple[BoundLabel, ...]:
        """What each row of ``Point.used`` is about: joint or pair, and quantity; c of them."""
        return tuple(label for bound in self.bounds for label in bound.labels)

    @property
    def kinematic(self) -> tuple[tuple[int, int], ...]:
        """The kinematic bounds that are finite: derivative (0 position .. 3 jerk) and joint."""
        return self._kinematic_bound.finite

    @property
    def driven(self) -> tuple[int, ...]:
        """Joints whose torque is bounded."""
        return () if self._torque_bound is None else self._torque_bound.driven

    def free(self, x: Array) -> Array:
        """Return the free numbers (n, m) of scaled ones (n m,): 0 is the middle of all ranges."""
        found = x.reshape(self.joints, -1) * self.unit[:, None]
        found[:, 0] += self.limits.centre
        return found

    def grid(self, x: Array) -> Grid:
        """Return the motion on the grid, with what bounds ask of it."""
        return Grid(self.basis @ self.free(x).T, self.observation, self.parametrisation.period / self.samples)

    def motion(self, x: Array) -> Motion:
        """Return the motion on the grid."""
        free = self.free(x)
        return Motion(*(self.basis[k] @ free.T for k in range(3)))

    def figure(self, motion: Motion) -> float:
        """Return the figure of the criterion for a motion on any even grid, earlier runs counted."""
        own = self.observation.triangle(motion, self.noise)
        return self.criterion.value(own if self.earlier is None else triangle_of(np.concatenate([own, self.earlier])))

    def point(self, x: Array, sharpness: float) -> Point:
        """Return objective, limits and their gradients at scaled free numbers (n m,)."""
        grid = self.grid(x)
        information = self.observation.information(grid.rows, self.noise)
        if self.earlier is not None:
            information += self.earlier.T @ self.earlier
        objective, by_information = self.criterion.objective(information, sharpness)
        weights = self.observation.by_rows(grid.rows, self.noise, by_information)
        used, parts = [], []
        for bound in self.bounds:
            shares = bound.shares(grid)
            worst = np.argmax(shares, axis=1)
            used.append(shares[np.arange(len(worst)), worst])
            parts.append(bound.slopes(grid, worst))
        # One pullback for all: the grid for the objective, then one more sample for each torque that is asked for.
        states, weights = self._with_torques(grid.motion, weights, parts)
        by_motion = self.observation.pullback(states, weights)
        slopes, after = [], self.samples
        for part in parts:
            if isinstance(part, ByTorque):
                stop = after + part.sample.size
                slopes.append(self._of_torque(part, [signal[after:stop] for signal in by_motion]))
                after = stop
            else:
                slopes.append(self._of_motion(part.sample, part.slope))
        q, dq, ddq = (part[: self.samples] for part in by_motion)
        return Point(objective, self._chained((q, dq, ddq)), np.concatenate(used), np.concatenate(slopes))

    def _with_torques(
        self, motion: Motion, weights: Sequence[Array], parts: Sequence[ByMotion | ByTorque]
    ) -> tuple[Motion, Sequence[Array]]:
        """Return motion and weights of the grid with one more sample for every torque that is asked for."""
        asked = [part for part in parts if isinstance(part, ByTorque)]
        if not asked:
            return motion, weights
        samples: IntArray = np.concatenate([part.sample.ravel() for part in asked])
        states = Motion(*(np.concatenate([s, s[samples]]) for s in (motion.q, motion.dq, motion.ddq)))
        more = [np.zeros((len(columns), len(samples))) for columns in self.observation.columns]
        s = 0
        for part in asked:
            for term in part.entries:
                for joint, entries in zip(part.joint, term, strict=True):
                    more[joint][:, s] = entries
                    s += 1
        return states, [np.concatenate(pair, axis=1) for pair in zip(weights, more, strict=True)]

    def _of_torque(self, part: ByTorque, by_motion: Sequence[Array]) -> Array:
        """Return slopes by the free numbers, (c, n m), from those by q, dq and ddq at the samples of ``part``."""
        slope = np.zeros((*part.sample.shape, 4, self.joints))
        for order, signal in enumerate(by_motion):
            slope[:, :, order] = signal.reshape(*part.sample.shape, -1)
        slope[:, :, 2] += part.known[..., None] * self.rotors[part.joint]
        return self._of_motion(part.sample, slope)

    def _of_motion(self, sample: IntArray, slope: Array) -> Array:
        """Return slopes by the free numbers, (c, n m), from those by the signals at k samples, (k, c, 4, n)."""
        basis = self.basis.transpose(1, 0, 2)[sample]
        found = (slope.swapaxes(2, 3) @ basis).sum(axis=0) * self.unit[:, None]
        return found.reshape(len(found), -1)

    def _chained(self, by_motion: tuple[Array, Array, Array]) -> Array:
        """Return the derivative by the scaled free numbers, shape (n m,), from those by q, dq and ddq, (N, n) each."""
        found = sum(state.T @ self.basis[k] for k, state in enumerate(by_motion))
        return (np.asarray(found) * self.unit[:, None]).ravel()
