"""The base observation matrix of a motion that is being designed, and the exact derivative of what depends on it.

The uncertainty of a torque is the covariance of base parameters, carried to every sample of a motion.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from dynident.arrays import Array, IntArray, frozen
from dynident.errors import BadOption
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


@dataclass(frozen=True)
class TorqueUncertainty:
    """A chance margin: |tau_i| + sigmas sqrt(y_i' S y_i) stays within the torque limit at every sample.

    y_i is the row of joint i of the observation matrix and S the covariance of the base parameters, so that the root is
    the standard deviation of the predicted torque. With normal errors a joint passes its limit at a given sample, to
    either side, with the probability 4.6 % for 2 sigmas and 0.27 % for 3 at most.

    It covers what the parameters do not know, the flat torque margin of ``limits_of`` what the model does not have
    (unmodelled friction, control). Both apply: the margin lowers the limit, the sigmas raise the torque. Where the
    model is an estimate with its covariance, a flat margin of 0.05 to 0.1 in place of 0.2 is reasonable.

    Attributes:
        covariance: S, symmetric and positive semi-definite, shape (b, b).
        sigmas: Number of standard deviations to keep free.

    Raises:
        BadOption: A covariance that is none, or a number of sigmas that is not positive.
        ValueError: Another shape.
    """

    covariance: Array
    sigmas: float = 2.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "covariance", frozen(self.covariance, (None, None), "covariance"))
        object.__setattr__(self, "sigmas", float(self.sigmas))
        if not 0 < self.sigmas < np.inf:
            raise BadOption("sigmas", self.sigmas, "give a number above 0")
        matrix = self.covariance
        if matrix.shape[0] != matrix.shape[1] or not np.all(np.isfinite(matrix)):
            raise BadOption("covariance", f"of shape {matrix.shape}", "give a square matrix of finite numbers")
        squares = np.diagonal(matrix)
        scale = np.sqrt(np.abs(np.outer(squares, squares)))
        odd = np.any(np.abs(matrix - matrix.T) > 1e-9 * scale) or np.any(np.abs(matrix) > (1 + 1e-9) * scale)
        if odd or np.any(squares < 0) or self._values[0] < -1e-9:
            raise BadOption("covariance", "not one", "give a symmetric matrix without negative eigenvalues")

    @classmethod
    def of_shares(
        cls, base: BaseParameters, theta: npt.ArrayLike, share: npt.ArrayLike, sigmas: float = 2.0
    ) -> TorqueUncertainty:
        """Build from relative standard deviations of the standard parameters, independent of each other: S = K D K'.

        Args:
            base: Base parameters of the model.
            theta: Nominal standard parameters, shape (p,).
            share: Standard deviation as a share of each value: one number, or shape (p,).
            sigmas: Number of standard deviations to keep free.

        Raises:
            BadOption: A share that is negative or not finite.
            ValueError: Another shape.
        """
        values = np.array(theta, dtype=np.float64)
        if values.shape != (len(base.parameters),):
            raise ValueError(f"theta has shape {values.shape}, expected ({len(base.parameters)},)")
        shares = np.broadcast_to(np.asarray(share, dtype=np.float64), values.shape)
        if not np.all((shares >= 0) & np.isfinite(shares)):
            raise BadOption("share", np.asarray(share).tolist(), "give shares of 0 or more, such as 0.1 for 10 %")
        columns = base.matrix * (shares * np.abs(values))
        return cls(columns @ columns.T, sigmas)

    def factors(self, columns: Sequence[IntArray]) -> tuple[Array, ...]:
        """Return per joint F_i, shape (K_i, b), with F_i F_i' = sigmas^2 S on the columns of its rows."""
        root = self.sigmas * np.sqrt(np.diagonal(self.covariance))[:, None] * self._vectors
        root = root * np.sqrt(np.maximum(self._values, 0.0))
        return tuple(np.ascontiguousarray(root[found][:, self._values > 1e-14 * len(root)]) for found in columns)

    @cached_property
    def _parts(self) -> tuple[Array, Array]:
        """Eigenvalues, ascending, and vectors of the correlation matrix: no unit is small beside another."""
        deviations = np.sqrt(np.maximum(np.diagonal(self.covariance), 0.0))
        inverse = np.divide(1.0, deviations, out=np.zeros_like(deviations), where=deviations > 0)
        values, vectors = np.linalg.eigh(self.covariance * np.outer(inverse, inverse))
        return values, vectors

    @property
    def _values(self) -> Array:
        return self._parts[0]

    @property
    def _vectors(self) -> Array:
        return self._parts[1]
