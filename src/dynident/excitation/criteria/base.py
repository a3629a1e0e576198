"""What a criterion is: a figure of the observation matrix, and a smooth objective with its exact gradient.

Both see the observation matrix only through its information per sample M = W'W / N, shape (b, b), or a triangle R of
it, M = R'R: the gradient by W follows as 2 W G / N from the gradient G by M. Where earlier runs are known, their
information per row of the new run has been added to M; no criterion needs to know.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar

import numpy as np

from dynident.arrays import Array

#: Eigenvalues below this share of the largest are rounding; they count as this much.
_FLOOR = 1e-15

#: A column whose square is below this share of the largest is not excited; it counts as this much.
_EMPTY = 1e-30


class Criterion(ABC):
    """A measure of excitation; a frozen dataclass whose fields are its options."""

    #: Whether the rows of each joint are divided by the noise of its torque before anything is computed.
    weighted: ClassVar[bool] = False

    #: Whether a greater figure is a better motion.
    larger_is_better: ClassVar[bool] = False

    #: Sharpness of :meth:`objective` from one stage of the search to the next.
    stages: ClassVar[tuple[float, ...]] = (1.0,)

    @property
    def nominal_deviation(self) -> float | None:
        """Relative standard deviation of the nominal model that counts as known before the run; None for unknown."""
        return None

    @abstractmethod
    def value(self, triangle: Array) -> float:
        """Return the figure itself from a triangle R (b, b) with R'R = M; not finite where M is singular."""

    @abstractmethod
    def objective(self, information: Array, sharpness: float) -> tuple[float, Array]:
        """Return what the search makes small, and its derivative by each entry of M.

        Args:
            information: M, symmetric, shape (b, b).
            sharpness: The greater, the nearer the objective follows :meth:`value`, and the less smooth it is.

        Returns:
            The objective, and its gradient, symmetric, shape (b, b).
        """


def log_ends(information: Array, sharpness: float, largest: float, smallest: float) -> tuple[float, Array]:
    """Return a sum of the logs of the largest and the smallest eigenvalue, both smoothed, with its gradient by M.

    log largest = log(sum of l^p) / p and log smallest = -log(sum of l^-p) / p with p the sharpness: between the true
    ones and log(b) / p outside them, and smooth where eigenvalues meet.

    Args:
        information: M, symmetric, shape (b, b).
        sharpness: p.
        largest: Weight of the largest one.
        smallest: Weight of the smallest one.
    """
    found, vectors = np.linalg.eigh(information)
    values = np.maximum(found, _FLOOR * max(found[-1], np.finfo(float).tiny))
    logs = np.log(values)
    total, slopes = 0.0, np.zeros_like(values)
    for sign, weight in ((1.0, largest), (-1.0, smallest)):
        powers = sign * sharpness * logs
        top = powers.max()
        shares = np.exp(powers - top)
        norm = shares.sum()
        total += weight * sign * (top + float(np.log(norm))) / sharpness
        slopes += weight / norm * shares
    return total, (vectors * (slopes / values)) @ vectors.T


def singular_values(triangle: Array) -> Array:
    """Return the singular values of a triangle, largest first; those that are rounding are 0."""
    values = np.linalg.svd(triangle, compute_uv=False)
    return np.where(values > len(values) * np.finfo(float).eps * values[0], values, 0.0)


def column_squares(information: Array) -> Array:
    """Return the diagonal of M, shape (b,), kept away from 0 by a share of its largest entry."""
    diagonal = np.diagonal(information)
    return np.maximum(diagonal, _EMPTY * max(float(diagonal.max()), np.finfo(float).tiny / _EMPTY))


def log_volume(information: Array, regularisation: float = 0.0) -> tuple[float, Array]:
    """Return log det(M + d diag M) and its gradient by M; finite, by a floor, where M is singular."""
    diagonal = column_squares(information)
    inverse = 1.0 / np.sqrt(diagonal)
    scaled = information * np.outer(inverse, inverse)
    found, vectors = np.linalg.eigh(scaled)
    values = np.maximum(found + regularisation, _FLOOR)
    inner = (vectors / values) @ vectors.T * np.outer(inverse, inverse)
    gradient = inner + regularisation * np.diag(np.diagonal(inner))
    return float(np.sum(np.log(values)) + np.sum(np.log(diagonal))), gradient
