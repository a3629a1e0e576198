"""What a bound of a motion is: shares used at every sample of a grid, and the exact slope of the worst of them.

A bound has c rows, each smooth in the motion: the highest and the lowest value of a torque are two rows, because one
row for both would jump between them. A row is kept where its share is at most 1 at every sample.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, NamedTuple

import numpy as np

from dynident.arrays import Array, IntArray
from dynident.excitation.design.observation import Observation
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
