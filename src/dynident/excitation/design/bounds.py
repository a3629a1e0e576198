"""What a designed motion must keep: shares used at every sample of a grid, and the exact slope of the worst of them.

A bound has c rows, each smooth in the motion: the highest and the lowest value of a torque are two rows, because one
row for both would jump between them. A row is kept where its share is at most 1 at every sample.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar, NamedTuple

import numpy as np

from dynident.arrays import Array, BoolArray, IntArray
from dynident.excitation.design.distances import Distances, least_distances
from dynident.excitation.design.limits import DISTANCE_SCALE, QUANTITIES, MotionLimits, ToolLimit
from dynident.excitation.design.observation import Observation
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import Motion


class BoundLabel(NamedTuple):
    """What a row is about: a joint or a pair of shapes, and one of the quantities of ``limits.UNITS``."""

    owner: str
    quantity: str

    @property
    def text(self) -> str:
        """In words, such as ``torque of joint2``."""
        return self.quantity if self.quantity == "tool speed" else f"{self.quantity} of {self.owner}"


@dataclass(frozen=True)
class Grid:
    """A motion on even samples of one period.

    Attributes:
        signals: q, dq, ddq and jerk, shape (4, N, n).
        observation: Observation matrix of the model.
        step: Time between samples, in s; sample N is sample 0 of the next period.
    """

    signals: Array
    observation: Observation
    step: float

    @property
    def motion(self) -> Motion:
        """The motion of the samples."""
        return Motion(self.signals[0], self.signals[1], self.signals[2])

    @cached_property
    def rows(self) -> tuple[Array, ...]:
        """Rows of the observation matrix, per joint (K_i, N), computed when first asked for."""
        return self.observation.rows(self.motion)

    def torque(self, beta: Array, rotors: Array) -> Array:
        """Return the torque of base parameters (b,) and of the known reflected inertia (n, n), shape (n, N)."""
        moved = [beta[columns] @ block for columns, block in zip(self.observation.columns, self.rows, strict=True)]
        return np.stack(moved) + (self.signals[2] @ rotors).T


@dataclass(frozen=True)
class ByMotion:
    """Slopes of c rows by the signals of k samples each.

    Attributes:
        sample: Samples of the grid, shape (k, c).
        slope: Derivative of row r by q, dq, ddq and jerk of all joints at its sample, shape (k, c, 4, n).
    """

    sample: IntArray
    slope: Array


@dataclass(frozen=True)
class ByTorque:
    """Slopes of c rows by what makes one joint's torque at k samples each.

    Attributes:
        sample: Samples of the grid, shape (k, c).
        joint: Joint whose torque row r is about, shape (c,).
        entries: Derivative by the entries of that joint's observation row, k lists of c arrays (K_joint,).
        known: Derivative by the torque of the known reflected inertia, shape (k, c).
    """

    sample: IntArray
    joint: IntArray
    entries: Sequence[Sequence[Array]]
    known: Array


class Bound(ABC):
    """One kind of bound; pure: the same grid gives the same answer."""

    #: Whether a robot that stands still can break it, so that a posture can be judged by it.
    of_posture: ClassVar[bool] = False

    #: Whether :meth:`certain_shares` judges a motion between the samples too.
    between_samples: ClassVar[bool] = False

    @property
    @abstractmethod
    def labels(self) -> tuple[BoundLabel, ...]:
        """What each of the c rows is about."""

    @abstractmethod
    def shares(self, grid: Grid) -> Array:
        """Return the share of each row that each sample uses, shape (c, N); 1 at the bound."""

    @abstractmethod
    def slopes(self, grid: Grid, worst: IntArray) -> ByMotion | ByTorque:
        """Return the exact derivative of the share that row r uses at the sample ``worst[r]``.

        Args:
            grid: The motion that :meth:`shares` saw.
            worst: One sample a row, shape (c,).
        """

    def certain_shares(
        self, positions: Callable[[Array], tuple[Array, Array]], time: Array, most: Array, fine: float
    ) -> Array:
        """Return a share of each row that no time of a motion exceeds, shape (c,); of no row as a rule, shape (0,).

        Args:
            positions: Positions and velocities at times, shape (N, n) each.
            time: Samples of the motion, shape (N,), in s.
            most: Largest acceleration of each joint, shape (n,).
            fine: Share by which the answer may exceed the motion's own.
        """
        return np.zeros(0)


class KinematicBound(Bound):
    """Distance from the middle of the range, speed, acceleration and jerk as shares of their finite bounds.

    Attributes:
        finite: The bounds that are finite: derivative (0 position .. 3 jerk) and joint; each has a row for the highest
            value, then each has one for the lowest.
    """

    def __init__(self, limits: MotionLimits) -> None:
        bounds = limits.bounds()
        self._orders, self._joints = np.nonzero(np.isfinite(bounds))
        self._bounds = bounds[self._orders, self._joints]
        self._middle = np.where(self._orders == 0, limits.centre[self._joints], 0.0)
        self._names = limits.joints
        self.finite = tuple((int(k), int(i)) for k, i in zip(self._orders, self._joints, strict=True))

    @property
    def labels(self) -> tuple[BoundLabel, ...]:
        return 2 * tuple(BoundLabel(self._names[i], QUANTITIES[k]) for k, i in self.finite)

    def shares(self, grid: Grid) -> Array:
        values = grid.signals[self._orders, :, self._joints] - self._middle[:, None]
        found = values / self._bounds[:, None]
        return np.concatenate([found, -found])

    def slopes(self, grid: Grid, worst: IntArray) -> ByMotion:
        half = len(self._orders)
        found = np.zeros((1, 2 * half, 4, grid.signals.shape[2]))
        rows = np.arange(half)
        found[0, rows, self._orders, self._joints] = 1.0 / self._bounds
        found[0, half + rows, self._orders, self._joints] = -1.0 / self._bounds
        return ByMotion(worst[None], found)


class ToolSpeedBound(Bound):
    """|v| / limit of the tool point, one row.

    Attributes:
        tool: The point and its largest speed.
    """

    def __init__(self, tool: ToolLimit) -> None:
        self.tool = tool

    @property
    def labels(self) -> tuple[BoundLabel, ...]:
        return (BoundLabel("tool", "tool speed"),) if np.isfinite(self.tool.speed) else ()

    def shares(self, grid: Grid) -> Array:
        return self.tool.point.speed(grid.signals[0], grid.signals[1])[None] / self.tool.speed

    def slopes(self, grid: Grid, worst: IntArray) -> ByMotion:
        by_q, by_dq = self.tool.point.gradient(grid.signals[0][worst], grid.signals[1][worst])
        slope = np.zeros((1, 1, 4, grid.signals.shape[2]))
        slope[0, :, 0], slope[0, :, 1] = by_q / self.tool.speed, by_dq / self.tool.speed
        return ByMotion(worst[None], slope)


class ClearanceBound(Bound):
    """1 + (required - distance) / 0.1 m of every pair at its nearest sample; what holds between samples is checked.

    On the grid of a search the samples alone count; :meth:`certain_shares` judges between them before a motion is kept.

    Attributes:
        distances: The pairs.
    """

    of_posture: ClassVar = True
    between_samples: ClassVar = True

    def __init__(self, distances: Distances) -> None:
        self.distances = distances

    @property
    def labels(self) -> tuple[BoundLabel, ...]:
        return tuple(BoundLabel(name, "clearance") for name in self.distances.names)

    def shares(self, grid: Grid) -> Array:
        found = self.distances.distances(grid.signals[0])
        return np.ascontiguousarray(1.0 + (self.distances.required - found).T / DISTANCE_SCALE)

    def slopes(self, grid: Grid, worst: IntArray) -> ByMotion:
        slope = np.zeros((1, len(worst), 4, grid.signals.shape[2]))
        slope[0, :, 0] = -self.distances.gradient(grid.signals[0][worst], np.arange(len(worst))) / DISTANCE_SCALE
        return ByMotion(worst[None], slope)

    def certain_shares(
        self, positions: Callable[[Array], tuple[Array, Array]], time: Array, most: Array, fine: float
    ) -> Array:
        certain, _ = least_distances(self.distances, positions, time, most, fine * DISTANCE_SCALE)
        return 1.0 + (self.distances.required - certain) / DISTANCE_SCALE


class TorqueBound(Bound):
    """(+-tau_i + sigmas sqrt(y_i' S y_i)) / limit_i: the highest torque of each joint, then the lowest.

    Attributes:
        driven: Joints whose torque is bounded.
    """

    of_posture: ClassVar = True

    def __init__(
        self, limits: MotionLimits, beta: Array, rotors: Array, factors: Sequence[Array] | None = None
    ) -> None:
        """Choose the joints with a finite torque limit.

        Args:
            limits: What must be kept.
            beta: Base parameters of the nominal torque, shape (b,).
            rotors: Known reflected inertia, shape (n, n).
            factors: Per joint F_i with F_i F_i' = sigmas^2 S on its columns, (K_i, b); None for no chance margin.
        """
        self._beta, self._rotors, self._factors, self._names = beta, rotors, factors, limits.joints
        self.driven = tuple(int(i) for i in np.flatnonzero(np.isfinite(limits.torque)))
        self._limits = limits.torque[list(self.driven)]

    @property
    def labels(self) -> tuple[BoundLabel, ...]:
        return 2 * tuple(BoundLabel(self._names[i], "torque") for i in self.driven)

    def shares(self, grid: Grid) -> Array:
        found = grid.torque(self._beta, self._rotors)[list(self.driven)] / self._limits[:, None]
        if self._factors is None:
            return np.concatenate([found, -found])
        moved = [np.linalg.norm(self._factors[i].T @ grid.rows[i], axis=0) for i in self.driven]
        spread = np.stack(moved) / self._limits[:, None]
        return np.concatenate([found + spread, spread - found])

    def slopes(self, grid: Grid, worst: IntArray) -> ByTorque:
        joints = np.array(self.driven * 2, dtype=np.int64)
        known = np.r_[1.0 / self._limits, -1.0 / self._limits]
        columns = grid.observation.columns
        entries = [weight * self._beta[columns[i]] for i, weight in zip(joints, known, strict=True)]
        if self._factors is not None:
            for sample, i, limit, slope in zip(worst, joints, np.tile(self._limits, 2), entries, strict=True):
                moved = self._factors[i].T @ grid.rows[i][:, sample]
                length = float(np.linalg.norm(moved))
                if length > 0:
                    np.add(slope, self._factors[i] @ moved / (length * limit), out=slope)
        return ByTorque(worst[None], joints, [entries], known[None])


#: Speed in rad/s (or m/s) on either side of standstill, and share of its largest value by which dry friction turns.
SLOW, TURNS = 0.05, 0.2


class TorqueRateBound(Bound):
    """(tau_i(k + 1) - tau_i(k)) / (step limit_i): the fastest rise of each joint's torque, then the fastest fall.

    The difference between neighbouring samples is the mean rate between them; its gradient is exact. It is less than
    the largest rate between the samples by about (w step)^2 / 24 of it, w the pulsation of the torque, so that a motion
    is judged on the finer grid, and its plan by narrow differences. Dry friction is left out (see
    :func:`smooth_parameters`).

    Attributes:
        driven: Joints whose rate is bounded.
    """

    def __init__(self, limits: MotionLimits, beta: Array, rotors: Array) -> None:
        """Choose the joints with a finite rate.

        Args:
            limits: What must be kept.
            beta: Base parameters of the smooth part of the torque, shape (b,).
            rotors: Known reflected inertia, shape (n, n).
        """
        self._beta, self._rotors, self._names = beta, rotors, limits.joints
        self.driven = tuple(int(i) for i in np.flatnonzero(np.isfinite(limits.torque_rate)))
        self._limits = limits.torque_rate[list(self.driven)]

    @property
    def labels(self) -> tuple[BoundLabel, ...]:
        return 2 * tuple(BoundLabel(self._names[i], "torque rate") for i in self.driven)

    def shares(self, grid: Grid) -> Array:
        torque = grid.torque(self._beta, self._rotors)[list(self.driven)]
        found = (np.roll(torque, -1, axis=1) - torque) / (grid.step * self._limits[:, None])
        return np.concatenate([found, -found])

    def slopes(self, grid: Grid, worst: IntArray) -> ByTorque:
        once = 1.0 / (grid.step * self._limits)
        columns = grid.observation.columns
        up = [weight * self._beta[columns[i]] for i, weight in zip(self.driven, once, strict=True)]
        down = [-slope for slope in up]
        known = np.r_[once, -once]
        after = (worst + 1) % grid.signals.shape[1]
        joints = np.array(self.driven * 2, dtype=np.int64)
        return ByTorque(np.stack([after, worst]), joints, [up + down, down + up], np.stack([known, -known]))


def smooth_parameters(model: DynamicModel) -> BoolArray:
    """Return which standard parameters make a torque whose rate means something, shape (p,).

    All inertial ones, and friction that does not turn over with the joint. Dry friction does: the smoothed sign of a
    model turns over in milliseconds, at a rate that is that of the smoothing, not of the drive. A column counts as dry
    where it changes from -0.05 to 0.05 rad/s (or m/s) by more than a fifth of its largest value.
    """
    motion = model.random_motion(40, seed=1)
    slow = SLOW * np.sign(motion.dq)
    forwards, backwards = (model.friction_values(replace(motion, dq=speed)) for speed in (slow, -slow))
    most = np.abs([model.friction_values(motion), forwards, backwards]).max(axis=(0, 1), initial=0.0)
    dry = np.abs(forwards - backwards).max(axis=0, initial=0.0) > TURNS * most
    return np.r_[np.ones(model.inertial_count, dtype=bool), ~dry[model.terms]]
