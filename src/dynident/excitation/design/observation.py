"""The base observation matrix of a motion that is being designed, and the exact derivative of what depends on it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dynident.arrays import Array, IntArray
from dynident.model.base_parameters import BaseParameters
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import Motion
from dynident.model.kernels.joint_columns import JointColumns
from dynident.model.reduction import absorb

#: Samples whose rows are reduced at a time.
_CHUNK = 1000


class Observation:
    """Rows of W, joint by joint, without the entries that are zero at every motion.

    Attributes:
        model: Robot, drives and friction.
        base: Its base parameters.
        columns: Per joint, the positions in beta of the rows' entries, shape (K_i,).
    """

    def __init__(self, model: DynamicModel, base: BaseParameters) -> None:
        self.model, self.base = model, base
        inertial = base.independent[base.independent < model.inertial_count]
        self._kernel = JointColumns(model.robot.chain, inertial)
        friction = base.independent[base.independent >= model.inertial_count] - model.inertial_count
        self._drive, self._coefficient = (found[friction] for found in model.terms)
        self._coupling = np.asarray(model.robot.coupling)
        self._own = [np.flatnonzero(self._coupling[self._drive, i] != 0) for i in range(model.robot.dof)]
        self.columns: tuple[IntArray, ...] = tuple(
            np.concatenate([found, len(inertial) + own]).astype(np.int64)
            for found, own in zip(self._kernel.columns, self._own, strict=True)
        )
        # Of all friction columns, one after the other by joint: drive, coefficient, and what it counts at the joint.
        tails = np.concatenate(self._own).astype(np.int64)
        joints = np.repeat(np.arange(model.robot.dof), [len(own) for own in self._own])
        self._tail_drive, self._tail_coefficient = self._drive[tails], self._coefficient[tails]
        self._tail_share = self._coupling[self._tail_drive, joints]
        self._is_shared = bool(np.any(self._tail_share != 1.0))
        self._ends = np.cumsum([0, *(len(own) for own in self._own)])
        # Where the entries of each joint's block stand in a flat (b, b) matrix; faster than two indices.
        self._blocks = [(columns[:, None] * base.count + columns).ravel() for columns in self.columns]

    def rows(self, motion: Motion) -> tuple[Array, ...]:
        """Return the rows of each joint, arrays (K_i, N): row k belongs to ``columns[i][k]``."""
        blocks = tuple(np.empty((len(columns), len(motion.q))) for columns in self.columns)
        heads = [block[: len(found)] for block, found in zip(blocks, self._kernel.columns, strict=True)]
        self._kernel.evaluate(motion.q, motion.dq, motion.ddq, out=heads)
        if self._ends[-1]:
            tails = self.model.friction_values(motion).T[self._tail_coefficient, self._tail_drive]
            if self._is_shared:
                tails *= self._tail_share[:, None]
            for i, block in enumerate(blocks):
                block[len(self._kernel.columns[i]) :] = tails[self._ends[i] : self._ends[i + 1]]
        return blocks

    def spread(self, motion: Motion, factors: Sequence[Array]) -> Array:
        """Return the chance margin (N, n) of a motion, by the factors of the torque's uncertainty at each joint."""
        rows = zip(factors, self.rows(motion), strict=True)
        return np.stack([np.linalg.norm(f.T @ r, axis=0) for f, r in rows], axis=1)

    def pullback(self, motion: Motion, weights: Sequence[Array]) -> tuple[Array, Array, Array]:
        """Return the derivatives by q, dq and ddq of the weighted sum of all entries, each (N, n); exact.

        Args:
            motion: The motion of N samples.
            weights: Derivative of what is asked by each entry, arrays (K_i, N) as :meth:`rows` returns them.
        """
        heads = [
            np.ascontiguousarray(weight[: len(found)])
            for weight, found in zip(weights, self._kernel.columns, strict=True)
        ]
        inertial = self._kernel.pullback(motion.q, motion.dq, motion.ddq, heads)
        if not self.model.friction:
            return inertial
        at_drives = self._at_drives(weights)
        coupled = self.model.robot.is_coupled
        for own, slopes in zip(inertial, self.model.friction_slopes(motion), strict=True):
            found = (at_drives * slopes.T).sum(axis=0).T
            own += found @ self._coupling if coupled else found  # noqa: PLW2901 - adds in place
        return inertial

    def information(self, rows: Sequence[Array], noise: Array) -> Array:
        """Return W'W / N, shape (b, b), the rows of joint i divided by ``noise[i]``."""
        found = np.zeros(self.base.count**2)
        for own, block, level in zip(self._blocks, rows, noise, strict=True):
            square = (block @ block.T).ravel()
            square /= level**2 * block.shape[1]
            square += found.take(own)
            found[own] = square
        return found.reshape(self.base.count, self.base.count)

    def by_rows(self, rows: Sequence[Array], noise: Array, gradient: Array) -> tuple[Array, ...]:
        """Return the derivative by each entry of ``rows`` of what has the gradient (b, b) by the information."""
        return tuple(
            (2.0 / (level**2 * block.shape[1]) * gradient.take(own)).reshape(len(block), -1) @ block
            for own, block, level in zip(self._blocks, rows, noise, strict=True)
        )

    def triangle(self, motion: Motion, noise: Array) -> Array:
        """Return R, shape (b, b), with R'R = W'W / N, the rows of joint i divided by ``noise[i]``; by QR."""
        size, count = self.base.count, len(motion.q)
        factor = np.zeros((size, size), order="F")
        for start in range(0, count, _CHUNK):
            part = slice(start, start + _CHUNK)
            for columns, block, level in zip(
                self.columns, self.rows(Motion(motion.q[part], motion.dq[part], motion.ddq[part])), noise, strict=True
            ):
                panel = np.zeros((block.shape[1], size), order="F")
                panel[:, columns] = block.T / (level * np.sqrt(count))
                factor = absorb(factor, panel)
        return np.triu(factor)

    def _at_drives(self, weights: Sequence[Array]) -> Array:
        """Return the derivative by each friction value at its drive, shape (k, n, N)."""
        tails = np.concatenate([w[len(head) :] for w, head in zip(weights, self._kernel.columns, strict=True)])
        found = np.zeros((self.model.coefficients_per_joint, self.model.robot.dof, tails.shape[1]))
        if self._is_shared:  # a drive may stand in the rows of several joints
            np.add.at(found, (self._tail_coefficient, self._tail_drive), tails * self._tail_share[:, None])
        else:
            found[self._tail_coefficient, self._tail_drive] = tails
        return found
