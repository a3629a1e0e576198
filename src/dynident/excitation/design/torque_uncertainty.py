"""How uncertain a model's torque is: the covariance of its base parameters, carried to every sample of a motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from dynident.arrays import Array, IntArray, frozen
from dynident.errors import BadOption
from dynident.model.base_parameters import BaseParameters


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
