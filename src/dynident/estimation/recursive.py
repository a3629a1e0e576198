"""Recursive least squares in square-root form: one triangle that takes rows as they come."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from dynident.arrays import Array, frozen
from dynident.errors import BadOption
from dynident.model.reduction import Reduced, least_squares, triangle_of


@dataclass(frozen=True)
class RecursiveLeastSquares:
    """Least squares that takes rows as they come and forgets old ones: beta_t = argmin sum_s lambda^(t-s) |e_s|^2.

    A value: :meth:`update` returns the next one. Kept is the triangle of the rows so far (square-root information form,
    Bierman 1977, chapter V), not a covariance that loses its symmetry; with ``forgetting`` 1 the estimate is that of
    least squares over all rows, to rounding. An update costs about 2 b^2 per row.

    Attributes:
        size: Number of parameters, b.
        forgetting: lambda, the weight of a sample relative to the next one; 1 forgets nothing. The memory is about
            1 / (1 - lambda) samples.
        factor: Triangle of [W, tau] with what was forgotten, shape (<= b + 1, b + 1).
        samples: Samples taken.
    """

    size: int
    forgetting: float = 1.0
    factor: Array | None = None
    samples: int = 0

    def __post_init__(self) -> None:
        if self.size < 1:
            raise BadOption("size", self.size, "give the number of parameters, 1 or more")
        if not 0 < self.forgetting <= 1:
            raise BadOption("forgetting", self.forgetting, "give a number above 0, at most 1, such as 0.999")
        start = np.zeros((0, self.size + 1)) if self.factor is None else self.factor
        object.__setattr__(self, "factor", frozen(start, (None, self.size + 1), "factor"))

    def update(
        self, matrix: npt.ArrayLike, torque: npt.ArrayLike, age: npt.ArrayLike | None = None
    ) -> RecursiveLeastSquares:
        """Return the state after new rows, weighted as they should count.

        Args:
            matrix: Rows W, shape (m, b).
            torque: Shape (m,).
            age: How many samples each row lies before the newest of these, shape (m,); the newest has 0. None: all rows
                belong to one sample.

        Raises:
            ValueError: A shape is wrong, or a value is no number.
        """
        rows, right = np.asarray(matrix, dtype=float), np.asarray(torque, dtype=float)
        if rows.shape != (len(right), self.size):
            raise ValueError(f"rows of shape {rows.shape} and {right.shape}, expected (m, {self.size}) and (m,)")
        ages = np.zeros(len(right)) if age is None else np.asarray(age, dtype=float)
        passed = int(np.max(ages, initial=0.0)) + 1
        root = np.sqrt(self.forgetting)
        new = np.column_stack([rows, right]) * (root**ages)[:, None]
        factor = triangle_of(np.concatenate([np.asarray(self.factor) * root**passed, new]))
        return replace(self, factor=factor, samples=self.samples + passed)

    @property
    def reduced(self) -> Reduced:
        """The least-squares problem of all rows so far."""
        full = np.zeros((self.size + 1, self.size + 1))
        kept = np.asarray(self.factor)
        full[: len(kept)] = kept
        return Reduced(full[:-1, :-1], full[:-1, -1], float(full[-1, -1] ** 2), self.samples)

    @property
    def beta(self) -> Array:
        """The estimate, shape (b,); 0 in directions that no row has shown yet."""
        return least_squares(self.reduced).beta

    @property
    def unscaled_covariance(self) -> Array:
        """(W' W)^-1 of the weighted rows, shape (b, b); times the residual variance it is the covariance."""
        return least_squares(self.reduced).unscaled_covariance
