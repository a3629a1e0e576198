"""The possible body nearest to ten parameters that were found with a covariance."""

from __future__ import annotations

import numpy as np

from dynident.arrays import Array
from dynident.errors import SolverFailed
from dynident.model.inertia import PSEUDO_BASIS, Inertia

#: Weight of the pull towards the prior body; a datum of one standard deviation weighs 1.
PULL = 0.01

#: Newton steps at most, and decrement below which they end.
STEPS, DONE = 200, 1e-16


def possible_body(ten: Array, information: Array, prior: Inertia, pull: float = PULL) -> Inertia:
    """Return the body with min (x - ten)' information (x - ten) / 2 + pull * D(P(x), P(prior)) among all with P > 0.

    D is the entropic divergence tr(P0^-1 P) - log det(P0^-1 P) - 4 (Lee, Wensing and Park 2020): a barrier at the edge
    of what is possible, and where the data say nothing the prior. Newton's method with step halving.

    Args:
        ten: Found parameters in the order of TEN, shape (10,).
        information: Inverse covariance, zero in directions that are not determined, shape (10, 10).
        prior: A possible body.
        pull: Weight of D.

    Raises:
        SolverFailed: Newton's method did not converge.
    """
    start = prior.vector
    size = np.maximum(np.sqrt(np.abs(np.diag(_curvature(prior.pseudo)))), 1e-300)
    inverse = np.linalg.inv(prior.pseudo)
    linear = pull * np.einsum("kij,ij->k", PSEUDO_BASIS, inverse)

    def value(x: Array) -> float:
        pseudo = np.einsum("k,kij->ij", x, PSEUDO_BASIS)
        values = np.linalg.eigvalsh(inverse_root.T @ pseudo @ inverse_root)
        if values[0] <= 0:
            return np.inf
        away = x - ten
        return float(0.5 * away @ information @ away + linear @ x - pull * np.sum(np.log(values)))

    inverse_root = np.linalg.cholesky(inverse)
    x, now = start, value(start)
    for _ in range(STEPS):
        pseudo = np.einsum("k,kij->ij", x, PSEUDO_BASIS)
        inside = np.linalg.inv(pseudo)
        slope = information @ (x - ten) + linear - pull * np.einsum("kij,ij->k", PSEUDO_BASIS, inside)
        hessian = (information + pull * _curvature(pseudo)) / size / size[:, None]
        step = -np.linalg.solve(hessian, slope / size) / size
        decrement = float(-slope @ step)
        if decrement <= DONE * max(1.0, abs(now)):
            return Inertia.from_vector(x)
        length = 1.0
        while not value(x + length * step) <= now - 1e-4 * length * decrement:
            length *= 0.5
            if length < 1e-12:  # rounding: nothing smaller can be told
                return Inertia.from_vector(x)
        x = x + length * step
        now = value(x)
    raise SolverFailed("the possible payload", f"{STEPS} steps were not enough", "check the units of the log")


def _curvature(pseudo: Array) -> Array:
    """Return the Hessian of -log det P, tr(P^-1 B_i P^-1 B_j), shape (10, 10)."""
    parts = np.linalg.solve(pseudo, PSEUDO_BASIS)
    return np.einsum("iab,jba->ij", parts, parts)
